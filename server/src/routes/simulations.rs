//! One stroke, flown while the client waits.

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use manduca_protocol::flight::{SimulationRequest, SimulationView};
use manduca_protocol::problem::{FieldProblem, Problem};
use manduca_protocol::study::ModelSpec;
use manduca_protocol::task::SimulateTask;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::error::ApiError;
use crate::fair::Asker;
use crate::http::body::JsonBody;
use crate::look::Asked;
use crate::state::AppState;
use crate::store::StoreError;

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(fly))
}

/// Flies one stroke and answers with its means, its last stroke step by step, and the wake asked for.
///
/// Nothing is stored and no worker is needed. Its means are those a sample of a study with the same model and
/// parameters has, bit for bit. One stroke flies at a time; when too many wait, 429 says when to come again.
#[utoipa::path(post, path = "/v1/simulations", tag = "simulations", 
    request_body(content = SimulationRequest, example = json!({ "wake": "last", "parameters": {
        "frequency_hz": 25.3, "stroke_plane_deg": 0.9, "sweep_mean_deg": -4.2, "elevation_mean_deg": 15.8,
        "rotation_mean_deg": 1.0, "sweep_amplitude_deg": 60.0, "elevation_amplitude_deg": 0.0,
        "rotation_amplitude_deg": 60.0, "sweep_shape": 0.0, "rotation_shape": 1.0,
    } })),
    responses(
        (status = 200, body = SimulationView),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 413, body = Problem, content_type = "application/problem+json"),
        (status = 415, body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 429, body = Problem, content_type = "application/problem+json", headers(("Retry-After" = u64))),
        (status = 503, body = Problem, content_type = "application/problem+json", headers(("Retry-After" = u64))),
    ))]
async fn fly(
    State(state): State<AppState>,
    asker: Asker,
    JsonBody(request): JsonBody<SimulationRequest>,
) -> Result<Response, ApiError> {
    let asked = asked(&state, request).await?;
    let answer = state.turns().take(asked.key(), asker, state.stopping(), move |on| asked.fly(on)).await?;
    Ok(([(header::CONTENT_TYPE, "application/json")], answer).into_response())
}

async fn asked(state: &AppState, request: SimulationRequest) -> Result<Asked, ApiError> {
    let refused = |pointer: &str, why: String| ApiError::InvalidRequest(vec![FieldProblem::new(pointer, why)]);
    let SimulationRequest { study, model, parameters, wake } = request;
    let (model, at) = match (study, model) {
        (Some(_), Some(_)) => return Err(refused("/model", "is given beside a study, which has its own".into())),
        (None, given) => (given.unwrap_or_else(ModelSpec::default), "/model"),
        (Some(study), None) => {
            let head = state.store().study_head(study).await.map_err(|error| match error {
                StoreError::UnknownStudy(id) => refused("/study", format!("there is no study {id}")),
                other => other.into(),
            })?;
            (head.spec.model, "/study")
        }
    };
    Asked::new(SimulateTask { model, parameters }, wake, at).map_err(ApiError::InvalidRequest)
}
