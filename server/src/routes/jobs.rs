//! Jobs are listed and looked at, and workers fetch large tasks.

use axum::Json;
use axum::extract::State;
use axum::response::{IntoResponse, Response};
use manduca_protocol::ids::{JobId, StudyId};
use manduca_protocol::problem::Problem;
use manduca_protocol::resolve;
use manduca_protocol::task::{JobKind, SurrogateMessage, Task};
use manduca_protocol::view::{JobRole, JobState, JobView, Page};
use serde::Deserialize;
use utoipa::IntoParams;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::training;
use crate::auth::Caller;
use crate::compose;
use crate::error::ApiError;
use crate::fair::Asker;
use crate::http::cursor;
use crate::http::parts::{Id, Params};
use crate::state::AppState;
use crate::store::{JobFilter, StoreError, role_name, round_of, state_name};

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(list)).routes(routes!(show)).routes(routes!(task))
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct ListParams {
    /// Only jobs in this state.
    #[param(inline)]
    state: Option<JobState>,
    /// Only jobs of this kind.
    #[param(inline)]
    kind: Option<JobKind>,
    /// Where the page begins, from the page before.
    cursor: Option<String>,
    /// Items at most, 1 to 1000; 100 where left out.
    limit: Option<u32>,
}

/// Lists a study's jobs.
#[utoipa::path(get, path = "/v1/studies/{study}/jobs", tag = "jobs",
    params(("study" = StudyId, Path), ListParams),
    responses(
        (status = 200, body = Page<JobView>),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
async fn list(
    State(state): State<AppState>,
    Id(study): Id<StudyId>,
    Params(params): Params<ListParams>,
) -> Result<Json<Page<JobView>>, ApiError> {
    let limit = cursor::limit(params.limit)?;
    let after = match &params.cursor {
        Some(cursor) => position(&cursor::decode(cursor)?)?,
        None => (String::new(), -1),
    };
    let number = state.store().study_number(study).await?;
    let filter = JobFilter {
        state: params.state.map(state_name),
        roles: params.kind.map(roles).unwrap_or_default(),
        after,
        limit: limit + 1,
    };
    let mut items = state.store().jobs(number, &filter).await?;
    let more = items.len() > limit as usize;
    items.truncate(limit as usize);
    let place = |job: &JobView| cursor::encode(&format!("{}:{}", role_name(job.role), job.ordinal));
    let next_cursor = items.last().filter(|_| more).map(place);
    Ok(Json(Page { items, next_cursor }))
}

fn position(text: &str) -> Result<(String, i64), ApiError> {
    let found = text.split_once(':').and_then(|(role, ordinal)| Some((role.to_owned(), ordinal.parse().ok()?)));
    found.ok_or_else(|| ApiError::query("/cursor", "is not a cursor of this list"))
}

fn roles(kind: JobKind) -> Vec<&'static str> {
    match kind {
        JobKind::Simulate => [JobRole::Sample, JobRole::Verify, JobRole::Probe, JobRole::Individual, JobRole::Audit]
            .map(role_name)
            .to_vec(),
        JobKind::Train => vec![role_name(JobRole::Train)],
        JobKind::Optimise => vec![role_name(JobRole::Optimise)],
        JobKind::Search => [JobRole::Search, JobRole::Generation].map(role_name).to_vec(),
    }
}

/// Shows a job.
#[utoipa::path(get, path = "/v1/jobs/{job}", tag = "jobs", params(("job" = JobId, Path)), responses(
    (status = 200, body = JobView),
    (status = 404, body = Problem, content_type = "application/problem+json"),
))]
async fn show(State(state): State<AppState>, Id(job): Id<JobId>) -> Result<Json<JobView>, ApiError> {
    Ok(Json(state.store().job(job).await?))
}

/// What a job computes, with all its data: for the token of the worker that has it, and for admins.
#[utoipa::path(get, path = "/v1/jobs/{job}/task", tag = "workers", params(("job" = JobId, Path)), responses(
    (status = 200, body = Task),
    (status = 403, body = Problem, content_type = "application/problem+json"),
    (status = 404, body = Problem, content_type = "application/problem+json"),
))]
async fn task(
    State(state): State<AppState>,
    caller: Caller,
    asker: Asker,
    Id(job): Id<JobId>,
) -> Result<Response, ApiError> {
    let store = state.store();
    if !caller.is_admin() && !store.holder_of(job).await?.is_some_and(|token| caller.speaks_for(token.as_deref())) {
        let why = format!("job {job} is not with a worker of this token, which alone may see what it computes");
        return Err(ApiError::AnotherToken(why));
    }
    let row = store.task_row(job).await?;
    let task = match row.role {
        JobRole::Sample | JobRole::Verify | JobRole::Probe | JobRole::Individual | JobRole::Audit => {
            let parameters = row.parameters.unwrap_or_default();
            compose::simulation(&row.spec, row.role, row.ordinal, &parameters)?
        }
        JobRole::Train => {
            let checkpoint = store.resumed_checkpoint(row.study).await?;
            let task = compose::train_task(&row.spec, &resolved(&row.spec)?, Vec::new(), checkpoint);
            return training::respond(&state, asker, row.study, &task).await;
        }
        JobRole::Optimise => {
            let surrogate = trained(&state, row.study).await?;
            compose::optimise_task(&row.spec, &resolved(&row.spec)?, row.ordinal, surrogate)?
        }
        JobRole::Search | JobRole::Generation => {
            let (optimisation, _) = round_of(row.ordinal);
            let direct = row.spec.optimisations.get(optimisation as usize).is_some_and(|o| o.is_direct());
            let surrogate = if direct { None } else { Some(trained(&state, row.study).await?) };
            let (before, flown) = store.before_round(row.study, row.role, row.ordinal, direct).await?;
            compose::search_task(&row.spec, &resolved(&row.spec)?, row.ordinal, surrogate, before, flown)?
        }
    };
    Ok(Json(task).into_response())
}

/// A study's surrogate, once it is trained.
async fn trained(state: &AppState, study: i64) -> Result<SurrogateMessage, ApiError> {
    let training = state.store().training_of(study).await?;
    Ok(training.ok_or(ApiError::NotYet("the study has no network yet"))?.surrogate)
}

fn resolved(spec: &manduca_protocol::study::StudySpec) -> Result<resolve::ResolvedStudy, StoreError> {
    resolve::study(spec).map_err(|_| StoreError::Corrupt("a stored study is not valid any more".into()))
}
