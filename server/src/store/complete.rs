//! A result comes in: taken, known already, or refused.

use std::collections::HashMap;

use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use manduca_protocol::task::{JobKind, Provenance};
use manduca_protocol::view::{JobRole, JobState};
use sqlx::sqlite::SqliteConnection;

use super::evidence::Class;
use super::names::{kind_of, named, unsigned, uuid};
use super::{StoreError, Work};
use crate::validity::Flown;

/// A result as it goes into the store, checked and serialised before it queues.
#[derive(Debug, Clone)]
pub(crate) struct Prepared {
    pub(crate) job: JobId,
    pub(crate) attempt: u32,
    pub(crate) kind: JobKind,
    pub(crate) outcome: Outcome,
    /// The means of a flight, for its study to check.
    pub(crate) flown: Option<Flown>,
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
    pub(super) ordinal: u32,
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
    ordinal: i64,
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
        "select j.job, j.study, s.id, j.role, j.ordinal, j.state, j.attempt, j.failures, j.losses, j.worker, j.key
         from json_each(?) as d cross join jobs as j on j.job = d.value cross join studies as s on s.study = j.study",
    )
    .bind(jobs)
    .fetch_all(db)
    .await?;
    let mut found = HashMap::with_capacity(rows.len());
    for raw in rows {
        let job = JobId(raw.job);
        match row(raw) {
            Ok(row) => drop(found.insert(job, row)),
            // One damaged row must not stop the others.
            Err(error) => tracing::error!(job = job.0, error.cause = %error, "A job cannot be read and is passed over"),
        }
    }
    Ok(found)
}

fn row(raw: RawJob) -> Result<JobRow, StoreError> {
    Ok(JobRow {
        job: JobId(raw.job),
        study: raw.study,
        study_id: StudyId(uuid(&raw.id)?),
        role: named(&raw.role)?,
        ordinal: unsigned(raw.ordinal)?,
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

/// What becomes of a result without a [`verdict`].
pub(super) enum Judged {
    /// It is stored already.
    Replay,
    /// It is not stored.
    Refused(Class, String),
    /// It is not stored, and its attempt thereby fails.
    Unusable(String),
}

/// The result a finished job has: its digest and the instruction level it is from.
pub(super) type Stored = (Vec<u8>, String);

/// Why the study of a job does not bear a result out, if it does not.
pub(super) async fn doubt(work: &mut Work<'_>, job: &JobRow, result: &Prepared) -> Result<Option<String>, StoreError> {
    let Some(flown) = result.flown.as_ref().filter(|_| result.kind == kind_of(job.role)) else { return Ok(None) };
    let known = match work.specs.known(work.db, job.study).await {
        Ok(known) => known,
        // Such a study fails by itself.
        Err(StoreError::Corrupt(_)) => return Ok(None),
        Err(error) => return Err(error),
    };
    Ok(known.limits.as_ref().and_then(|limits| limits.check(flown, job.role, job.ordinal).err()))
}

/// Judges a result without a [`verdict`] by its job, and by what a finished job has.
pub(super) fn judge(
    job: Option<&JobRow>,
    stored: Option<&Stored>,
    worker: WorkerId,
    result: &Prepared,
    doubt: Option<String>,
) -> Judged {
    let Some(job) = job else { return Judged::Refused(Class::Refused, NO_JOB.into()) };
    if awaits(job, worker, result) {
        return Judged::Unusable(match &result.outcome {
            Outcome::Unusable(why) => why.clone(),
            _ if doubt.is_some() => doubt.unwrap_or_default(),
            _ => format!("the worker returned the result of another kind of job, {:?}", result.kind),
        });
    }
    let reason = match job.state {
        JobState::Succeeded | JobState::Infeasible => return compare(job, stored, worker, result),
        JobState::Cancelled => "the study was cancelled",
        JobState::Dead => "the job was given up before",
        _ => NOT_PRESENT,
    };
    Judged::Refused(Class::Refused, reason.into())
}

/// Why what is said of another attempt is refused.
pub(super) const NOT_PRESENT: &str = "this attempt is no longer the job's present one";
/// Why what is said of an unknown job is refused.
pub(super) const NO_JOB: &str = "there is no such job";

/// A finished job's second result: the same, or evidence.
fn compare(job: &JobRow, stored: Option<&Stored>, worker: WorkerId, result: &Prepared) -> Judged {
    let same = stored.is_some_and(|(digest, _)| digest == result.digest.as_slice());
    if same && job.is_held_by(worker, result.attempt) {
        return Judged::Replay;
    }
    // Levels without common arithmetic may differ in the last bits: only equal ones are compared.
    let comparable = stored.is_some_and(|(_, level)| *level == result.provenance.level);
    let (class, reason) = match (same, comparable) {
        (true, _) => (Class::Refused, "the job has this result already, from another attempt"),
        (false, true) => (Class::Nondeterminism, "the job is finished and has a different result"),
        (false, false) => (Class::Refused, "the job is finished, with a result of another instruction level"),
    };
    Judged::Refused(class, reason.into())
}

/// What those of these jobs have which are finished.
pub(super) async fn find_stored(
    db: &mut SqliteConnection,
    jobs: impl Iterator<Item = &JobRow>,
) -> Result<HashMap<JobId, Stored>, StoreError> {
    let finished = |job: &&JobRow| matches!(job.state, JobState::Succeeded | JobState::Infeasible);
    let jobs: Vec<JobId> = jobs.filter(finished).map(|job| job.job).collect();
    if jobs.is_empty() {
        return Ok(HashMap::new());
    }
    let jobs = serde_json::to_string(&jobs).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    let rows: Vec<(i64, Vec<u8>, String)> = sqlx::query_as(
        "select j.job, r.digest, r.level from json_each(?) as d cross join jobs as j on j.job = d.value
         cross join results as r on r.job = coalesce(j.result_of, j.job)",
    )
    .bind(jobs)
    .fetch_all(db)
    .await?;
    Ok(rows.into_iter().map(|(job, digest, level)| (JobId(job), (digest, level))).collect())
}
