//! Jobs as users and workers see them.

use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use manduca_protocol::study::StudySpec;
use manduca_protocol::task::Provenance;
use manduca_protocol::view::{JobRole, JobState, JobView};
use manduca_protocol::who::ComputedBy;

use super::names::{kind_of, named, unsigned, uuid};
use super::{Store, StoreError, body};

/// Which jobs of a study are listed, and from where.
#[derive(Debug, Clone, Default)]
pub(crate) struct JobFilter {
    pub(crate) state: Option<&'static str>,
    /// Names of the roles, for a kind of computation may serve two.
    pub(crate) roles: Vec<&'static str>,
    /// After this role and ordinal.
    pub(crate) after: (String, i64),
    pub(crate) limit: u32,
}

/// What a job's task is composed from.
pub(crate) struct TaskRow {
    pub(crate) study: i64,
    pub(crate) role: JobRole,
    pub(crate) ordinal: u32,
    pub(crate) parameters: Option<String>,
    pub(crate) spec: StudySpec,
}

#[derive(sqlx::FromRow)]
struct RawJob {
    job: i64,
    role: String,
    ordinal: i64,
    state: String,
    attempt: i64,
    worker: Option<Vec<u8>>,
    holder_name: Option<String>,
    holder_token: Option<String>,
    reason: Option<String>,
    result_of: Option<i64>,
    wall_s: Option<f64>,
    level: Option<String>,
    #[sqlx(flatten)]
    origin: RawOrigin,
}

/// The worker a result is from, as far as there is a result.
#[derive(Debug, sqlx::FromRow)]
pub(super) struct RawOrigin {
    #[sqlx(default)]
    origin_job: Option<i64>,
    #[sqlx(default)]
    origin_worker: Option<Vec<u8>>,
    #[sqlx(default)]
    origin_name: Option<String>,
    #[sqlx(default)]
    origin_token: Option<String>,
}

impl RawOrigin {
    /// As users see it.
    pub(super) fn view(self) -> Result<Option<ComputedBy>, StoreError> {
        let (Some(job), Some(worker), Some(worker_name)) = (self.origin_job, self.origin_worker, self.origin_name)
        else {
            return Ok(None);
        };
        let (job, worker) = (JobId(job), WorkerId(uuid(&worker)?));
        Ok(Some(ComputedBy { job, worker, worker_name, token: self.origin_token }))
    }
}

impl Store {
    /// One job.
    pub(crate) async fn job(&self, job: JobId) -> Result<JobView, StoreError> {
        let raw: Option<RawJob> = sqlx::query_as(
            "select j.job, j.role, j.ordinal, j.state, j.attempt, j.worker, j.reason, j.result_of, r.wall_s, r.level,
                    h.name as holder_name, h.token as holder_token,
                    r.job as origin_job, r.worker as origin_worker, w.name as origin_name, w.token as origin_token
             from jobs as j left join results as r on r.job = coalesce(j.result_of, j.job)
             left join workers as h on h.id = j.worker left join workers as w on w.id = r.worker where j.job = ?",
        )
        .bind(job.0)
        .fetch_optional(self.readers())
        .await?;
        view(raw.ok_or(StoreError::UnknownJob(job))?)
    }

    /// A page of a study's jobs, by role and ordinal.
    pub(crate) async fn jobs(&self, study: i64, filter: &JobFilter) -> Result<Vec<JobView>, StoreError> {
        let roles = serde_json::to_string(&filter.roles).map_err(|e| StoreError::Corrupt(e.to_string()))?;
        let rows: Vec<RawJob> = sqlx::query_as(
            "select j.job, j.role, j.ordinal, j.state, j.attempt, j.worker, j.reason, j.result_of, r.wall_s, r.level,
                    h.name as holder_name, h.token as holder_token,
                    r.job as origin_job, r.worker as origin_worker, w.name as origin_name, w.token as origin_token
             from jobs as j left join results as r on r.job = coalesce(j.result_of, j.job)
             left join workers as h on h.id = j.worker left join workers as w on w.id = r.worker
             where j.study = ?1 and (j.role, j.ordinal) > (?2, ?3) and (?4 is null or j.state = ?4)
               and (?5 = '[]' or j.role in (select value from json_each(?5)))
             order by j.role, j.ordinal limit ?6",
        )
        .bind(study)
        .bind(&filter.after.0)
        .bind(filter.after.1)
        .bind(filter.state)
        .bind(roles)
        .bind(filter.limit)
        .fetch_all(self.readers())
        .await?;
        rows.into_iter().map(view).collect()
    }

    /// The token of the worker that has a job, or had it last. `None` where nobody had it.
    pub(crate) async fn holder_of(&self, job: JobId) -> Result<Option<Option<String>>, StoreError> {
        let found: Option<(Option<Vec<u8>>, Option<String>)> = sqlx::query_as(
            "select w.id, w.token from jobs as j left join workers as w on w.id = j.worker where j.job = ?",
        )
        .bind(job.0)
        .fetch_optional(self.readers())
        .await?;
        let (worker, token) = found.ok_or(StoreError::UnknownJob(job))?;
        Ok(worker.map(|_| token))
    }

    /// What a job's task is composed from.
    pub(crate) async fn task_row(&self, job: JobId) -> Result<TaskRow, StoreError> {
        let found: Option<(i64, String, i64, Option<String>, String)> = sqlx::query_as(
            "select j.study, j.role, j.ordinal, j.parameters, s.spec
             from jobs as j join study_specs as s on s.study = j.study where j.job = ?",
        )
        .bind(job.0)
        .fetch_optional(self.readers())
        .await?;
        let (study, role, ordinal, parameters, spec) = found.ok_or(StoreError::UnknownJob(job))?;
        Ok(TaskRow {
            study,
            role: named(&role)?,
            ordinal: unsigned(ordinal)?,
            parameters,
            spec: body::from_json(spec.as_bytes())?,
        })
    }

    /// The short number of a study.
    pub(crate) async fn study_number(&self, id: StudyId) -> Result<i64, StoreError> {
        let mut db = self.readers().acquire().await?;
        super::control::find_number(&mut db, id).await
    }
}

fn view(raw: RawJob) -> Result<JobView, StoreError> {
    let (role, state): (JobRole, JobState) = (named(&raw.role)?, named(&raw.state)?);
    // The column also remembers who had it last.
    let leased = state == JobState::Leased;
    let holder = raw.worker.filter(|_| leased);
    Ok(JobView {
        id: JobId(raw.job),
        kind: kind_of(role),
        role,
        ordinal: unsigned(raw.ordinal)?,
        state,
        attempt: unsigned(raw.attempt)?,
        worker: holder.map(|bytes| uuid(&bytes).map(WorkerId)).transpose()?,
        worker_name: raw.holder_name.filter(|_| leased),
        token: raw.holder_token.filter(|_| leased),
        computed_by: raw.origin.view()?,
        reason: raw.reason,
        cached: raw.result_of.is_some(),
        provenance: raw.wall_s.zip(raw.level).map(|(wall_s, level)| Provenance { wall_s, level }),
    })
}
