//! `/openapi.json`.

use axum::Router;
use axum::body::Bytes;
use axum::http::header;
use axum::routing::get;
use manduca_protocol::problem::Problem;
use utoipa::OpenApi;
use utoipa::openapi::path::Operation;
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{ContentBuilder, Ref, RefOr, ResponseBuilder};
use utoipa_axum::router::OpenApiRouter;

use crate::heavy::HEAVY;
use crate::state::AppState;

#[derive(OpenApi)]
#[openapi(
    info(
        title = "manduca",
        description = "Finds energy-optimal hovering kinematics. Submit a study, watch it, take its dataset, \
                       network and optima. Every refusal is problem+json (RFC 9457) with a stable `type` and a \
                       JSON pointer per field at fault."
    ),
    components(schemas(Problem))
)]
struct Document;

/// An empty router with the head of the document.
pub(super) fn described() -> OpenApiRouter<AppState> {
    OpenApiRouter::with_openapi(Document::openapi())
}

/// What any route may answer besides its own refusals.
const ANYWHERE: [(&str, &str); 4] = [
    ("401", "No valid token, where the coordinator asks for one"),
    ("403", "The token does not allow it, or a page of another site asks"),
    ("421", "The request is for another host, where no tokens are asked for"),
    ("503", "The coordinator cannot answer now; `Retry-After` says when to ask again"),
];
/// What a route with a body may answer besides.
const WITH_BODY: [(&str, &str); 5] = [
    ("400", "Not JSON"),
    ("408", "The body did not arrive in time"),
    ("413", "The body is too large"),
    ("415", "The body is not declared as JSON"),
    ("422", "The body is not what the route takes"),
];

/// Adds what is common to all routes: refusals, and the token.
pub(super) fn complete(document: &mut utoipa::openapi::OpenApi) {
    for (path, item) in &mut document.paths.paths {
        if path == "/healthz" || path == "/readyz" {
            continue;
        }
        for operation in [&mut item.get, &mut item.post, &mut item.delete].into_iter().flatten() {
            ANYWHERE.iter().for_each(|(status, meaning)| refusal(operation, status, meaning));
            if HEAVY.contains(&path.as_str()) {
                refusal(operation, "429", "Too many such reads wait; `Retry-After` says when to ask again");
            }
            if operation.request_body.is_some() {
                WITH_BODY.iter().for_each(|(status, meaning)| refusal(operation, status, meaning));
            } else if operation.parameters.as_ref().is_some_and(|p| !p.is_empty()) {
                refusal(operation, "400", "The query string is not what the route takes");
            }
        }
    }
    let token = HttpBuilder::new()
        .scheme(HttpAuthScheme::Bearer)
        .description(Some("A token of `manduca token create`; none is needed on loopback"));
    let components = document.components.get_or_insert_default();
    components.security_schemes.insert("token".into(), SecurityScheme::Http(token.build()).into());
    document.security = Some(vec![SecurityRequirement::default(), SecurityRequirement::new("token", [""; 0])]);
}

/// Adds a refusal, unless the route describes it itself.
fn refusal(operation: &mut Operation, status: &str, meaning: &str) {
    let problem = ContentBuilder::new().schema(Some(Ref::from_schema_name("Problem"))).build();
    let response = ResponseBuilder::new().description(meaning).content("application/problem+json", problem).build();
    operation.responses.responses.entry(status.into()).or_insert(RefOr::T(response));
}

/// Serves the document, which does not describe itself.
pub(crate) fn router(document: utoipa::openapi::OpenApi) -> Router<AppState> {
    // Nothing in a document of literals fails to serialise; an empty one would show in the tests.
    let json = Bytes::from(document.to_json().unwrap_or_default());
    Router::new()
        .route("/openapi.json", get(move || async move { ([(header::CONTENT_TYPE, "application/json")], json) }))
}
