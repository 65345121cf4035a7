//! A study comes in.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use manduca_protocol::ids::StudyId;
use manduca_protocol::problem::{FieldProblem, Problem};
use manduca_protocol::study::StudySpec;
use manduca_protocol::view::{DryRun, StudyView};
use serde::Deserialize;
use utoipa::IntoParams;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::studies::view;
use crate::auth::Caller;
use crate::check::{Checked, check};
use crate::error::ApiError;
use crate::fair::Asker;
use crate::http::body::JsonBody;
use crate::http::parts::Params;
use crate::state::AppState;
use crate::store::{Submit, Submitted};

/// Longest Idempotency-Key, bytes.
const LONGEST_KEY: usize = 255;

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(submit))
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct SubmitParams {
    /// Only say whether it would be accepted.
    #[serde(default)]
    dry_run: bool,
}

/// Submits a study, or with `dry_run` asks whether it would be accepted.
///
/// The same study under the same Idempotency-Key is submitted once.
#[utoipa::path(post, path = "/v1/studies", tag = "studies",
    params(
        SubmitParams,
        ("Idempotency-Key" = Option<String>, Header, description = "Makes a repeated submission find the first"),
    ),
    request_body(content(
        (StudySpec = "application/json", example = json!({
            "name": "quick", "seed": 1, "parameters": { "frequency_hz": [20.0, 35.0], "elevation_amplitude_deg": 0.0 },
            "sampling": { "samples": 500 }, "surrogate": { "neurons": 40 },
            "optimisations": [{ "name": "case-I" }],
        })),
        (StudySpec = "application/toml", example = json!("name = \"quick\"\nseed = 1\n\n[sampling]\nsamples = 500\n")),
    )),
    responses(
        (status = 201, body = StudyView, headers(("Location" = String))),
        (status = 200, description = "Submitted before under this key, or a dry run", body = DryRun),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 413, body = Problem, content_type = "application/problem+json"),
        (status = 415, body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 429, body = Problem, content_type = "application/problem+json", headers(("Retry-After" = u64))),
        (status = 503, body = Problem, content_type = "application/problem+json"),
    ))]
async fn submit(
    State(state): State<AppState>,
    caller: Caller,
    asker: Asker,
    Params(params): Params<SubmitParams>,
    headers: HeaderMap,
    body: Result<JsonBody<StudySpec>, ApiError>,
) -> Result<Response, ApiError> {
    if params.dry_run {
        return Ok(Json(dry_run(&state, asker, body).await?).into_response());
    }
    let JsonBody(spec) = body?;
    let submitted = store(&state, (caller, asker), spec, idempotency_key(&headers)?).await?;
    let status = if submitted.created { StatusCode::CREATED } else { StatusCode::OK };
    let mut response = (status, Json(view(&state, submitted.id).await?)).into_response();
    if let Ok(location) = HeaderValue::from_str(&format!("/v1/studies/{}", submitted.id)) {
        response.headers_mut().insert(header::LOCATION, location);
    }
    Ok(response)
}

fn idempotency_key(headers: &HeaderMap) -> Result<Option<String>, ApiError> {
    let Some(value) = headers.get("idempotency-key") else { return Ok(None) };
    let key = value.to_str().ok().filter(|key| (1..=LONGEST_KEY).contains(&key.len()));
    let refused = || {
        let why = format!("must be 1 to {LONGEST_KEY} printable ASCII characters");
        ApiError::InvalidRequest(vec![FieldProblem::new("/headers/idempotency-key", why)])
    };
    key.map(|key| Some(key.to_owned())).ok_or_else(refused)
}

async fn store(
    state: &AppState,
    (caller, asker): (Caller, Asker),
    spec: StudySpec,
    idempotency_key: Option<String>,
) -> Result<Submitted, ApiError> {
    // Canonical: parsed and written again, so that spelling and order in the body do not matter.
    let canonical = serde_json::to_string(&spec).map_err(|e| ApiError::Internal(Box::new(e)))?;
    let digest = *blake3::hash(canonical.as_bytes()).as_bytes();
    if let Some(key) = &idempotency_key
        && let Some(id) = state.store().study_by_idempotency_key(key, &digest).await?
    {
        return Ok(Submitted { id, created: false });
    }
    let fresh = spec.fresh;
    let (name, samples, optimisations) = (spec.name.clone(), spec.sampling.samples, spec.optimisations.len());
    let _turn = state.heavy().drawing(samples, asker).await?;
    let drawn = checked(state, spec).await?.map_err(ApiError::InvalidStudy)?.drawn;
    let mut secret = [0; 32];
    getrandom::fill(&mut secret).map_err(|e| ApiError::Internal(Box::new(e)))?;
    let submit = Submit {
        id: StudyId::new(),
        name,
        spec: canonical,
        digest,
        samples,
        optimisations,
        idempotency_key,
        by: caller.named(),
        drawn,
        fresh,
        secret,
    };
    Ok(state.store().run(submit).await?)
}

/// A study checked, or its faults: not on the threads which serve.
async fn checked(state: &AppState, spec: StudySpec) -> Result<Result<Checked, Vec<FieldProblem>>, ApiError> {
    let limits = state.config().run_limits;
    let task = tokio::task::spawn_blocking(move || check(&spec, &limits));
    task.await.map_err(|e| ApiError::Internal(Box::new(e)))
}

/// Faults are the answer here, not a refusal, whether of form or of substance.
async fn dry_run(
    state: &AppState,
    asker: Asker,
    body: Result<JsonBody<StudySpec>, ApiError>,
) -> Result<DryRun, ApiError> {
    let spec = match body {
        Ok(JsonBody(spec)) => spec,
        Err(ApiError::InvalidStudy(errors)) => return Ok(DryRun { simulations: 0, errors }),
        Err(other) => return Err(other),
    };
    let _turn = state.heavy().drawing(spec.sampling.samples, asker).await?;
    Ok(match checked(state, spec).await? {
        Ok(checked) => DryRun { simulations: checked.simulations(), errors: Vec::new() },
        Err(errors) => DryRun { simulations: 0, errors },
    })
}
