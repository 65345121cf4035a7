//! Whether the process runs, and whether it can work.

use axum::Json;
use axum::extract::State;
use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::problem::Problem;
use manduca_protocol::worker::{OLDEST_PROTOCOL_VERSION, PROTOCOL_VERSION};
use serde::Serialize;
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::error::ApiError;
use crate::state::AppState;

/// The coordinator is well.
#[derive(Debug, Serialize, ToSchema)]
struct Health {
    /// Always `ok`; otherwise there is a problem instead.
    status: &'static str,
    /// Version of the numbers.
    solver_version: &'static str,
    /// Oldest version of the exchange which is taken.
    oldest_protocol_version: u32,
    /// Newest.
    protocol_version: u32,
}

const OK: Health = Health {
    status: "ok",
    solver_version: SOLVER_VERSION,
    oldest_protocol_version: OLDEST_PROTOCOL_VERSION,
    protocol_version: PROTOCOL_VERSION,
};

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(healthz)).routes(routes!(readyz))
}

/// The process answers.
#[utoipa::path(get, path = "/healthz", tag = "health", responses((status = 200, body = Health)))]
async fn healthz() -> Json<Health> {
    Json(OK)
}

/// The database answers too, takes writes, and its files are still there.
#[utoipa::path(get, path = "/readyz", tag = "health", responses(
    (status = 200, body = Health),
    (status = 503, body = Problem, content_type = "application/problem+json"),
))]
async fn readyz(State(state): State<AppState>) -> Result<Json<Health>, ApiError> {
    state.store().check()?;
    state.store().ping().await?;
    Ok(Json(OK))
}
