//! What let a request in, asked again for as long as the request waits or its answer streams.

use std::time::Duration;

use axum::body::{Body, Bytes, HttpBody};
use axum::http::header;
use axum::response::Response;
use futures_util::StreamExt;
use futures_util::stream::{self, BoxStream};

use super::{Scope, TokenHash};
use crate::state::AppState;

/// Between two looks at the tokens.
const LOOK: Duration = Duration::from_millis(500);

/// What let a request in.
#[derive(Debug, Clone)]
pub(crate) struct Pass(Option<(TokenHash, Scope)>);

/// The token that an answer was asked with allows it no longer.
#[derive(Debug, thiserror::Error)]
#[error("the token was revoked while the answer was sent")]
struct Revoked;

type Parts = BoxStream<'static, Result<Bytes, axum::Error>>;

impl Pass {
    /// One that never ends: no token was asked for, or one that is given for as long as the coordinator runs.
    pub(crate) fn open() -> Self {
        Self(None)
    }

    /// One that holds while a token of the database allows a scope.
    pub(crate) fn of(token: TokenHash, scope: Scope) -> Self {
        Self(Some((token, scope)))
    }

    /// Whether it holds at this moment. Where the tokens cannot be read it is taken to hold: a disk that fails is
    /// no revocation, and what is asked for next fails by itself.
    pub(crate) async fn holds(&self, state: &AppState) -> bool {
        let Some((token, scope)) = &self.0 else { return true };
        let bearer = state.tokens().bearer_now(token, state.store()).await;
        bearer.map_or(true, |bearer| bearer.is_some_and(|bearer| bearer.allows(*scope)))
    }

    /// Resolves within two seconds after it has ceased to hold.
    pub(crate) async fn ended(&self, state: &AppState) {
        let Some((token, scope)) = &self.0 else { return std::future::pending().await };
        loop {
            tokio::time::sleep(LOOK).await;
            // Many requests wait at the same time: they share one reading a second.
            let bearer = state.tokens().bearer_lately(token, state.store()).await;
            if bearer.is_ok_and(|bearer| bearer.is_none_or(|bearer| !bearer.allows(*scope))) {
                return;
            }
        }
    }

    /// Ends an answer that streams when the pass no longer holds. Events end as they do when the coordinator stops;
    /// anything else breaks off, so that a part is not taken for the whole.
    pub(super) fn watch_over(self, response: Response, state: &AppState) -> Response {
        if self.0.is_none() || response.body().size_hint().exact().is_some() {
            return response;
        }
        let content_type = response.headers().get(header::CONTENT_TYPE);
        let is_events = content_type.is_some_and(|value| value.as_bytes().starts_with(b"text/event-stream"));
        let state = state.clone();
        response.map(|body| {
            let parts: Parts = body.into_data_stream().boxed();
            let watched = stream::unfold((Some(parts), self, state), move |(parts, pass, state)| async move {
                let mut parts = parts?;
                let part = tokio::select! {
                    part = parts.next() => Some(part?),
                    () = pass.ended(&state) => None,
                };
                match part {
                    Some(part) if pass.holds(&state).await => Some((part, (Some(parts), pass, state))),
                    _ if is_events => None,
                    _ => Some((Err(axum::Error::new(Revoked)), (None, pass, state))),
                }
            });
            Body::from_stream(watched)
        })
    }
}
