//! Every request passes here before its body is read.

use axum::extract::Request;
use axum::http::{HeaderMap, Method, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::{Access, Caller, Pass, Scope, Secret, site};
use crate::error::{ApiError, OfAnotherToken};
use crate::heavy::heavy;
use crate::state::AppState;

/// Lets a request pass, with the one who makes it, or refuses it.
pub(crate) async fn guard(state: &AppState, mut request: Request, next: Next) -> Response {
    let response = match check(state, request.method(), request.uri(), request.headers()).await {
        Ok((caller, pass)) => {
            let asked = (request.method().clone(), request.uri().clone());
            request.extensions_mut().insert(caller.clone());
            request.extensions_mut().insert(pass.clone());
            let response = heavy(state, request, next).await;
            if response.extensions().get::<OfAnotherToken>().is_some() {
                turn_away(state, "another_token", &caller, &asked.0, asked.1.path());
            }
            pass.watch_over(response, state)
        }
        Err(refusal) => refusal.into_response(),
    };
    state.metrics().answered(response.status().as_u16());
    response
}

fn turn_away(state: &AppState, reason: &'static str, caller: &Caller, method: &Method, path: &str) {
    state.metrics().turned_away(reason);
    state.refusals().forbidden(caller.name(), method.as_str(), path);
}

async fn check(state: &AppState, method: &Method, uri: &Uri, headers: &HeaderMap) -> Result<(Caller, Pass), ApiError> {
    let path = uri.path();
    if headers.get_all(header::HOST).iter().count() > 1 {
        return Err(ApiError::UnclearHost);
    }
    let Access::Tokens(given) = &state.config().access else {
        let own = site::right_host(&state.config().hosts, uri, headers)?;
        site::right_site(own, method, path, headers)?;
        return Ok((Caller::default(), Pass::open()));
    };
    let Some(scope) = required(method, path) else { return Ok((Caller::default(), Pass::open())) };
    let unknown = || {
        state.metrics().turned_away("no_valid_token");
        state.refusals().unknown(method.as_str(), path);
        ApiError::Unauthenticated
    };
    let secret = bearer(headers).ok_or_else(unknown)?;
    let caller = state.tokens().bearer(&secret, given, state.store()).await?.ok_or_else(unknown)?;
    if caller.allows(scope) {
        let hash = secret.hash();
        let pass = if given.contains(&hash) { Pass::open() } else { Pass::of(hash, scope) };
        return Ok((caller, pass));
    }
    turn_away(state, "scope", &caller, method, path);
    Err(ApiError::Forbidden(scope))
}

/// What a request asks for; none for what anybody may ask.
fn required(method: &Method, path: &str) -> Option<Scope> {
    let reads = method == Method::GET || method == Method::HEAD;
    let mut parts = path.trim_start_matches('/').split('/');
    match (parts.next(), parts.next(), parts.next(), parts.next()) {
        (Some("healthz" | "readyz" | "openapi.json" | "docs"), None, ..) | (Some("docs"), ..) if reads => None,
        // The page itself is the same for everybody; what it shows is not.
        (Some(""), None, ..) | (Some("assets"), Some(_), ..) if reads => None,
        (Some("v1"), Some("jobs"), Some(_), Some("task")) => Some(Scope::Worker),
        (Some("v1"), Some("workers"), _, Some("drain" | "disown" | "readmit")) => Some(Scope::Admin),
        (Some("v1"), Some("workers"), ..) if !reads => Some(Scope::Worker),
        // Asked by POST, but nothing is stored.
        (Some("v1"), Some("simulations"), None, _) => Some(Scope::Read),
        _ if reads || path.ends_with("/surrogate/predictions") => Some(Scope::Read),
        _ => Some(Scope::Submit),
    }
}

fn bearer(headers: &HeaderMap) -> Option<Secret> {
    let value = headers.get(header::AUTHORIZATION)?.to_str().ok()?;
    let (scheme, token) = value.split_once(' ')?;
    Secret::new(token).ok().filter(|_| scheme.eq_ignore_ascii_case("bearer"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_request_asks_for_its_scope() {
        let (get, post, delete) = (Method::GET, Method::POST, Method::DELETE);
        let cases = [
            (&get, "/healthz", None),
            (&get, "/", None),
            (&get, "/assets/main.js", None),
            (&post, "/assets/main.js", Some(Scope::Submit)),
            (&get, "/v1/events", Some(Scope::Read)),
            (&get, "/docs", None),
            (&get, "/docs/start.js", None),
            (&post, "/docs", Some(Scope::Submit)),
            (&post, "/healthz", Some(Scope::Submit)),
            (&get, "/healthz/x", Some(Scope::Read)),
            (&get, "/metrics", Some(Scope::Read)),
            (&get, "/v1/studies/1/dataset", Some(Scope::Read)),
            (&post, "/v1/studies", Some(Scope::Submit)),
            (&post, "/v1/studies/1/cancel", Some(Scope::Submit)),
            (&post, "/v1/studies/1/surrogate/predictions", Some(Scope::Read)),
            (&post, "/v1/simulations", Some(Scope::Read)),
            (&get, "/v1/jobs/1", Some(Scope::Read)),
            (&get, "/v1/jobs/1/task", Some(Scope::Worker)),
            (&get, "/v1/workers", Some(Scope::Read)),
            (&post, "/v1/workers", Some(Scope::Worker)),
            (&post, "/v1/workers/1/exchange", Some(Scope::Worker)),
            (&post, "/v1/workers/1/drain", Some(Scope::Admin)),
            (&post, "/v1/workers/1/disown", Some(Scope::Admin)),
            (&post, "/v1/workers/1/readmit", Some(Scope::Admin)),
            (&delete, "/v1/workers/1", Some(Scope::Worker)),
            (&post, "/no/such/route", Some(Scope::Submit)),
        ];
        for (method, path, expected) in cases {
            assert_eq!(required(method, path), expected, "{method} {path}");
        }
    }
}
