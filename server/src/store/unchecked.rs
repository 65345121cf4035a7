//! Results that are on disk and not believed yet. Trainings, optima and rounds of searches are
//! acknowledged at once and checked beside the requests; their jobs stay leased meanwhile.

use manduca_protocol::ids::{JobId, WorkerId};
use manduca_protocol::task::{JobKind, Provenance};
use manduca_protocol::view::{JobRole, JobState};
use manduca_protocol::worker::Fault;

use super::advance::advance_ended;
use super::blame::Failed;
use super::complete::{JobRow, Outcome, Prepared, find_job};
use super::disown::disown;
use super::evidence::{Class, refuse, settle};
use super::exchange::Effects;
use super::exchange::results::{Book, Finish, fail_unusable, store};
use super::names::{kind_of, named, role_name, unsigned, uuid};
use super::unreadable::fail_unreadable;
use super::workers::add_to_tallies;
use super::{Operation, Store, StoreError, Work};
use crate::claims;
use crate::config::millis;
use crate::event::Event;

/// What became of a result that is to be checked.
pub(super) enum Kept {
    /// It waits from now on.
    Anew,
    /// It waits already.
    Before,
    /// Another result of the same attempt waits.
    Another,
}

/// Keeps a result of a job's present attempt until it is checked.
pub(super) async fn keep(
    work: &mut Work<'_>,
    job: &mut JobRow,
    worker: WorkerId,
    result: &Prepared,
) -> Result<Kept, StoreError> {
    let waits: Option<(Vec<u8>, i64)> = sqlx::query_as("select digest, attempt from unchecked_results where job = ?")
        .bind(result.job.0)
        .fetch_optional(&mut *work.db)
        .await?;
    if let Some((digest, _)) = waits.filter(|(_, attempt)| *attempt == i64::from(result.attempt)) {
        return Ok(if digest == result.digest { Kept::Before } else { Kept::Another });
    }
    insert(work, worker, result).await?;
    // Its lease may have expired a moment ago; nobody else is to begin it.
    sqlx::query(
        "update jobs set state = 'leased', lease_until_ms = ?, leased_ms = ?, not_before_ms = null, progress = null
         where job = ?",
    )
    .bind(work.now + millis(work.config.check_limit))
    .bind(work.now)
    .bind(result.job.0)
    .execute(&mut *work.db)
    .await?;
    job.state = JobState::Leased;
    work.events.push(Event::Unchecked { study: job.study_id, job: job.job, role: job.role, worker });
    Ok(Kept::Anew)
}

async fn insert(work: &mut Work<'_>, worker: WorkerId, result: &Prepared) -> Result<(), StoreError> {
    sqlx::query(
        "insert or replace into unchecked_results (job, attempt, worker, digest, body, summary, wall_s, level, came_ms)
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

#[derive(Debug, sqlx::FromRow)]
struct Raw {
    role: String,
    attempt: i64,
    worker: Vec<u8>,
    digest: Vec<u8>,
    body: Vec<u8>,
    summary: Option<String>,
    wall_s: f64,
    level: String,
}

/// A result that waits to be checked.
#[derive(Debug, Clone)]
pub(crate) struct Unchecked {
    pub(super) worker: WorkerId,
    pub(crate) result: Prepared,
}

const ONE: &str = "select j.role, u.attempt, u.worker, u.digest, u.body, u.summary, u.wall_s, u.level
    from unchecked_results as u cross join jobs as j on j.job = u.job where u.job = ?";

fn parsed(job: JobId, raw: Raw) -> Result<Unchecked, StoreError> {
    let role: JobRole = named(&raw.role)?;
    let digest = raw.digest.try_into().map_err(|_| StoreError::Corrupt("the digest of a result is cut".into()))?;
    let result = Prepared {
        job,
        attempt: unsigned(raw.attempt)?,
        kind: kind_of(role),
        outcome: Outcome::Succeeded,
        flown: None,
        digest,
        body: raw.body,
        summary: raw.summary,
        provenance: Provenance { wall_s: raw.wall_s, level: raw.level },
    };
    Ok(Unchecked { worker: WorkerId(uuid(&raw.worker)?), result })
}

impl Store {
    /// The result that has waited longest to be checked, among trainings or among all others.
    pub(crate) async fn next_unchecked(&self, kind: JobKind) -> Result<Option<Unchecked>, StoreError> {
        let job: Option<i64> = sqlx::query_scalar(
            "select u.job from unchecked_results as u cross join jobs as j on j.job = u.job
             where (j.role = ?1) = ?2 order by u.came_ms, u.job limit 1",
        )
        .bind(role_name(JobRole::Train))
        .bind(kind == JobKind::Train)
        .fetch_optional(self.readers())
        .await?;
        let Some(job) = job else { return Ok(None) };
        let raw: Option<Raw> = sqlx::query_as(ONE).bind(job).fetch_optional(self.readers()).await?;
        raw.map(|raw| parsed(JobId(job), raw)).transpose()
    }
}

/// A result was checked.
pub(crate) struct Checked {
    pub(crate) job: JobId,
    pub(crate) attempt: u32,
    /// Why it is of no use, if it is not.
    pub(crate) fault: Option<claims::Fault>,
}

impl Operation for Checked {
    type Output = ();

    async fn apply(self, work: &mut Work<'_>) -> Result<(), StoreError> {
        let raw: Option<Raw> = sqlx::query_as(ONE).bind(self.job.0).fetch_optional(&mut *work.db).await?;
        let Some(raw) = raw else { return Ok(()) };
        let Unchecked { worker, result, .. } = parsed(self.job, raw)?;
        let Some(mut job) = find_job(work.db, self.job).await? else { return Ok(()) };
        if self.attempt != result.attempt {
            return Ok(());
        }
        // Another attempt may have begun: this result is nobody's any more.
        if !job.is_held_by(worker, result.attempt) || job.state != JobState::Leased {
            sqlx::query("delete from unchecked_results where job = ?").bind(self.job.0).execute(&mut *work.db).await?;
            return Ok(());
        }
        let mut effects = Effects::default();
        match self.fault {
            None => {
                let ended = (JobState::Succeeded, None);
                let finished = Finish::of(&mut job, worker, &result, ended, &mut effects, work.events);
                store(work, vec![finished], &mut Book::default(), &mut effects).await?;
            }
            Some(claims::Fault::Unreadable(why)) => {
                give_back(work, self.job).await?;
                return fail_unreadable(work, job.study, &why).await;
            }
            Some(fault) => {
                let why = fault.to_string();
                refuse(work, &mut effects.evidence, worker, &result, Class::Refused, &why).await?;
                let blamed = match &fault {
                    claims::Fault::Poor(_) => Fault::Refused,
                    _ => Fault::Machine,
                };
                fail_unusable(work, &job, Failed { worker, fault: blamed, reason: &why }, &mut effects).await?;
                forget_holder(work, self.job).await?;
                // Nothing of who claims what is not so is believed.
                if let claims::Fault::False(why) = &fault {
                    disown(work, worker, &format!("its result of job {}: {why}", self.job)).await?;
                }
            }
        }
        settle(work, std::mem::take(&mut effects.evidence)).await?;
        add_to_tallies(work, &effects.tallies).await?;
        advance_ended(work, &effects.moved).await?;
        work.events.push(Event::Ready);
        Ok(())
    }
}

/// The job waits for whatever becomes of its study.
async fn give_back(work: &mut Work<'_>, job: JobId) -> Result<(), StoreError> {
    sqlx::query("update jobs set state = 'ready', worker = null, lease_until_ms = null where job = ?")
        .bind(job.0)
        .execute(&mut *work.db)
        .await?;
    Ok(())
}

/// The same result, sent again because an answer was lost, is then one of an attempt that has ended.
async fn forget_holder(work: &mut Work<'_>, job: JobId) -> Result<(), StoreError> {
    sqlx::query("update jobs set worker = null where job = ? and state <> 'leased'")
        .bind(job.0)
        .execute(&mut *work.db)
        .await?;
    Ok(())
}
