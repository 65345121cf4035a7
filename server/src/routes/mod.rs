//! The routes, each file with its own `router()`.

mod control;
mod dataset;
pub(crate) mod docs;
mod events;
mod exchange;
mod front;
mod health;
mod jobs;
pub(crate) mod openapi;
mod optimisations;
mod optimum;
mod overview;
pub(crate) mod page;
mod simulations;
mod studies;
mod submit;
mod surrogate;
mod training;
mod watch;
mod workers;

use utoipa_axum::router::OpenApiRouter;

use crate::state::AppState;

/// All documented routes: what is served and what `/openapi.json` says come from
/// the same list.
fn all() -> OpenApiRouter<AppState> {
    openapi::described()
        .merge(submit::router())
        .merge(studies::router())
        .merge(control::router())
        .merge(jobs::router())
        .merge(dataset::router())
        .merge(surrogate::router())
        .merge(front::router())
        .merge(optimisations::router())
        .merge(optimum::router())
        .merge(simulations::router())
        .merge(workers::router())
        .merge(exchange::router())
        .merge(watch::router())
        .merge(overview::router())
        .merge(events::router())
        .merge(health::router())
}

/// All routes, and the OpenAPI document of them.
pub(crate) fn described() -> (axum::Router<AppState>, utoipa::openapi::OpenApi) {
    let (router, mut document) = all().split_for_parts();
    openapi::complete(&mut document);
    (router, document)
}

/// The OpenAPI document of all routes.
pub fn document() -> utoipa::openapi::OpenApi {
    described().1
}
