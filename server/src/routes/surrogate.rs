//! A study's network: how it was trained, and what it predicts.

use axum::Json;
use axum::extract::State;
use manduca_protocol::ids::StudyId;
use manduca_protocol::problem::{FieldProblem, Problem};
use manduca_protocol::task::{Scaled, SurrogateMessage};
use manduca_protocol::view::{PredictionRequest, PredictionResponse, SurrogateView};
use manduca_protocol::{network, resolve};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::error::ApiError;
use crate::http::body::JsonBody;
use crate::http::parts::Id;
use crate::prepare::running;
use crate::state::AppState;
use crate::store::StoreError;

/// Most points of one request.
const MOST_POINTS: usize = 1000;
const NOT_YET: ApiError = ApiError::NotYet("the study has no network yet");

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(show)).routes(routes!(model)).routes(routes!(predict))
}

/// The training curve and the errors on each share of the samples; while it trains, the curve so far.
#[utoipa::path(get, path = "/v1/studies/{study}/surrogate", tag = "studies", params(("study" = StudyId, Path)), responses(
    (status = 200, body = SurrogateView),
    (status = 404, body = Problem, content_type = "application/problem+json"),
))]
async fn show(State(state): State<AppState>, Id(study): Id<StudyId>) -> Result<Json<SurrogateView>, ApiError> {
    let study = state.store().study_number(study).await?;
    if let Some(done) = state.store().surrogate_of(study).await? {
        return Ok(Json(done));
    }
    let under_way = state.store().checkpoint_of(study).await?;
    under_way.map(|at| Json(running(*at))).ok_or(NOT_YET)
}

/// The surrogate itself, with all its numbers: what asks more of it than predictions computes with it elsewhere.
#[utoipa::path(get, path = "/v1/studies/{study}/surrogate/model", tag = "studies", params(("study" = StudyId, Path)),
    responses(
        (status = 200, body = SurrogateMessage),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
async fn model(State(state): State<AppState>, Id(study): Id<StudyId>) -> Result<Json<SurrogateMessage>, ApiError> {
    let study = state.store().study_number(study).await?;
    Ok(Json(state.store().training_of(study).await?.ok_or(NOT_YET)?.surrogate))
}

/// What the network predicts for strokes.
#[utoipa::path(post, path = "/v1/studies/{study}/surrogate/predictions", tag = "studies",
    params(("study" = StudyId, Path)), request_body = PredictionRequest,
    responses(
        (status = 200, body = PredictionResponse),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 413, body = Problem, content_type = "application/problem+json"),
        (status = 415, body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    ))]
async fn predict(
    State(state): State<AppState>,
    Id(study): Id<StudyId>,
    JsonBody(request): JsonBody<PredictionRequest>,
) -> Result<Json<PredictionResponse>, ApiError> {
    check(&request)?;
    let study = state.store().study_number(study).await?;
    let training = state.store().training_of(study).await?.ok_or(NOT_YET)?;
    let surrogate = network::surrogate(&training.surrogate).map_err(|why| ApiError::from(StoreError::Corrupt(why)))?;
    let predict = |point: &manduca_protocol::point::ParameterValues| {
        let [lift, drag, pitch_moment, power] = surrogate.predict(&point.0);
        Scaled { lift, drag, pitch_moment, power }
    };
    Ok(Json(PredictionResponse { predictions: request.points.iter().map(predict).collect() }))
}

fn check(request: &PredictionRequest) -> Result<(), ApiError> {
    if request.points.len() > MOST_POINTS {
        let fault = FieldProblem::new("/points", format!("has more than {MOST_POINTS} points"));
        return Err(ApiError::InvalidRequest(vec![fault]));
    }
    let faults: Vec<_> = request
        .points
        .iter()
        .enumerate()
        .filter_map(|(i, point)| resolve::parameters(point, &format!("/points/{i}")).err())
        .flatten()
        .collect();
    if faults.is_empty() { Ok(()) } else { Err(ApiError::InvalidRequest(faults)) }
}
