//! A study's optimisations, and further ones on its network.

use axum::Json;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use manduca_protocol::ids::StudyId;
use manduca_protocol::problem::{FieldProblem, Problem};
use manduca_protocol::resolve::{self, MAX_OPTIMISATIONS};
use manduca_protocol::study::{OptimisationSpec, StudySpec};
use manduca_protocol::view::OptimumView;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::auth::Caller;
use crate::config::RunLimits;
use crate::effort;
use crate::error::ApiError;
use crate::http::body::JsonBody;
use crate::http::parts::Id;
use crate::state::AppState;
use crate::store::{AddOptimisation, StoreError};

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(list, add)).routes(routes!(show))
}

/// Every optimisation of a study, in the order asked.
#[utoipa::path(get, path = "/v1/studies/{study}/optimisations", tag = "studies",
    params(("study" = StudyId, Path)),
    responses(
        (status = 200, body = Vec<OptimumView>),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
async fn list(State(state): State<AppState>, Id(study): Id<StudyId>) -> Result<Json<Vec<OptimumView>>, ApiError> {
    let head = state.store().study_head(study).await?;
    Ok(Json(state.store().optima(&head).await?))
}

/// One optimisation of a study.
#[utoipa::path(get, path = "/v1/studies/{study}/optimisations/{name}", tag = "studies",
    params(("study" = StudyId, Path), ("name" = String, Path)),
    responses(
        (status = 200, body = OptimumView),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
async fn show(
    State(state): State<AppState>,
    path: Result<Path<(String, String)>, PathRejection>,
) -> Result<Json<OptimumView>, ApiError> {
    let Path((study, name)) = path.map_err(|_| ApiError::NoRoute)?;
    let study: StudyId = study.parse().map_err(|_| ApiError::UnknownStudy(study))?;
    find(&state, study, &name).await.map(Json)
}

async fn find(state: &AppState, study: StudyId, name: &str) -> Result<OptimumView, ApiError> {
    let head = state.store().study_head(study).await?;
    let mut all = state.store().optima(&head).await?.into_iter();
    all.find(|o| o.name == name).ok_or_else(|| ApiError::UnknownOptimisation(name.to_owned()))
}

/// Asks a study which has ended for a further optimum. Nothing is sampled or trained again;
/// the optimum is flown like the others. A study without samples can be asked for `direct` ones.
///
/// The same optimisation asked for again is found, not repeated.
#[utoipa::path(post, path = "/v1/studies/{study}/optimisations", tag = "studies",
    params(("study" = StudyId, Path)),
    request_body(content = OptimisationSpec, example = json!({
        "name": "case-II", "parameters": { "stroke_plane_deg": 15.0, "elevation_amplitude_deg": [0.0, 7.0] },
    })),
    responses(
        (status = 201, body = OptimumView, headers(("Location" = String))),
        (status = 200, description = "Asked for before", body = OptimumView),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 409, body = Problem, content_type = "application/problem+json"),
        (status = 413, body = Problem, content_type = "application/problem+json"),
        (status = 415, body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    ))]
async fn add(
    State(state): State<AppState>,
    caller: Caller,
    Id(study): Id<StudyId>,
    JsonBody(spec): JsonBody<OptimisationSpec>,
) -> Result<Response, ApiError> {
    let head = state.store().study_head(study).await?;
    check(&spec, &head.spec, &state.config().run_limits)?;
    let name = spec.name.clone();
    let created = state.store().run(AddOptimisation { study, spec, by: caller.named() }).await?;
    let status = if created { StatusCode::CREATED } else { StatusCode::OK };
    let mut response = (status, Json(find(&state, study, &name).await?)).into_response();
    let place = format!("/v1/studies/{study}/optimisations/{}", escaped(&name));
    if let Ok(location) = HeaderValue::from_str(&place) {
        response.headers_mut().insert(header::LOCATION, location);
    }
    Ok(response)
}

/// Checks it inside the bounds of its study.
fn check(spec: &OptimisationSpec, asked: &StudySpec, limits: &RunLimits) -> Result<(), ApiError> {
    let corrupt = |faults: Vec<FieldProblem>| {
        let faults: Vec<_> = faults.iter().map(ToString::to_string).collect();
        ApiError::from(StoreError::Corrupt(faults.join("; ")))
    };
    let study = resolve::study(asked).map_err(corrupt)?;
    let mut faults = resolve::optimisation(spec, &study.bounds, asked.seed).err().unwrap_or_default();
    faults.extend(resolve::name(&spec.name, "/name"));
    faults.extend(effort::verification(spec, &study, limits, ""));
    if asked.sampling.samples == 0 && !spec.is_direct() {
        faults.push(FieldProblem::new(
            "/method",
            "needs a network, and a study without samples has none; `direct` does not",
        ));
    }
    let same = asked.optimisations.iter().find(|o| o.name == spec.name);
    if same.is_some_and(|same| same != spec) {
        faults.push(FieldProblem::new("/name", "is the name of another optimisation of this study"));
    } else if same.is_none() && asked.optimisations.len() >= MAX_OPTIMISATIONS {
        faults.push(FieldProblem::new("", format!("the study has {MAX_OPTIMISATIONS} optimisations, the most")));
    }
    if faults.is_empty() { Ok(()) } else { Err(ApiError::InvalidRequest(faults)) }
}

/// A name as a segment of a path.
fn escaped(name: &str) -> String {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b"-._~".contains(&b);
    name.bytes().map(|b| if plain(b) { char::from(b).to_string() } else { format!("%{b:02X}") }).collect()
}
