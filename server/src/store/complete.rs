//! A result comes in: taken, known already, or refused.

use std::collections::HashMap;

use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use manduca_protocol::task::{JobKind, Provenance};
use manduca_protocol::view::{JobRole, JobState};
use sqlx::sqlite::SqliteConnection;

use super::evidence::{Class, refuse};
use super::fail::{Cause, fail_attempt};
use super::names::{kind_of, named, unsigned, uuid};
use super::{StoreError, Work};

/// A result as it goes into the store, checked and serialised before it queues.
#[derive(Debug, Clone)]
pub(crate) struct Prepared {
    pub(crate) job: JobId,
    pub(crate) attempt: u32,
    pub(crate) kind: JobKind,
    pub(crate) outcome: Outcome,
    /// blake3 of the JSON.
    pub(crate) digest: [u8; 32],
    /// JSON, compressed where large.
    pub(crate) body: Vec<u8>,
    /// What status pages show of a training.
    pub(crate) summary: Option<String>,
    pub(crate) provenance: Provenance,
}

/// What a result makes of its job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Outcome {
    Succeeded,
    Infeasible(String),
    /// It contradicts itself or this coordinator: the attempt failed.
    Unusable(String),
}

/// A job as decisions see it.
#[derive(Debug, Clone)]
pub(super) struct JobRow {
    pub(super) job: JobId,
    pub(super) study: i64,
    pub(super) study_id: StudyId,
    pub(super) role: JobRole,
    pub(super) state: JobState,
    pub(super) attempt: u32,
    pub(super) failures: u32,
    pub(super) losses: u32,
    pub(super) worker: Option<Vec<u8>>,
    pub(super) key: Option<Vec<u8>>,
}

impl JobRow {
    /// Whether this is the job's present attempt, by the worker which has it.
    pub(super) fn is_held_by(&self, worker: WorkerId, attempt: u32) -> bool {
        self.attempt == attempt && self.worker.as_deref() == Some(worker.0.as_bytes().as_slice())
    }
}

#[derive(sqlx::FromRow)]
struct RawJob {
    job: i64,
    study: i64,
    id: Vec<u8>,
    role: String,
    state: String,
    attempt: i64,
    failures: i64,
    losses: i64,
    worker: Option<Vec<u8>>,
    key: Option<Vec<u8>>,
}

/// A job by its number.
pub(super) async fn find_job(db: &mut SqliteConnection, job: JobId) -> Result<Option<JobRow>, StoreError> {
    Ok(find_jobs(db, &[job]).await?.remove(&job))
}

/// Jobs by their numbers; those which do not exist are missing.
pub(super) async fn find_jobs(db: &mut SqliteConnection, jobs: &[JobId]) -> Result<HashMap<JobId, JobRow>, StoreError> {
    let jobs = serde_json::to_string(jobs).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    let rows: Vec<RawJob> = sqlx::query_as(
        "select j.job, j.study, s.id, j.role, j.state, j.attempt, j.failures, j.losses, j.worker, j.key
         from json_each(?) as d cross join jobs as j on j.job = d.value cross join studies as s on s.study = j.study",
    )
    .bind(jobs)
    .fetch_all(db)
    .await?;
    rows.into_iter().map(|raw| row(raw).map(|job| (job.job, job))).collect()
}

fn row(raw: RawJob) -> Result<JobRow, StoreError> {
    Ok(JobRow {
        job: JobId(raw.job),
        study: raw.study,
        study_id: StudyId(uuid(&raw.id)?),
        role: named(&raw.role)?,
        state: named(&raw.state)?,
        attempt: unsigned(raw.attempt)?,
        failures: unsigned(raw.failures)?,
        losses: unsigned(raw.losses)?,
        worker: raw.worker,
        key: raw.key,
    })
}

/// The state a result puts its job into, if it is of the job's present attempt and fit for it.
pub(super) fn verdict<'r>(job: &JobRow, worker: WorkerId, result: &'r Prepared) -> Option<(JobState, Option<&'r str>)> {
    if !awaits(job, worker, result) || result.kind != kind_of(job.role) {
        return None;
    }
    match &result.outcome {
        Outcome::Succeeded => Some((JobState::Succeeded, None)),
        Outcome::Infeasible(reason) => Some((JobState::Infeasible, Some(reason))),
        Outcome::Unusable(_) => None,
    }
}

/// Whether a job waits for this very attempt. A result just after expiry still
/// is the present attempt's until another lease is given.
fn awaits(job: &JobRow, worker: WorkerId, result: &Prepared) -> bool {
    let waits = matches!(job.state, JobState::Leased | JobState::Delayed | JobState::Ready);
    waits && job.is_held_by(worker, result.attempt)
}

/// What became of a result which is not simply stored.
pub(super) enum Taken {
    /// Stored before.
    Replay,
    /// Not stored.
    Refused(String),
    /// Not stored, and its attempt thereby failed; the study whose job it was.
    Failed(String, i64),
}

/// Judges a result without a [`verdict`].
pub(super) async fn complete(work: &mut Work<'_>, worker: WorkerId, result: &Prepared) -> Result<Taken, StoreError> {
    let Some(job) = find_job(work.db, result.job).await? else {
        return Ok(Taken::Refused("there is no such job".into()));
    };
    if awaits(&job, worker, result) {
        let why = match &result.outcome {
            Outcome::Unusable(why) => why.clone(),
            _ => format!("the worker returned the result of another kind of job, {:?}", result.kind),
        };
        return fail_unusable(work, worker, job, result, why).await;
    }
    let reason = match job.state {
        JobState::Succeeded | JobState::Infeasible => return compare(work, worker, &job, result).await,
        JobState::Cancelled => "the study was cancelled",
        JobState::Dead => "the job was given up before",
        _ => "this attempt is no longer the job's present one",
    };
    refuse(work, worker, result, Class::Refused, reason).await?;
    Ok(Taken::Refused(reason.into()))
}

async fn fail_unusable(
    work: &mut Work<'_>,
    worker: WorkerId,
    job: JobRow,
    result: &Prepared,
    why: String,
) -> Result<Taken, StoreError> {
    refuse(work, worker, result, Class::Refused, &why).await?;
    if job.state == JobState::Leased {
        fail_attempt(work, &job, Cause::Failed(&why)).await?;
    }
    Ok(Taken::Failed(why, job.study))
}

/// A finished job's second result: the same, or evidence.
async fn compare(work: &mut Work<'_>, worker: WorkerId, job: &JobRow, result: &Prepared) -> Result<Taken, StoreError> {
    let stored = find_digest(work.db, job.job).await?;
    let same = stored.as_ref().is_some_and(|(digest, _)| digest == result.digest.as_slice());
    if same && job.is_held_by(worker, result.attempt) {
        return Ok(Taken::Replay);
    }
    // Levels without common arithmetic may differ in the last bits: only equal ones are compared.
    let comparable = stored.as_ref().is_some_and(|(_, level)| *level == result.provenance.level);
    let (class, reason) = match (same, comparable) {
        (true, _) => (Class::Refused, "the job has this result already, from another attempt"),
        (false, true) => (Class::Nondeterminism, "the job is finished and has a different result"),
        (false, false) => (Class::Refused, "the job is finished, with a result of another instruction level"),
    };
    refuse(work, worker, result, class, reason).await?;
    Ok(Taken::Refused(reason.into()))
}

async fn find_digest(db: &mut SqliteConnection, job: JobId) -> Result<Option<(Vec<u8>, String)>, StoreError> {
    let found = sqlx::query_as(
        "select r.digest, r.level from jobs as j join results as r on r.job = coalesce(j.result_of, j.job)
         where j.job = ?",
    )
    .bind(job.0)
    .fetch_optional(db)
    .await?;
    Ok(found)
}
