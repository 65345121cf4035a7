//! A result comes in: taken, known already, or refused.

use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use manduca_protocol::task::{JobKind, Provenance};
use manduca_protocol::view::{JobRole, JobState};
use sqlx::sqlite::SqliteConnection;

use super::evidence::{Class, refuse};
use super::fail::fail_attempt;
use super::names::{kind_of, named, state_name, unsigned, uuid};
use super::{StoreError, Work};
use crate::event::Event;

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
    worker: Option<Vec<u8>>,
    key: Option<Vec<u8>>,
}

/// A job by its number.
pub(super) async fn find_job(db: &mut SqliteConnection, job: JobId) -> Result<Option<JobRow>, StoreError> {
    let raw: Option<RawJob> = sqlx::query_as(
        "select j.job, j.study, s.id, j.role, j.state, j.attempt, j.failures, j.worker, j.key
         from jobs as j join studies as s on s.study = j.study where j.job = ?",
    )
    .bind(job.0)
    .fetch_optional(db)
    .await?;
    let Some(raw) = raw else { return Ok(None) };
    Ok(Some(JobRow {
        job: JobId(raw.job),
        study: raw.study,
        study_id: StudyId(uuid(&raw.id)?),
        role: named(&raw.role)?,
        state: named(&raw.state)?,
        attempt: unsigned(raw.attempt)?,
        failures: unsigned(raw.failures)?,
        worker: raw.worker,
        key: raw.key,
    }))
}

/// What became of a result, and which studies it may move.
pub(super) enum Taken {
    /// Stored; the studies whose jobs it finished.
    Stored(Vec<i64>),
    /// Stored before.
    Replay,
    /// Not stored; the study whose attempt thereby failed, if any.
    Refused(String, Option<i64>),
}

/// Takes a result, if it is that of the job's present attempt.
pub(super) async fn complete(work: &mut Work<'_>, worker: WorkerId, result: &Prepared) -> Result<Taken, StoreError> {
    let Some(job) = find_job(work.db, result.job).await? else {
        return Ok(Taken::Refused("there is no such job".into(), None));
    };
    // A result just after expiry still is the present attempt's until another lease is given.
    let waits = matches!(job.state, JobState::Leased | JobState::Delayed | JobState::Ready);
    if waits && job.is_held_by(worker, result.attempt) {
        return store_or_fail(work, worker, job, result).await;
    }
    let reason = match job.state {
        JobState::Succeeded | JobState::Infeasible => return compare(work, worker, &job, result).await,
        JobState::Cancelled => "the study was cancelled",
        JobState::Dead => "the job was given up before",
        _ => "this attempt is no longer the job's present one",
    };
    refuse(work, worker, result, Class::Refused, reason).await?;
    Ok(Taken::Refused(reason.into(), None))
}

async fn store_or_fail(
    work: &mut Work<'_>,
    worker: WorkerId,
    job: JobRow,
    result: &Prepared,
) -> Result<Taken, StoreError> {
    let expected = kind_of(job.role);
    let (state, reason) = match &result.outcome {
        _ if result.kind != expected => {
            let why = format!("the worker returned the result of another kind of job, {:?}", result.kind);
            return fail_unusable(work, worker, job, result, why).await;
        }
        Outcome::Unusable(why) => return fail_unusable(work, worker, job, result, why.clone()).await,
        Outcome::Succeeded => (JobState::Succeeded, None),
        Outcome::Infeasible(reason) => (JobState::Infeasible, Some(reason.as_str())),
    };
    insert_result(work, worker, result).await?;
    finish_job(work.db, job.job, state, reason).await?;
    work.events.push(Event::Completed {
        study: job.study_id,
        job: job.job,
        role: job.role,
        worker,
        outcome: state_name(state),
        wall_s: result.provenance.wall_s,
    });
    let mut studies = vec![job.study];
    if let Some(key) = &job.key {
        studies.extend(share(work, job.job, key, state, reason).await?);
    }
    Ok(Taken::Stored(studies))
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
        fail_attempt(work, &job, &why).await?;
    }
    Ok(Taken::Refused(why, Some(job.study)))
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
    Ok(Taken::Refused(reason.into(), None))
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

async fn insert_result(work: &mut Work<'_>, worker: WorkerId, result: &Prepared) -> Result<(), StoreError> {
    sqlx::query(
        "insert into results (job, attempt, worker, digest, body, summary, wall_s, level, finished_ms)
         values (?, ?, ?, ?, ?, ?, ?, ?, ?)",
    )
    .bind(result.job.0)
    .bind(result.attempt)
    .bind(worker.0.as_bytes().as_slice())
    .bind(result.digest.as_slice())
    .bind(result.body.as_slice())
    .bind(result.summary.as_deref())
    .bind(result.provenance.wall_s)
    .bind(&result.provenance.level)
    .bind(work.now)
    .execute(&mut *work.db)
    .await?;
    Ok(())
}

async fn finish_job(
    db: &mut SqliteConnection,
    job: JobId,
    state: JobState,
    reason: Option<&str>,
) -> Result<(), StoreError> {
    sqlx::query(
        "update jobs set state = ?, reason = ?, lease_until_ms = null, not_before_ms = null, progress = null
         where job = ?",
    )
    .bind(state_name(state))
    .bind(reason)
    .bind(job.0)
    .execute(db)
    .await?;
    Ok(())
}

/// Finishes equal simulations which still wait, in whatever study: what has been
/// flown once is not flown again. Those being flown are left to their workers.
async fn share(
    work: &mut Work<'_>,
    from: JobId,
    key: &[u8],
    state: JobState,
    reason: Option<&str>,
) -> Result<Vec<i64>, StoreError> {
    let shared: Vec<(i64, i64, Vec<u8>)> = sqlx::query_as(
        "update jobs set state = ?1, reason = ?2, result_of = ?3, not_before_ms = null
         where key = ?4 and state in ('ready', 'delayed') and job <> ?3
         returning job, study, (select id from studies as s where s.study = jobs.study)",
    )
    .bind(state_name(state))
    .bind(reason)
    .bind(from.0)
    .bind(key)
    .fetch_all(&mut *work.db)
    .await?;
    let mut studies = Vec::with_capacity(shared.len());
    for (job, study, id) in shared {
        work.events.push(Event::Shared { study: StudyId(uuid(&id)?), job: JobId(job), from });
        studies.push(study);
    }
    Ok(studies)
}
