//! All routes with what is common to them.

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::middleware::from_fn_with_state;

use crate::auth::guard;
use crate::error::ApiError;
use crate::routes;
use crate::state::AppState;

/// The whole service without a socket.
pub fn app(state: AppState) -> Router {
    let (router, document) = routes::described();
    router
        .merge(routes::openapi::router(document))
        .merge(routes::page::router())
        .merge(routes::docs::router())
        .fallback(|| async { ApiError::NoRoute })
        .method_not_allowed_fallback(|| async { ApiError::MethodNotAllowed })
        .layer(from_fn_with_state(state.clone(), guard))
        // Bodies are read with limits of their own, route by route.
        .layer(DefaultBodyLimit::disable())
        .with_state(state)
}
