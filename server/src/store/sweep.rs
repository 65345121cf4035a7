//! Time passes: leases expire, waits end.

use std::collections::BTreeSet;

use manduca_protocol::ids::{JobId, WorkerId};
use manduca_protocol::task::JobKind;
use manduca_protocol::worker::Fault;
use sqlx::sqlite::SqliteConnection;

use super::advance::advance_ended;
use super::blame::Failed;
use super::complete::find_job;
use super::fail::{Cause, fail_attempt};
use super::names::{kind_of, named, uuid};
use super::pace::{Pace, make_up};
use super::workers::{Tallies, add_to_tallies};
use super::{Operation, StoreError, Work};
use crate::config::millis;
use crate::event::Event;

/// Most leases expired in one operation: others wait behind it.
const MOST: i64 = 1000;

/// Looks for what is due; gives when it has come by.
pub(crate) struct Sweep {
    /// When it last came by.
    pub(crate) pace: Pace,
}

impl Operation for Sweep {
    type Output = Pace;

    async fn apply(self, work: &mut Work<'_>) -> Result<Pace, StoreError> {
        let (pace, absence) = self.pace.next(work.now, work.config);
        if let Some(absence) = absence {
            make_up(work, absence).await?;
        }
        let (mut moved, mut tallies) = (BTreeSet::new(), Tallies::new());
        for (job, worker) in list_expired(work.db, work.now).await? {
            let Some(job) = find_job(work.db, JobId(job)).await? else { continue };
            let worker = worker.unwrap_or_else(|| "unknown".into());
            let reason = format!(
                "the lease expired: worker `{worker}` was not heard of for {} s",
                work.config.lease.as_secs_f64()
            );
            fail_attempt(work, &job, Cause::Expired(&reason), &mut tallies).await?;
            moved.insert(job.study);
        }
        for (job, kind) in list_overdue(work).await? {
            let Some(job) = find_job(work.db, JobId(job)).await? else { continue };
            let limit = work.config.run_limits.of(kind).as_secs_f64();
            let reason = format!("the attempt exceeded its run limit of {limit} s, and its worker did not end it");
            let worker = WorkerId(job.worker.as_deref().map(uuid).transpose()?.unwrap_or_default());
            let failed = Failed { worker, fault: Fault::Machine, reason: &reason };
            fail_attempt(work, &job, Cause::Failed(failed), &mut tallies).await?;
            moved.insert(job.study);
        }
        add_to_tallies(work, &tallies).await?;
        advance_ended(work, &moved).await?;
        if wake_delayed(work).await? > 0 {
            work.events.push(Event::Ready);
        }
        Ok(pace)
    }
}

async fn list_expired(db: &mut SqliteConnection, now: i64) -> Result<Vec<(i64, Option<String>)>, StoreError> {
    let expired = sqlx::query_as(
        "select j.job, w.name from jobs as j left join workers as w on w.id = j.worker
         where j.state = 'leased' and j.lease_until_ms <= ? order by j.lease_until_ms limit 0 + ?",
    )
    .bind(now)
    .bind(MOST)
    .fetch_all(db)
    .await?;
    Ok(expired)
}

/// Leased jobs which compute for longer than their kind may, renewed or not. The
/// jobs leased are few: one per slot.
async fn list_overdue(work: &mut Work<'_>) -> Result<Vec<(i64, JobKind)>, StoreError> {
    let grace = millis(work.config.run_grace);
    let shortest = JobKind::ALL.iter().map(|&kind| work.config.run_limits.of(kind)).min().unwrap_or_default();
    let long: Vec<(i64, String, i64)> = sqlx::query_as(
        "select job, role, leased_ms from jobs
         where state = 'leased' and leased_ms <= ? order by lease_until_ms limit 0 + ?",
    )
    .bind(work.now - grace - millis(shortest))
    .bind(MOST)
    .fetch_all(&mut *work.db)
    .await?;
    let mut overdue = Vec::new();
    for (job, role, since) in long {
        let kind = kind_of(named(&role)?);
        if work.now - since >= millis(work.config.run_limits.of(kind)) + grace {
            overdue.push((job, kind));
        }
    }
    Ok(overdue)
}

async fn wake_delayed(work: &mut Work<'_>) -> Result<u64, StoreError> {
    let woken = sqlx::query(
        "update jobs set state = 'ready', not_before_ms = null where state = 'delayed' and not_before_ms <= ?",
    )
    .bind(work.now)
    .execute(&mut *work.db)
    .await?;
    Ok(woken.rows_affected())
}
