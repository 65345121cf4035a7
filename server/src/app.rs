//! All routes with what is common to them.

use std::sync::OnceLock;

use axum::Router;
use axum::extract::{Request, State};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::Response;

use crate::auth::guard;
use crate::error::ApiError;
use crate::http::headers;
use crate::routes;
use crate::state::AppState;

/// The whole service without a socket.
pub fn app(state: AppState) -> Router {
    static ROUTES: OnceLock<Router<AppState>> = OnceLock::new();
    ROUTES.get_or_init(all_routes).clone().layer(from_fn_with_state(state.clone(), gate)).with_state(state)
}

/// What every request and its answer go through: one layer, for each costs the queue some microseconds.
async fn gate(State(state): State<AppState>, request: Request, next: Next) -> Response {
    headers::complete(guard(&state, request, next).await)
}

/// The routes know nothing of a state yet; to describe them takes longer than to serve some requests.
fn all_routes() -> Router<AppState> {
    let (router, document) = routes::described();
    router
        .merge(routes::openapi::router(document))
        .merge(routes::page::router())
        .merge(routes::docs::router())
        .fallback(|| async { ApiError::NoRoute })
        .method_not_allowed_fallback(|| async { ApiError::MethodNotAllowed })
}
