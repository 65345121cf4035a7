//! A study's network: how it was trained, and what it predicts.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use manduca_numerics::parameters::{Bounds, TABLE};
use manduca_numerics::surrogate::Surrogate;
use manduca_protocol::ids::StudyId;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::problem::{FieldProblem, Problem, bounded};
use manduca_protocol::task::{Checkpoint, Scaled, SurrogateMessage};
use manduca_protocol::view::{OutsideBox, PredictionRequest, PredictionResponse, SurrogateView};
use manduca_protocol::{network, resolve};
use serde::Deserialize;
use utoipa::IntoParams;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::error::ApiError;
use crate::fair::Asker;
use crate::http::body::JsonBody;
use crate::http::parts::{Id, Params, media_ranges};
use crate::onnx;
use crate::prepare::running;
use crate::state::AppState;
use crate::store::StoreError;

/// Media type of an ONNX model.
const ONNX: &str = "application/onnx";
/// Most points of one request.
const MOST_POINTS: usize = 1000;
pub(super) const NOT_YET: ApiError = ApiError::NotYet("the study has no network yet");

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
        let disowned_results = state.store().disowned_results(study).await?;
        return Ok(Json(SurrogateView { disowned_results, ..done }));
    }
    match state.store().checkpoint_of(study).await? {
        Some(Checkpoint::Train(at)) => Ok(Json(running(*at))),
        // The fit of a gaussian process has no curve.
        Some(Checkpoint::Fit(_)) | None => Err(NOT_YET),
    }
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct ModelParams {
    /// `json` or `onnx`; the Accept header decides where left out.
    format: Option<String>,
}

/// The surrogate itself, with all its numbers: what asks more of it than predictions computes with it elsewhere.
///
/// As ONNX (opset 17, double precision) it is the whole function: a table `parameters` of the ten parameters, a row
/// per stroke in the order of the schema, to a table `means` of L+, D+, M+, P+. A gaussian process has no such form.
#[utoipa::path(get, path = "/v1/studies/{study}/surrogate/model", tag = "studies", params(("study" = StudyId, Path)),
    responses(
        (status = 200, content((SurrogateMessage = "application/json"), (String = "application/onnx"))),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 406, body = Problem, content_type = "application/problem+json"),
    ))]
async fn model(
    State(state): State<AppState>,
    Id(study): Id<StudyId>,
    Params(params): Params<ModelParams>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let as_onnx = as_onnx(params.format.as_deref(), &headers)?;
    let head = state.store().study_head(study).await?;
    let message = state.store().training_of(head.study).await?.ok_or(NOT_YET)?.surrogate;
    if !as_onnx {
        return Ok(Json(message).into_response());
    }
    let surrogate = network::surrogate(&message).map_err(|why| ApiError::from(StoreError::Corrupt(why)))?;
    let facts = [("study", study.to_string()), ("solver_version", head.solver_version)];
    let none = ApiError::NotAcceptable { offered: "application/json alone: a gaussian process has no ONNX form here" };
    let bounds = resolve::study(&head.spec)
        .map_err(|_| ApiError::from(StoreError::Corrupt("the study's bounds".into())))?
        .bounds;
    let file = onnx::model(&surrogate, &bounds, &head.spec.name, &facts).ok_or(none)?;
    Ok(([(header::CONTENT_TYPE, ONNX)], file).into_response())
}

/// Which of the two forms is asked for.
fn as_onnx(asked: Option<&str>, headers: &HeaderMap) -> Result<bool, ApiError> {
    match asked {
        Some("json") => return Ok(false),
        Some("onnx") => return Ok(true),
        Some(other) => return Err(ApiError::query("/format", format!("`{other}` is neither json nor onnx"))),
        None => {}
    }
    let Some(accept) = headers.get(header::ACCEPT).and_then(|value| value.to_str().ok()) else { return Ok(false) };
    let known = media_ranges(accept).find_map(|range| match range {
        "application/json" | "application/*" | "*/*" => Some(false),
        ONNX => Some(true),
        _ => None,
    });
    known.ok_or(ApiError::NotAcceptable { offered: "application/json and application/onnx" })
}

/// What the network predicts for strokes.
#[utoipa::path(post, path = "/v1/studies/{study}/surrogate/predictions", tag = "studies",
    params(("study" = StudyId, Path)), 
    request_body(content = PredictionRequest, example = json!({ "points": [{
        "frequency_hz": 25.3, "stroke_plane_deg": 0.9, "sweep_mean_deg": -4.2, "elevation_mean_deg": 15.8,
        "rotation_mean_deg": 1.0, "sweep_amplitude_deg": 60.0, "elevation_amplitude_deg": 0.0,
        "rotation_amplitude_deg": 60.0, "sweep_shape": 0.0, "rotation_shape": 1.0,
    }] })),
    responses(
        (status = 200, body = PredictionResponse),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 413, body = Problem, content_type = "application/problem+json"),
        (status = 415, body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 429, body = Problem, content_type = "application/problem+json", headers(("Retry-After" = u64))),
        (status = 503, body = Problem, content_type = "application/problem+json", headers(("Retry-After" = u64))),
    ))]
async fn predict(
    State(state): State<AppState>,
    asker: Asker,
    Id(study): Id<StudyId>,
    JsonBody(request): JsonBody<PredictionRequest>,
) -> Result<Json<PredictionResponse>, ApiError> {
    check(&request)?;
    let head = state.store().study_head(study).await?;
    let turn = state.heavy().turn(asker).await?;
    let surrogate = read(&state, head.study).await?;
    let test_rmse = state.store().test_errors_of(head.study).await?.map(|test| test.rmse);
    let predicting = tokio::task::spawn_blocking(move || {
        let predict = |point: &ParameterValues| {
            let [lift, drag, pitch_moment, power] = surrogate.predict(&point.0);
            Scaled { lift, drag, pitch_moment, power }
        };
        let predictions = request.points.iter().map(predict).collect();
        // Of a study which cannot be read any more the box is not known.
        let box_of = resolve::study(&head.spec).map(|study| study.bounds);
        let outside = box_of.map_or_else(|_| Vec::new(), |bounds| outside(&bounds, &request.points));
        drop(turn);
        PredictionResponse { predictions, by: Some(PredictionResponse::BY.into()), test_rmse, outside }
    });
    Ok(Json(predicting.await.map_err(|e| ApiError::Internal(Box::new(e)))?))
}

/// A study's surrogate, read in the asker's turn.
pub(super) async fn surrogate(state: &AppState, asker: Asker, study: i64) -> Result<Surrogate, ApiError> {
    let _turn = state.heavy().turn(asker).await?;
    read(state, study).await
}

async fn read(state: &AppState, study: i64) -> Result<Surrogate, ApiError> {
    let training = state.store().training_of(study).await?.ok_or(NOT_YET)?;
    let made = tokio::task::spawn_blocking(move || network::surrogate(&training.surrogate)).await;
    let made = made.map_err(|e| ApiError::Internal(Box::new(e)))?;
    made.map_err(|why| ApiError::from(StoreError::Corrupt(why)))
}

/// Which points lie beyond the box a surrogate was trained in, and in what. What only follows the exact laws, as tilt
/// and frequency do, counts too: the study did not look there.
fn outside(bounds: &Bounds, points: &[ParameterValues]) -> Vec<OutsideBox> {
    let beyond = |point: &ParameterValues| -> Vec<String> {
        let out = |i: &usize| !(bounds.lower[*i]..=bounds.upper[*i]).contains(&point.0[*i]);
        (0..TABLE.len()).filter(out).map(|i| TABLE[i].name.to_owned()).collect()
    };
    let all = (0_u32..).zip(points).map(|(point, x)| OutsideBox { point, parameters: beyond(x) });
    all.filter(|found| !found.parameters.is_empty()).collect()
}

fn check(request: &PredictionRequest) -> Result<(), ApiError> {
    if request.points.len() > MOST_POINTS {
        let fault = FieldProblem::new("/points", format!("has more than {MOST_POINTS} points"));
        return Err(ApiError::InvalidRequest(vec![fault]));
    }
    let faults = request
        .points
        .iter()
        .enumerate()
        .filter_map(|(i, point)| resolve::parameters(point, &format!("/points/{i}")).err())
        .flatten();
    let faults = bounded(faults);
    if faults.is_empty() { Ok(()) } else { Err(ApiError::InvalidRequest(faults)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_beyond_the_box_are_named() {
        let mut bounds = Bounds::default();
        (bounds.lower[6], bounds.upper[6]) = (0.0, 0.0);
        let inside = bounds.from_unit(&[0.5; 10]);
        let (mut far, mut lifted) = (inside, inside);
        (far[0], far[9]) = (41.0, -0.1);
        lifted[6] = 3.0;
        let found = outside(&bounds, &[inside, far, bounds.upper, lifted].map(ParameterValues));
        let told: Vec<_> = found.iter().map(|o| (o.point, o.parameters.join(" "))).collect();
        assert_eq!(told, [(1, "frequency_hz rotation_shape".to_owned()), (3, "elevation_amplitude_deg".to_owned())]);
    }
}
