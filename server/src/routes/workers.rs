//! Workers come, are listed, and go.

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::ids::WorkerId;
use manduca_protocol::problem::{FieldProblem, Problem};
use manduca_protocol::text::check_name;
use manduca_protocol::view::Page;
use manduca_protocol::who::WorkerView;
use manduca_protocol::worker::{OLDEST_PROTOCOL_VERSION, PROTOCOL_VERSION, RegisterRequest, RegisterResponse};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::auth::Caller;
use crate::error::ApiError;
use crate::http::body::JsonBody;
use crate::http::cursor;
use crate::http::parts::{Id, Params};
use crate::state::AppState;
use crate::store::{Deregister, Disown, Drain, Readmit, Register, WorkerFilter};

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
        .routes(routes!(disown))
        .routes(routes!(readmit))
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
        if let Err(why) = check_name(text, LONGEST_NAME) {
            faults.push(FieldProblem::new(pointer, why));
        }
    }
    if !(1..=MOST_SLOTS).contains(&request.slots) {
        faults.push(FieldProblem::new("/slots", format!("{} is outside 1 to {MOST_SLOTS}", request.slots)));
    }
    if faults.is_empty() { Ok(()) } else { Err(ApiError::InvalidRequest(faults)) }
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct ListParams {
    /// Only workers of this name or id.
    find: Option<String>,
    /// Where the page begins, from the page before.
    cursor: Option<String>,
    /// Items at most, 1 to 1000; 100 where left out.
    limit: Option<u32>,
}

/// Workers as they were asked for.
#[derive(Debug, Serialize, ToSchema)]
#[serde(untagged)]
enum WorkerList {
    /// Without parameters: the first 1000 by name.
    First(Vec<WorkerView>),
    /// With any: a page, by time of registration.
    Page(Page<WorkerView>),
}

/// Lists the workers heard of within a day: without parameters the first 1000 by name as an array, else in pages.
#[utoipa::path(get, path = "/v1/workers", tag = "workers", params(ListParams), responses(
    (status = 200, body = WorkerList),
    (status = 400, body = Problem, content_type = "application/problem+json"),
))]
async fn list(State(state): State<AppState>, Params(params): Params<ListParams>) -> Result<Json<WorkerList>, ApiError> {
    let (store, now, lease_ms) = (state.store(), state.now_ms(), state.config().lease_ms());
    if let ListParams { find: None, cursor: None, limit: None } = params {
        return Ok(Json(WorkerList::First(store.workers(now, lease_ms).await?)));
    }
    let limit = cursor::limit(params.limit)?;
    let after = match &params.cursor {
        Some(cursor) => Some(
            cursor::decode(cursor)?.parse().map_err(|_| ApiError::query("/cursor", "is not a cursor of this list"))?,
        ),
        None => None,
    };
    let filter = WorkerFilter { find: params.find, after, limit: limit + 1 };
    let mut items = store.workers_page(&filter, now, lease_ms).await?;
    let more = items.len() > limit as usize;
    items.truncate(limit as usize);
    let next_cursor = items.last().filter(|_| more).map(|last| cursor::encode(&last.id.to_string()));
    Ok(Json(WorkerList::Page(Page { items, next_cursor })))
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

/// Sets a worker aside and disowns all of its results: they are dropped and their jobs queued again in
/// studies that still sample, and marked in all others. No study shares them any more.
#[utoipa::path(post, path = "/v1/workers/{worker}/disown", tag = "workers", params(("worker" = WorkerId, Path)), responses(
    (status = 204, description = "Its results are disowned"),
    (status = 404, body = Problem, content_type = "application/problem+json"),
))]
async fn disown(State(state): State<AppState>, Id(worker): Id<WorkerId>) -> Result<StatusCode, ApiError> {
    state.store().run(Disown { worker, why: "disowned by an operator".into() }).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Gives jobs again to a worker that was set aside, and to those of its name and token. Results that
/// were disowned stay disowned.
#[utoipa::path(post, path = "/v1/workers/{worker}/readmit", tag = "workers", params(("worker" = WorkerId, Path)), responses(
    (status = 204, description = "It may have jobs again"),
    (status = 404, body = Problem, content_type = "application/problem+json"),
))]
async fn readmit(State(state): State<AppState>, Id(worker): Id<WorkerId>) -> Result<StatusCode, ApiError> {
    state.store().run(Readmit { worker }).await?;
    Ok(StatusCode::NO_CONTENT)
}
