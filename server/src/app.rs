//! All routes with what is common to them.

use std::sync::OnceLock;

use axum::Router;
use axum::middleware::{from_fn_with_state, map_response};

use crate::auth::guard;
use crate::error::ApiError;
use crate::heavy::heavy;
use crate::http::headers;
use crate::routes;
use crate::state::AppState;

/// The whole service without a socket.
pub fn app(state: AppState) -> Router {
    static ROUTES: OnceLock<Router<AppState>> = OnceLock::new();
    ROUTES
        .get_or_init(all_routes)
        .clone()
        .layer(from_fn_with_state(state.clone(), heavy))
        .layer(from_fn_with_state(state.clone(), guard))
        .layer(map_response(headers::complete))
        .with_state(state)
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
