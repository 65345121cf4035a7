//! Studies are paused, resumed, cancelled, and their failed jobs tried again.

use axum::Json;
use axum::extract::State;
use manduca_protocol::ids::StudyId;
use manduca_protocol::problem::Problem;
use manduca_protocol::view::StudyView;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::studies::view;
use crate::auth::Caller;
use crate::error::ApiError;
use crate::http::parts::Id;
use crate::state::AppState;
use crate::store::{Action, Control};

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(pause))
        .routes(routes!(resume))
        .routes(routes!(cancel))
        .routes(routes!(retry_failed))
}

async fn control(
    state: &AppState,
    caller: &Caller,
    study: StudyId,
    action: Action,
) -> Result<Json<StudyView>, ApiError> {
    state.store().run(Control { study, action, by: caller.named() }).await?;
    Ok(Json(view(state, study).await?))
}

/// Gives out no further jobs of a study; what runs may finish.
#[utoipa::path(post, path = "/v1/studies/{study}/pause", tag = "studies", params(("study" = StudyId, Path)), responses(
    (status = 200, body = StudyView),
    (status = 404, body = Problem, content_type = "application/problem+json"),
    (status = 409, body = Problem, content_type = "application/problem+json"),
))]
async fn pause(
    State(state): State<AppState>,
    caller: Caller,
    Id(study): Id<StudyId>,
) -> Result<Json<StudyView>, ApiError> {
    control(&state, &caller, study, Action::Pause).await
}

/// Sets a paused study going again.
#[utoipa::path(post, path = "/v1/studies/{study}/resume", tag = "studies", params(("study" = StudyId, Path)), responses(
    (status = 200, body = StudyView),
    (status = 404, body = Problem, content_type = "application/problem+json"),
    (status = 409, body = Problem, content_type = "application/problem+json"),
))]
async fn resume(
    State(state): State<AppState>,
    caller: Caller,
    Id(study): Id<StudyId>,
) -> Result<Json<StudyView>, ApiError> {
    control(&state, &caller, study, Action::Resume).await
}

/// Ends a study for good.
#[utoipa::path(post, path = "/v1/studies/{study}/cancel", tag = "studies", params(("study" = StudyId, Path)), responses(
    (status = 200, body = StudyView),
    (status = 404, body = Problem, content_type = "application/problem+json"),
    (status = 409, body = Problem, content_type = "application/problem+json"),
))]
async fn cancel(
    State(state): State<AppState>,
    caller: Caller,
    Id(study): Id<StudyId>,
) -> Result<Json<StudyView>, ApiError> {
    control(&state, &caller, study, Action::Cancel).await
}

/// Tries the jobs given up again; a failed study returns to their stage.
#[utoipa::path(post, path = "/v1/studies/{study}/retry-failed", tag = "studies", params(("study" = StudyId, Path)), responses(
    (status = 200, body = StudyView),
    (status = 404, body = Problem, content_type = "application/problem+json"),
    (status = 409, body = Problem, content_type = "application/problem+json"),
))]
async fn retry_failed(
    State(state): State<AppState>,
    caller: Caller,
    Id(study): Id<StudyId>,
) -> Result<Json<StudyView>, ApiError> {
    control(&state, &caller, study, Action::RetryFailed).await
}
