//! Whose fault failures are: the job's, or a machine's. docs/design/0001-who-did-what.md says why so.

use std::collections::{BTreeMap, BTreeSet};

use manduca_protocol::ids::{JobId, WorkerId};
use manduca_protocol::worker::Fault;
use sqlx::sqlite::SqliteConnection;

use super::names::uuid;
use super::workers::{DOUBT_MS, Tallies, alive_since};
use super::{StoreError, Work};

/// Most failures kept of one job.
const MOST_KEPT: i64 = 16;
/// How long a job which failed too often waits for a credible worker to try it, ms.
const PATIENCE_MS: i64 = 600_000;
/// Longest reason kept, characters.
const LONGEST_REASON: usize = 300;

/// An attempt that failed, with what its worker blames.
#[derive(Debug, Clone, Copy)]
pub(super) struct Failed<'r> {
    pub(super) worker: WorkerId,
    pub(super) fault: Fault,
    pub(super) reason: &'r str,
}

/// Those who failed a job, and those who could still try it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, sqlx::FromRow)]
struct Jury {
    /// Workers that failed the job.
    workers: i64,
    /// Tokens of these workers.
    tokens: i64,
    /// Workers among them that blame the task.
    blaming: i64,
    /// Whether one of them has finished more than one attempt for four that it failed.
    credible: bool,
    /// Whether another worker may be given jobs,
    others: bool,
    /// is credible,
    eyes: bool,
    /// belongs to none of these tokens,
    strangers: bool,
    /// or both.
    strange_eyes: bool,
    /// Whether those others had time enough to try it.
    overdue: bool,
}

impl Jury {
    /// Whether different witnesses failed the job, of which one is credible if there are any.
    /// Workers of one token are one witness while workers of other tokens are there: whoever has
    /// a token can register any number of workers.
    fn agrees(&self) -> bool {
        let witnesses = if self.tokens > 1 || self.strangers { self.tokens } else { self.workers };
        witnesses > 1 && (self.credible || !self.eyes)
    }

    /// Whether nobody is left whose attempt would tell more.
    fn is_complete(&self) -> bool {
        let missing = if self.tokens > 1 || !self.strangers { self.eyes } else { self.strange_eyes };
        !missing || self.overdue
    }

    /// Whether the job is given up after so many failures.
    fn gives_up(&self, fault: Fault, failures: u32, most: u32) -> bool {
        let by_nature = self.agrees() && self.blaming > 1;
        let alone = !self.others && fault == Fault::Refused;
        by_nature || alone || failures >= most && (self.agrees() || self.is_complete())
    }
}

/// Keeps a failure and settles what follows from it for the workers. Returns whether the job,
/// with now so many failures, is given up.
pub(super) async fn note(
    work: &mut Work<'_>,
    job: JobId,
    attempt: u32,
    failures: u32,
    failed: Failed<'_>,
    tallies: &mut Tallies,
) -> Result<bool, StoreError> {
    insert(work, job, attempt, failed).await?;
    let jury = find_jury(work, job).await?;
    if jury.agrees() {
        // Another failed it too: the machines are not to blame.
        for worker in acquit(work.db, job).await? {
            tallies.entry(worker).or_default().struck -= 1;
        }
    } else if failed.fault == Fault::Machine && strike(work.db, job, attempt, failed.worker).await? {
        tallies.entry(failed.worker).or_default().struck += 1;
    }
    let given_up = jury.gives_up(failed.fault, failures, work.config.max_attempts);
    if given_up {
        sqlx::query("update failures set open = 0 where job = ?").bind(job.0).execute(&mut *work.db).await?;
    }
    Ok(given_up)
}

async fn insert(work: &mut Work<'_>, job: JobId, attempt: u32, failed: Failed<'_>) -> Result<(), StoreError> {
    let reason: String = failed.reason.chars().take(LONGEST_REASON).collect();
    sqlx::query(
        "insert into failures (job, attempt, worker, fault, reason, failed_ms)
         select ?1, ?2, ?3, ?4, ?5, ?6 where (select count(*) from failures where job = ?1) < ?7
         on conflict (job, attempt) do nothing",
    )
    .bind(job.0)
    .bind(attempt)
    .bind(failed.worker.0.as_bytes().as_slice())
    .bind(failed.fault.name())
    .bind(reason)
    .bind(work.now)
    .bind(MOST_KEPT)
    .execute(&mut *work.db)
    .await?;
    Ok(())
}

async fn find_jury(work: &mut Work<'_>, job: JobId) -> Result<Jury, StoreError> {
    let jury = sqlx::query_as(
        "with failed as materialized (
             select f.worker, coalesce(w.token, '') as token, coalesce(4 * w.completed > w.failed, 0) as credible,
                    max(f.fault <> 'machine') as blames, min(f.failed_ms) as since
             from failures as f left join workers as w on w.id = f.worker where f.job = ?1 group by f.worker),
         others as materialized (
             select 4 * completed > failed as credible,
                    coalesce(token, '') not in (select token from failed) as stranger
             from workers where left_ms is null and last_seen_ms >= ?2 and draining = 0
               and coalesce(quarantined_until_ms, 0) <= ?3 and id not in (select worker from failed))
         select count(*) as workers, count(distinct token) as tokens, coalesce(sum(blames), 0) as blaming,
                coalesce(max(credible), 0) as credible, exists (select 1 from others) as others,
                exists (select 1 from others where credible) as eyes,
                exists (select 1 from others where stranger) as strangers,
                exists (select 1 from others where stranger and credible) as strange_eyes,
                coalesce(min(since), ?3) <= ?3 - ?4 as overdue
         from failed",
    )
    .bind(job.0)
    .bind(alive_since(work))
    .bind(work.now)
    .bind(PATIENCE_MS)
    .fetch_one(&mut *work.db)
    .await?;
    Ok(jury)
}

/// Takes the strikes for a job back; returns the workers that had one.
async fn acquit(db: &mut SqliteConnection, job: JobId) -> Result<BTreeSet<WorkerId>, StoreError> {
    let workers: Vec<Vec<u8>> =
        sqlx::query_scalar("update failures set struck = 0 where job = ? and struck = 1 returning worker")
            .bind(job.0)
            .fetch_all(db)
            .await?;
    workers.iter().map(|id| uuid(id).map(WorkerId)).collect()
}

/// Counts a failure as a strike, unless the worker has one for this job; returns whether it does.
async fn strike(db: &mut SqliteConnection, job: JobId, attempt: u32, worker: WorkerId) -> Result<bool, StoreError> {
    let struck = sqlx::query(
        "update failures set struck = 1 where job = ?1 and attempt = ?2
         and not exists (select 1 from failures as f where f.job = ?1 and f.worker = ?3 and f.struck = 1)",
    )
    .bind(job.0)
    .bind(attempt)
    .bind(worker.0.as_bytes().as_slice())
    .execute(db)
    .await?;
    Ok(struck.rows_affected() > 0)
}

/// Strikes those who failed jobs which others have now finished, once per job.
pub(super) async fn contradict(
    work: &mut Work<'_>,
    finished: &BTreeMap<i64, WorkerId>,
    tallies: &mut Tallies,
) -> Result<(), StoreError> {
    if finished.is_empty() {
        return Ok(());
    }
    let jobs: Vec<_> = finished.keys().collect();
    let jobs = serde_json::to_string(&jobs).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    let rows: Vec<(i64, Vec<u8>, bool)> = sqlx::query_as(
        "delete from failures where job in (select value from json_each(?)) returning job, worker, struck",
    )
    .bind(jobs)
    .fetch_all(&mut *work.db)
    .await?;
    let mut wrong: BTreeMap<(i64, WorkerId), bool> = BTreeMap::new();
    for (job, worker, struck) in rows {
        *wrong.entry((job, WorkerId(uuid(&worker)?))).or_default() |= struck;
    }
    for ((job, worker), struck) in wrong {
        if !struck && finished.get(&job) != Some(&worker) {
            tallies.entry(worker).or_default().struck += 1;
        }
    }
    Ok(())
}

/// Which workers failed these jobs lately: others, if there are any, try them first.
pub(super) async fn list_failed(
    work: &mut Work<'_>,
    jobs: &[i64],
) -> Result<BTreeMap<i64, BTreeSet<WorkerId>>, StoreError> {
    let jobs = serde_json::to_string(jobs).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    let rows: Vec<(i64, Vec<u8>)> = sqlx::query_as(
        "select f.job, f.worker from json_each(?) as d cross join failures as f on f.job = d.value
             where f.failed_ms > ?",
    )
    .bind(jobs)
    .bind(work.now - DOUBT_MS)
    .fetch_all(&mut *work.db)
    .await?;
    let mut failed: BTreeMap<i64, BTreeSet<WorkerId>> = BTreeMap::new();
    for (job, worker) in rows {
        failed.entry(job).or_default().insert(WorkerId(uuid(&worker)?));
    }
    Ok(failed)
}

/// Forgets who failed the dead jobs of a role, which are tried again.
pub(super) async fn forget(db: &mut SqliteConnection, study: i64, role: &str) -> Result<(), StoreError> {
    sqlx::query(
        "delete from failures where job in (select job from jobs where state = 'dead' and study = ? and role = ?)",
    )
    .bind(study)
    .bind(role)
    .execute(db)
    .await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALONE: Jury = Jury {
        workers: 1,
        tokens: 1,
        blaming: 1,
        credible: false,
        others: false,
        eyes: false,
        strangers: false,
        strange_eyes: false,
        overdue: false,
    };

    #[test]
    fn a_lone_worker_is_believed_for_want_of_others() {
        assert!(ALONE.gives_up(Fault::Refused, 1, 3) && !ALONE.agrees());
        assert!(!ALONE.gives_up(Fault::Failed, 1, 3) && !ALONE.gives_up(Fault::Machine, 2, 3));
        assert!(ALONE.gives_up(Fault::Machine, 3, 3));
    }

    #[test]
    fn two_workers_who_blame_the_task_are_believed_if_one_is_credible() {
        let two = Jury { workers: 2, blaming: 2, others: true, ..ALONE };
        assert!(two.agrees() && two.gives_up(Fault::Failed, 2, 3), "nobody more credible is there");
        let watched = Jury { eyes: true, ..two };
        assert!(!watched.agrees() && !watched.gives_up(Fault::Refused, 99, 3), "one who may know better is there");
        assert!(Jury { credible: true, ..watched }.gives_up(Fault::Failed, 2, 3));
        let machines = Jury { blaming: 1, credible: true, ..watched };
        assert!(
            machines.agrees() && !machines.gives_up(Fault::Machine, 2, 3) && machines.gives_up(Fault::Machine, 3, 3)
        );
    }

    #[test]
    fn workers_of_one_token_are_one_witness_beside_those_of_others() {
        let many = Jury { workers: 5, blaming: 5, credible: true, others: true, strangers: true, ..ALONE };
        assert!(!many.agrees() && !many.gives_up(Fault::Refused, 2, 3));
        assert!(many.gives_up(Fault::Refused, 3, 3), "the stranger is not credible: as before, after the last attempt");
        let watched = Jury { eyes: true, strange_eyes: true, ..many };
        assert!(!watched.gives_up(Fault::Refused, 99, 3));
        assert!(Jury { tokens: 2, ..watched }.gives_up(Fault::Refused, 2, 3));
        assert!(Jury { overdue: true, ..watched }.gives_up(Fault::Machine, 3, 3), "the stranger has not found time");
    }
}
