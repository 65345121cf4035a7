//! Workers come, are listed, and go.

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::ids::WorkerId;
use manduca_protocol::problem::{FieldProblem, Problem};
use manduca_protocol::who::WorkerView;
use manduca_protocol::worker::{OLDEST_PROTOCOL_VERSION, PROTOCOL_VERSION, RegisterRequest, RegisterResponse};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::auth::Caller;
use crate::error::ApiError;
use crate::http::body::JsonBody;
use crate::http::parts::Id;
use crate::state::AppState;
use crate::store::{Deregister, Drain, Register};

/// Most slots of one worker.
const MOST_SLOTS: u32 = 4096;
/// Longest name of a worker or level, characters.
const LONGEST_NAME: usize = 200;

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(register))
        .routes(routes!(list))
        .routes(routes!(deregister))
        .routes(routes!(drain))
}

/// A worker introduces itself. Only workers of the same exchange and the same
/// numbers are taken.
#[utoipa::path(post, path = "/v1/workers", tag = "workers", request_body = RegisterRequest, responses(
    (status = 201, body = RegisterResponse),
    (status = 400, body = Problem, content_type = "application/problem+json"),
    (status = 409, body = Problem, content_type = "application/problem+json"),
    (status = 413, body = Problem, content_type = "application/problem+json"),
    (status = 415, body = Problem, content_type = "application/problem+json"),
    (status = 422, body = Problem, content_type = "application/problem+json"),
    (status = 426, body = Problem, content_type = "application/problem+json"),
    (status = 429, body = Problem, content_type = "application/problem+json"),
))]
async fn register(
    State(state): State<AppState>,
    caller: Caller,
    JsonBody(request): JsonBody<RegisterRequest>,
) -> Result<(StatusCode, Json<RegisterResponse>), ApiError> {
    if !(OLDEST_PROTOCOL_VERSION..=PROTOCOL_VERSION).contains(&request.protocol_version) {
        return Err(ApiError::ProtocolVersion { theirs: request.protocol_version });
    }
    if request.solver_version != SOLVER_VERSION {
        return Err(ApiError::SolverVersion { theirs: request.solver_version, ours: SOLVER_VERSION });
    }
    check(&request)?;
    if let Some(token) = caller.name() {
        let admitted = state.registrations().admit(token, state.now_ms());
        admitted.map_err(|wait_s| ApiError::TooManyRegistrations { wait_s })?;
    }
    let worker = WorkerId::new();
    let RegisterRequest { name, slots, level, .. } = request;
    state.store().run(Register { worker, name, slots, level, token: caller.named() }).await?;
    let config = state.config();
    let response =
        RegisterResponse { worker, lease_s: config.lease.as_secs_f64(), renew_s: config.renew.as_secs_f64() };
    Ok((StatusCode::CREATED, Json(response)))
}

fn check(request: &RegisterRequest) -> Result<(), ApiError> {
    let mut faults = Vec::new();
    for (pointer, text) in [("/name", &request.name), ("/level", &request.level)] {
        let length = text.chars().count();
        if !(1..=LONGEST_NAME).contains(&length) || text.chars().any(char::is_control) {
            let why = format!("must have 1 to {LONGEST_NAME} characters, none of them control characters");
            faults.push(FieldProblem::new(pointer, why));
        }
    }
    if !(1..=MOST_SLOTS).contains(&request.slots) {
        faults.push(FieldProblem::new("/slots", format!("{} is outside 1 to {MOST_SLOTS}", request.slots)));
    }
    if faults.is_empty() { Ok(()) } else { Err(ApiError::InvalidRequest(faults)) }
}

/// Lists the workers heard of within a day.
#[utoipa::path(get, path = "/v1/workers", tag = "workers", responses((status = 200, body = Vec<WorkerView>)))]
async fn list(State(state): State<AppState>) -> Result<Json<Vec<WorkerView>>, ApiError> {
    let workers = state.store().workers(state.now_ms(), state.config().lease_ms()).await?;
    Ok(Json(workers))
}

/// A worker says goodbye; its jobs are ready again at once.
#[utoipa::path(delete, path = "/v1/workers/{worker}", tag = "workers", params(("worker" = WorkerId, Path)), responses(
    (status = 204, description = "Its leases are given back"),
    (status = 403, body = Problem, content_type = "application/problem+json"),
    (status = 404, body = Problem, content_type = "application/problem+json"),
))]
async fn deregister(
    State(state): State<AppState>,
    caller: Caller,
    Id(worker): Id<WorkerId>,
) -> Result<StatusCode, ApiError> {
    state.store().run(Deregister { worker, caller }).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Asks a worker to finish what it has and leave. It is told in its next exchange.
#[utoipa::path(post, path = "/v1/workers/{worker}/drain", tag = "workers", params(("worker" = WorkerId, Path)), responses(
    (status = 202, description = "It will be told"),
    (status = 404, body = Problem, content_type = "application/problem+json"),
))]
async fn drain(
    State(state): State<AppState>,
    caller: Caller,
    Id(worker): Id<WorkerId>,
) -> Result<StatusCode, ApiError> {
    state.store().run(Drain { worker, by: caller.named() }).await?;
    Ok(StatusCode::ACCEPTED)
}
