//! Studies are listed and looked at.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use manduca_protocol::ids::StudyId;
use manduca_protocol::problem::Problem;
use manduca_protocol::view::{Page, StageSeconds, StudyState, StudySummary, StudyView};
use serde::Deserialize;
use utoipa::IntoParams;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::error::ApiError;
use crate::http::parts::{Id, Params};
use crate::http::{cursor, etag};
use crate::state::AppState;
use crate::store::open_jobs;

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(list)).routes(routes!(show))
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct ListParams {
    /// Only studies in this state.
    #[param(inline)]
    state: Option<StudyState>,
    /// Where the page begins, from the page before.
    cursor: Option<String>,
    /// Items at most, 1 to 1000; 100 where left out.
    limit: Option<u32>,
}

/// Lists studies, newest first.
#[utoipa::path(get, path = "/v1/studies", tag = "studies", params(ListParams), responses(
    (status = 200, body = Page<StudySummary>),
    (status = 400, body = Problem, content_type = "application/problem+json"),
))]
async fn list(
    State(state): State<AppState>,
    Params(params): Params<ListParams>,
) -> Result<Json<Page<StudySummary>>, ApiError> {
    let limit = cursor::limit(params.limit)?;
    let before = match &params.cursor {
        Some(cursor) => {
            cursor::decode(cursor)?.parse().map_err(|_| ApiError::query("/cursor", "is not a cursor of this list"))?
        }
        None => i64::MAX,
    };
    // One more than asked for tells whether there is a next page.
    let mut rows = state.store().studies(params.state.map(StudyState::name), before, limit + 1).await?;
    let more = rows.len() > limit as usize;
    rows.truncate(limit as usize);
    let next_cursor = rows.last().filter(|_| more).map(|(number, _)| cursor::encode(&number.to_string()));
    Ok(Json(Page { items: rows.into_iter().map(|(_, summary)| summary).collect(), next_cursor }))
}

/// Shows a study. Its ETag changes with what is stored, not with mere time.
#[utoipa::path(get, path = "/v1/studies/{study}", tag = "studies",
    params(("study" = StudyId, Path), ("If-None-Match" = Option<String>, Header)),
    responses(
        (status = 200, body = StudyView, headers(("ETag" = String))),
        (status = 304, description = "As it was"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
async fn show(State(state): State<AppState>, Id(study): Id<StudyId>, headers: HeaderMap) -> Result<Response, ApiError> {
    let view = view(&state, study).await?;
    let stable = StudyView { rate_per_s: None, eta_s: None, stages_s: StageSeconds::default(), ..view.clone() };
    let stable = serde_json::to_vec(&stable).map_err(|e| ApiError::Internal(Box::new(e)))?;
    let tag = etag::of(&stable);
    if etag::matches(&headers, &tag) {
        return Ok((StatusCode::NOT_MODIFIED, [(header::ETAG, tag)]).into_response());
    }
    Ok(([(header::ETAG, tag)], Json(view)).into_response())
}

/// A study with its rate and the time it still needs.
pub(super) async fn view(state: &AppState, study: StudyId) -> Result<StudyView, ApiError> {
    let now = state.now_ms();
    let mut view = state.store().study(study, now).await?;
    let moves = matches!(
        view.state,
        StudyState::Sampling
            | StudyState::Training
            | StudyState::Optimising
            | StudyState::Verifying
            | StudyState::Refining
    );
    if moves {
        view.rate_per_s = state.rates().per_second(study, now);
        // Of generations more is known than what is queued by now.
        let flies = view.state == StudyState::Optimising && view.spec.optimisations.iter().any(|o| o.is_direct());
        let left = match &view.progress {
            Some(flown) if flies => flown.total.saturating_sub(flown.done),
            _ => open_jobs(&view.stage_jobs),
        };
        view.eta_s = view.rate_per_s.map(|rate| left as f64 / rate);
    }
    Ok(view)
}
