//! For those who watch, scale and ask why.

use axum::Json;
use axum::extract::State;
use axum::http::header;
use axum::response::IntoResponse;
use manduca_protocol::ids::JobId;
use manduca_protocol::problem::Problem;
use manduca_protocol::view::JobState;
use manduca_protocol::watch::{EvidenceView, Explanation, ScalingView};
use serde::Deserialize;
use utoipa::IntoParams;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::error::ApiError;
use crate::http::cursor;
use crate::http::parts::{Id, Params};
use crate::state::AppState;
use crate::store::{Circumstances, Condition};

/// What a scrape is told its answer is.
const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(metrics))
        .routes(routes!(scaling))
        .routes(routes!(explain))
        .routes(routes!(evidence))
}

/// Counters and gauges for Prometheus.
#[utoipa::path(get, path = "/metrics", tag = "watch", responses(
    (status = 200, body = String, content_type = "application/openmetrics-text"),
    (status = 503, body = Problem, content_type = "application/problem+json"),
))]
async fn metrics(State(state): State<AppState>) -> Result<impl IntoResponse, ApiError> {
    let depths = state.store().depths().await?;
    let workers = state.store().worker_sums(state.now_ms(), state.config().lease_ms()).await?;
    let text = state.metrics().render(&depths, &workers).map_err(|e| ApiError::Internal(Box::new(e)))?;
    Ok(([(header::CONTENT_TYPE, OPEN_METRICS)], text))
}

/// How many slots there is work for, for an autoscaler.
#[utoipa::path(get, path = "/v1/scaling", tag = "watch", responses((status = 200, body = ScalingView)))]
async fn scaling(State(state): State<AppState>) -> Result<Json<ScalingView>, ApiError> {
    let demand = state.store().demand().await?;
    let workers = state.store().worker_sums(state.now_ms(), state.config().lease_ms()).await?;
    Ok(Json(ScalingView {
        ready_jobs: demand.ready,
        delayed_jobs: demand.delayed,
        leased_jobs: demand.leased,
        workers: workers.alive,
        slots: workers.slots,
        idle_slots: workers.slots.saturating_sub(demand.leased),
        wanted_slots: demand.ready + demand.delayed + demand.leased,
    }))
}

/// Why a job is where it is, and what has to happen for it to go on.
#[utoipa::path(get, path = "/v1/jobs/{job}/explain", tag = "jobs", params(("job" = JobId, Path)), responses(
    (status = 200, body = Explanation),
    (status = 404, body = Problem, content_type = "application/problem+json"),
))]
async fn explain(State(state): State<AppState>, Id(job): Id<JobId>) -> Result<Json<Explanation>, ApiError> {
    let config = state.config();
    let at = state.store().circumstances(job, state.now_ms(), config).await?;
    let ahead = if at.state == JobState::Ready { Some(state.store().jobs_ahead(job).await?) } else { None };
    let workers = state.store().worker_sums(state.now_ms(), config.lease_ms()).await?;
    let mut because = Vec::new();
    reasons(&at, ahead, workers.slots, config.max_attempts, &mut because);
    distrust(&state, job, at.state, &mut because).await?;
    Ok(Json(Explanation {
        job,
        study: at.study,
        role: at.role,
        state: at.state,
        because,
        jobs_ahead: ahead,
        waits_s: at.waits_s,
        lease: at.lease,
        computed_by: at.computed_by,
        failures: at.failures,
        losses: at.losses,
        last_failure: at.reason,
        failed_attempts: state.store().failed_attempts(job).await?,
        slots: workers.slots,
    }))
}

/// What workers that are not believed have to do with it.
async fn distrust(state: &AppState, job: JobId, at: JobState, told: &mut Vec<String>) -> Result<(), ApiError> {
    if let Some(worker) = state.store().disowner(job.0).await? {
        told.push(format!("its result is from worker `{worker}`, whose results are disowned"));
    }
    if at == JobState::Ready {
        let names = state.store().set_aside().await?;
        if !names.is_empty() {
            let names = names.join("`, `");
            told.push(format!("set aside for wrong results until `manduca workers readmit`: `{names}`"));
        }
        for (name, seconds) in state.store().quarantined(state.now_ms()).await? {
            told.push(format!(
                "worker `{name}` is given no jobs for another {seconds:.0} s, for too many attempts failed in a row; \
                 `manduca workers readmit {name}` ends that"
            ));
        }
    }
    Ok(())
}

/// The sentences.
fn reasons(at: &Circumstances, ahead: Option<u64>, slots: u64, max_attempts: u32, told: &mut Vec<String>) {
    let why = at.reason.as_deref().unwrap_or("no reason is known");
    match at.state {
        JobState::Ready => {
            match at.condition {
                Condition::Paused => told.push("its study is paused: resume it".into()),
                Condition::Running | Condition::Succeeded => {}
                _ => told.push("its study has ended".into()),
            }
            if slots == 0 {
                told.push("no worker was heard of lately which may be given jobs: start one".into());
            }
            told.push(format!(
                "about {} ready jobs are leased before it, for running studies share; {slots} slots work",
                ahead.unwrap_or(0)
            ));
        }
        JobState::Delayed => told.push(format!(
            "attempt {} of {max_attempts} failed ({why}); it waits {:.1} s before the next",
            at.failures,
            at.waits_s.unwrap_or(0.0)
        )),
        JobState::Leased => {
            if let Some(lease) = &at.lease {
                let token = lease.token.as_ref().map(|token| format!(" of token `{token}`")).unwrap_or_default();
                told.push(format!(
                    "worker `{}`{token} has it, for {:.1} s of at most {} s; unless renewed its lease ends in {:.1} s",
                    lease.name,
                    lease.running_s.unwrap_or(0.0),
                    lease.run_limit_s,
                    lease.expires_s
                ));
            }
        }
        JobState::Succeeded => told.push(match (at.result_of, &at.computed_by) {
            (Some(equal), Some(by)) => {
                format!("it is done: job {equal} has simulated the same stroke, computed by {}", by.sentence())
            }
            (_, Some(by)) => format!("it is done: computed by {}", by.sentence()),
            (_, None) => "it is done".into(),
        }),
        JobState::Infeasible => told.push(format!("it is answered: the stroke cannot be flown ({why})")),
        JobState::Dead => {
            told.push(format!(
                "it was given up after {} failures and {} lost workers, the last time: {why}",
                at.failures, at.losses
            ));
            told.push("`retry-failed` gives its study's dead jobs another set of attempts".into());
        }
        JobState::Cancelled => told.push("it was cancelled with its study".into()),
    }
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct EvidenceParams {
    /// Only of this class: `refused` or `nondeterminism`.
    class: Option<String>,
    /// Items at most, 1 to 1000; 100 where left out.
    limit: Option<u32>,
}

/// Results which were refused, or which contradict one taken before, the newest first.
#[utoipa::path(get, path = "/v1/evidence", tag = "watch", params(EvidenceParams), responses(
    (status = 200, body = Vec<EvidenceView>),
    (status = 400, body = Problem, content_type = "application/problem+json"),
))]
async fn evidence(
    State(state): State<AppState>,
    Params(params): Params<EvidenceParams>,
) -> Result<Json<Vec<EvidenceView>>, ApiError> {
    let limit = cursor::limit(params.limit)?;
    if let Some(class) = params.class.as_deref().filter(|class| !["refused", "nondeterminism"].contains(class)) {
        return Err(ApiError::query("/class", format!("`{class}` is neither refused nor nondeterminism")));
    }
    Ok(Json(state.store().evidence(params.class.as_deref(), limit).await?))
}
