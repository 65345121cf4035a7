//! A study's answer.

use axum::Json;
use axum::extract::State;
use manduca_protocol::ids::StudyId;
use manduca_protocol::problem::Problem;
use manduca_protocol::task::SimulateOutcome;
use manduca_protocol::view::{OptimumResult, OptimumView, SampleCounts, StudyResult, SurrogateErrors};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::error::ApiError;
use crate::http::parts::Id;
use crate::state::AppState;

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(optimum))
}

/// The optima found so far, predicted and flown again.
#[utoipa::path(get, path = "/v1/studies/{study}/optimum", tag = "studies", params(("study" = StudyId, Path)), responses(
    (status = 200, body = StudyResult),
    (status = 404, body = Problem, content_type = "application/problem+json"),
))]
async fn optimum(State(state): State<AppState>, Id(study): Id<StudyId>) -> Result<Json<StudyResult>, ApiError> {
    let store = state.store();
    let head = store.study_head(study).await?;
    let samples = store.sample_counts(head.study).await?;
    let test = store.test_errors_of(head.study).await?;
    let optima = store.optima(&head).await?;
    Ok(Json(StudyResult {
        study,
        state: head.state(),
        samples: SampleCounts { succeeded: samples.succeeded, infeasible: samples.infeasible, dead: samples.dead },
        surrogate: test.map(|test| SurrogateErrors { rmse: test.rmse }),
        optimisations: optima
            .into_iter()
            .zip(&head.spec.optimisations)
            .map(|(view, asked)| OptimumResult { clearance_margin_mm: Some(asked.clearance_margin_mm), ..flat(view) })
            .collect(),
        stages_s: store.stage_seconds(head.study, state.now_ms()).await?,
        solver_version: head.solver_version,
        disowned_results: store.disowned_results(head.study).await?,
    }))
}

fn flat(view: OptimumView) -> OptimumResult {
    let (simulated, power_per_lift_w_per_n, infeasible) = match view.simulated.map(|s| s.outcome) {
        Some(SimulateOutcome::Ok { scaled, power_per_lift_w_per_n, .. }) => {
            (Some(scaled), power_per_lift_w_per_n, None)
        }
        Some(SimulateOutcome::Infeasible { reason }) => (None, None, Some(reason)),
        None => (None, None, None),
    };
    OptimumResult {
        name: view.name,
        status: view.status,
        parameters: view.optimum.as_ref().map(|o| o.parameters),
        predicted: view.optimum.as_ref().map(|o| o.predicted),
        simulated,
        infeasible,
        power_per_lift_w_per_n,
        stopped: view.optimum.as_ref().map(|o| o.stopped.clone()),
        clearance_mm: view.optimum.as_ref().map(|o| o.clearance_mm),
        refined_clearance_mm: view.refined_clearance_mm,
        clearance_margin_mm: None,
        paper: view.paper,
        warnings: view.warnings,
        breeding: view.breeding,
        refined: view.search,
        optimality: view.optimum.and_then(|o| o.optimality),
    }
}
