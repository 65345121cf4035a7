//! Time passes: leases expire, waits end.

use std::collections::BTreeSet;

use manduca_protocol::ids::JobId;
use sqlx::sqlite::SqliteConnection;

use super::advance::advance_ended;
use super::complete::find_job;
use super::fail::fail_attempt;
use super::{Operation, StoreError, Work};
use crate::event::Event;

/// Most leases expired in one operation: others wait behind it.
const MOST: i64 = 1000;

/// Looks for what is due.
pub(crate) struct Sweep;

impl Operation for Sweep {
    type Output = ();

    async fn apply(self, work: &mut Work<'_>) -> Result<(), StoreError> {
        let mut moved = BTreeSet::new();
        for (job, worker) in list_expired(work.db, work.now).await? {
            let Some(job) = find_job(work.db, JobId(job)).await? else { continue };
            let worker = worker.unwrap_or_else(|| "unknown".into());
            let reason = format!(
                "the lease expired: worker `{worker}` was not heard of for {} s",
                work.config.lease.as_secs_f64()
            );
            fail_attempt(work, &job, &reason).await?;
            moved.insert(job.study);
        }
        advance_ended(work, &moved).await?;
        if wake_delayed(work).await? > 0 {
            work.events.push(Event::Ready);
        }
        Ok(())
    }
}

async fn list_expired(db: &mut SqliteConnection, now: i64) -> Result<Vec<(i64, Option<String>)>, StoreError> {
    let expired = sqlx::query_as(
        "select j.job, w.name from jobs as j left join workers as w on w.id = j.worker
         where j.state = 'leased' and j.lease_until_ms <= ? order by j.lease_until_ms limit ?",
    )
    .bind(now)
    .bind(MOST)
    .fetch_all(db)
    .await?;
    Ok(expired)
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
