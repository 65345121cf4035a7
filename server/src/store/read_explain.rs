//! Why a job is where it is.

use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use manduca_protocol::view::{JobRole, JobState};
use manduca_protocol::watch::{FailedAttempt, LeaseView};
use manduca_protocol::who::ComputedBy;

use super::names::{Condition, kind_of, named, unsigned, uuid};
use super::read_jobs::RawOrigin;
use super::{Store, StoreError};
use crate::clock::rfc3339;
use crate::config::Config;

/// What an explanation is made of.
pub(crate) struct Circumstances {
    pub(crate) study: StudyId,
    pub(crate) role: JobRole,
    pub(crate) state: JobState,
    pub(crate) condition: Condition,
    pub(crate) failures: u32,
    pub(crate) losses: u32,
    pub(crate) reason: Option<String>,
    /// Until a delayed job may be leased, s.
    pub(crate) waits_s: Option<f64>,
    pub(crate) lease: Option<LeaseView>,
    pub(crate) result_of: Option<JobId>,
    pub(crate) computed_by: Option<ComputedBy>,
}

#[derive(sqlx::FromRow)]
struct Raw {
    id: Vec<u8>,
    role: String,
    state: String,
    condition: String,
    failures: i64,
    losses: i64,
    reason: Option<String>,
    not_before_ms: Option<i64>,
    worker: Option<Vec<u8>>,
    name: Option<String>,
    token: Option<String>,
    leased_ms: Option<i64>,
    lease_until_ms: Option<i64>,
    result_of: Option<i64>,
    #[sqlx(flatten)]
    origin: RawOrigin,
}

impl Store {
    /// All that decides on a job.
    pub(crate) async fn circumstances(
        &self,
        job: JobId,
        now: i64,
        config: &Config,
    ) -> Result<Circumstances, StoreError> {
        let raw: Option<Raw> = sqlx::query_as(
            "select s.id, j.role, j.state, s.condition, j.failures, j.losses, j.reason, j.not_before_ms, j.worker, w.name,
                    w.token, j.leased_ms, j.lease_until_ms, j.result_of,
                    r.job as origin_job, r.worker as origin_worker, c.name as origin_name, c.token as origin_token
             from jobs as j join studies as s on s.study = j.study left join workers as w on w.id = j.worker
             left join results as r on r.job = coalesce(j.result_of, j.job) left join workers as c on c.id = r.worker
             where j.job = ?",
        )
        .bind(job.0)
        .fetch_optional(self.readers())
        .await?;
        let raw = raw.ok_or(StoreError::UnknownJob(job))?;
        let (role, state): (JobRole, JobState) = (named(&raw.role)?, named(&raw.state)?);
        let seconds = |ms: i64| ms as f64 / 1000.0;
        let lease = match (state, &raw.worker, raw.lease_until_ms) {
            (JobState::Leased, Some(worker), Some(until)) => Some(LeaseView {
                worker: WorkerId(uuid(worker)?),
                name: raw.name.unwrap_or_default(),
                token: raw.token,
                running_s: raw.leased_ms.map(|since| seconds((now - since).max(0))),
                run_limit_s: config.run_limits.of(kind_of(role)).as_secs_f64(),
                expires_s: seconds((until - now).max(0)),
            }),
            _ => None,
        };
        Ok(Circumstances {
            study: StudyId(uuid(&raw.id)?),
            role,
            state,
            condition: named(&raw.condition)?,
            failures: unsigned(raw.failures)?,
            losses: unsigned(raw.losses)?,
            reason: raw.reason,
            waits_s: raw.not_before_ms.map(|at| seconds((at - now).max(0))),
            lease,
            result_of: raw.result_of.map(JobId),
            computed_by: raw.origin.view()?,
        })
    }

    /// The attempts at a job which failed, the first first.
    pub(crate) async fn failed_attempts(&self, job: JobId) -> Result<Vec<FailedAttempt>, StoreError> {
        let rows: Vec<RawFailure> = sqlx::query_as(
            "select f.attempt, f.worker, w.name, w.token, f.fault, f.reason, f.failed_ms
             from failures as f left join workers as w on w.id = f.worker where f.job = ? order by f.attempt",
        )
        .bind(job.0)
        .fetch_all(self.readers())
        .await?;
        rows.into_iter().map(failed_attempt).collect()
    }

    /// Ready jobs which are leased before this one, about: all before it in its own study, and as many of
    /// each other running study, for they share.
    pub(crate) async fn jobs_ahead(&self, job: JobId) -> Result<u64, StoreError> {
        let (study, own): (i64, i64) = sqlx::query_as(
            "select j.study,
                    coalesce((select sum(c.n) from study_counts as c
                              where c.study = j.study and c.state = 'ready'
                                and (c.role <> 'audit', c.role = 'sample', c.role)
                                    < (j.role <> 'audit', j.role = 'sample', j.role)), 0)
                  + (select count(*) from jobs as o
                     where o.state = 'ready' and o.study = j.study and o.role = j.role and o.ordinal < j.ordinal)
             from jobs as j where j.job = ?",
        )
        .bind(job.0)
        .fetch_one(self.readers())
        .await?;
        let others: i64 = sqlx::query_scalar(
            "select coalesce(sum(min(ready, ?2 + 1)), 0) from (
                 select sum(c.n) as ready from studies as s cross join study_counts as c on c.study = s.study
                 where s.condition = 'running' and c.state = 'ready' and s.study <> ?1
                 group by s.study)",
        )
        .bind(study)
        .bind(own)
        .fetch_one(self.readers())
        .await?;
        unsigned(own + others)
    }
}

#[derive(sqlx::FromRow)]
struct RawFailure {
    attempt: i64,
    worker: Vec<u8>,
    name: Option<String>,
    token: Option<String>,
    fault: String,
    reason: String,
    failed_ms: i64,
}

fn failed_attempt(raw: RawFailure) -> Result<FailedAttempt, StoreError> {
    Ok(FailedAttempt {
        attempt: unsigned(raw.attempt)?,
        worker: WorkerId(uuid(&raw.worker)?),
        worker_name: raw.name,
        token: raw.token,
        fault: raw.fault,
        reason: raw.reason,
        at: rfc3339(raw.failed_ms),
    })
}
