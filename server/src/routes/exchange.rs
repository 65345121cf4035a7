//! One round trip of a worker.

use std::time::Duration;

use axum::Json;
use axum::extract::{Extension, State};
use manduca_protocol::ids::{JobId, WorkerId};
use manduca_protocol::problem::{FieldProblem, Problem};
use manduca_protocol::task::{JobKind, JobResult};
use manduca_protocol::worker::{
    Completion, ExchangeRequest, ExchangeResponse, MAX_BATCH, MAX_WAIT_S, Rejected, Renewal,
};
use tokio::sync::oneshot;
use tokio::time::Instant;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::auth::{Caller, Pass};
use crate::compose;
use crate::config::Config;
use crate::error::ApiError;
use crate::http::body::HeldBody;
use crate::http::parts::Id;
use crate::prepare::prepare;
use crate::state::AppState;
use crate::store::{Exchange, Exchanged, Prepared, PreparedRenewal, StoreError, kind_of};

/// Most results of simulations prepared on a thread which serves: a millisecond's work.
const FEW: usize = 128;

/// How often a worker which holds as many jobs as it may is looked at again while it waits.
const HELD_BACK: Duration = Duration::from_millis(200);

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(exchange))
}

/// A worker returns what it has finished, renews what it computes and takes
/// what it wants, waiting for it if need be.
#[utoipa::path(post, path = "/v1/workers/{worker}/exchange", tag = "workers",
    params(("worker" = WorkerId, Path)), request_body = ExchangeRequest,
    responses(
        (status = 200, body = ExchangeResponse),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 403, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 413, body = Problem, content_type = "application/problem+json"),
        (status = 415, body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 503, body = Problem, content_type = "application/problem+json"),
    ))]
async fn exchange(
    State(state): State<AppState>,
    caller: Caller,
    Extension(pass): Extension<Pass>,
    Id(worker): Id<WorkerId>,
    HeldBody { value: request, held }: HeldBody<ExchangeRequest>,
) -> Result<Json<ExchangeResponse>, ApiError> {
    check(&request)?;
    let (want, wait) = (request.want, Duration::from_secs_f64(request.wait_s.min(MAX_WAIT_S)));
    let until = Instant::now() + wait;
    let (complete, renew) = prepare_all(request.complete, request.renew).await?;
    // What is stored of it is compressed; a worker which waits for work holds no memory.
    drop(held);
    // Listening starts before looking: a job which becomes ready in between is not missed.
    let mut notified = Box::pin(state.ready().notified());
    notified.as_mut().enable();
    // A coordinator about to stop takes what is brought and gives nothing out.
    let give = |n| if state.stopping().is_cancelled() { 0 } else { n };
    let first = Exchange {
        complete,
        fail: request.fail,
        renew,
        have: request.have,
        ..Exchange::asking(worker, caller.clone(), give(want))
    };
    let began = Instant::now();
    let checks: Vec<_> = first.large().map(|job| (job, state.beside().wait(job))).collect();
    let mut told = state.store().exchange(first).await?;
    state.metrics().exchanged(began.elapsed());
    hear(checks, &mut told, state.config().check_wait).await;
    // A worker with something to hear is told at once, and comes back to wait.
    while told.is_silent() && give(want) > 0 {
        tokio::select! {
            // In this order, not in a random one: where its time is up, that is all.
            biased;
            () = state.stopping().cancelled() => break,
            () = tokio::time::sleep_until(until) => break,
            () = pass.ended(&state) => return Err(ApiError::Unauthenticated),
            () = notified.as_mut() => {}
            // Nobody tells it that its own jobs have ended.
            () = tokio::time::sleep(HELD_BACK), if told.held_back => {}
        }
        // A token may have been revoked since: its worker is given nothing more.
        if !pass.holds(&state).await {
            return Err(ApiError::Unauthenticated);
        }
        notified.set(state.ready().notified());
        notified.as_mut().enable();
        let news = state.store().exchange(Exchange::asking(worker, caller.clone(), give(want))).await?;
        (told.leased, told.drain, told.held_back) = (news.leased, news.drain, news.held_back);
    }
    if told.leased.iter().any(|leased| kind_of(leased.role) != JobKind::Simulate) {
        state.note_large(worker);
    }
    Ok(Json(response(told, state.config())?))
}

/// Waits a while for the outcome of checks. A result whose check takes longer is on disk, and accepted; should it be of
/// no use, its worker is not told.
async fn hear(checks: Vec<(JobId, oneshot::Receiver<Option<String>>)>, told: &mut Exchanged, wait: Duration) {
    let until = Instant::now() + wait;
    for (job, check) in checks {
        if !told.unchecked.contains(&job) {
            continue;
        }
        let Ok(Ok(Some(reason))) = tokio::time::timeout_at(until, check).await else { continue };
        told.accepted.retain(|accepted| *accepted != job);
        told.rejected.push(Rejected { job, reason });
    }
}

fn check(request: &ExchangeRequest) -> Result<(), ApiError> {
    let mut faults = Vec::new();
    let lengths = [
        ("/complete", request.complete.len()),
        ("/fail", request.fail.len()),
        ("/renew", request.renew.len()),
        ("/have", request.have.as_ref().map_or(0, Vec::len)),
        ("/want", request.want as usize),
    ];
    for (pointer, length) in lengths {
        if length > MAX_BATCH {
            faults.push(FieldProblem::new(pointer, format!("{length} is more than {MAX_BATCH}")));
        }
    }
    if !(request.wait_s >= 0.0 && request.wait_s.is_finite()) {
        faults.push(FieldProblem::new("/wait_s", format!("{} is not a time to wait", request.wait_s)));
    }
    if faults.is_empty() { Ok(()) } else { Err(ApiError::InvalidRequest(faults)) }
}

/// Results and checkpoints are serialised and compressed before they queue, large ones off the
/// threads which serve.
async fn prepare_all(
    completions: Vec<Completion>,
    renewals: Vec<Renewal>,
) -> Result<(Vec<Prepared>, Vec<PreparedRenewal>), ApiError> {
    let small = |completion: &Completion| matches!(completion.result, JobResult::Simulate(_));
    let is_small = completions.len() <= FEW
        && completions.iter().all(small)
        && renewals.iter().all(|renewal| renewal.checkpoint.is_none());
    let prepare = || {
        let complete = completions.into_iter().map(prepare).collect::<Result<_, _>>()?;
        Ok((complete, renewals.into_iter().map(PreparedRenewal::new).collect()))
    };
    if is_small {
        return prepare();
    }
    tokio::task::spawn_blocking(prepare).await.map_err(|e| ApiError::Internal(Box::new(e)))?
}

fn response(told: Exchanged, config: &Config) -> Result<ExchangeResponse, StoreError> {
    Ok(ExchangeResponse {
        accepted: told.accepted,
        rejected: told.rejected,
        jobs: told.leased.iter().map(|leased| compose::lease(leased, &config.run_limits)).collect::<Result<_, _>>()?,
        cancel: told.cancel,
        drain: told.drain,
    })
}
