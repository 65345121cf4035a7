//! The coordinator starts on a store another run has left.

use manduca_numerics::simulation::SOLVER_VERSION;
use sqlx::sqlite::SqliteConnection;

use super::advance::{BEFORE_KEPT, end, find_study};
use super::unreadable::{advance_or_fail, fail_unreadable};
use super::{Operation, StoreError, Work};
use crate::config::millis;
use crate::event::Event;

/// Makes times of the last run fit this one's clock, and moves on what could
/// have moved.
pub(crate) struct Recover;

impl Operation for Recover {
    type Output = ();

    async fn apply(self, work: &mut Work<'_>) -> Result<(), StoreError> {
        dismiss_other_numbers(work).await?;
        let leases = renew_all(work).await?;
        shorten_waits(work).await?;
        shorten_quarantines(work).await?;
        for study in list_running(work.db).await? {
            let row = match find_study(work.db, study).await {
                Ok(row) => row,
                Err(StoreError::Corrupt(why)) => {
                    fail_unreadable(work, study, &why).await?;
                    continue;
                }
                Err(error) => return Err(error),
            };
            match row.check_numbers() {
                Ok(()) => advance_or_fail(work, study).await?,
                Err(why) => end(work, &row, "failed", Some(why.to_string())).await?,
            }
        }
        work.events.push(Event::Recovered { leases });
        Ok(())
    }
}

/// Workers of another version have to introduce themselves again, and are told so then. What they
/// flew cannot be audited: it would differ.
async fn dismiss_other_numbers(work: &mut Work<'_>) -> Result<(), StoreError> {
    sqlx::query(
        "update jobs set state = 'cancelled', lease_until_ms = null, not_before_ms = null, progress = null
         where role = 'audit' and state in ('ready', 'delayed', 'leased')
           and study in (select study from studies where coalesce(solver_version, ?1) <> ?2)",
    )
    .bind(BEFORE_KEPT)
    .bind(SOLVER_VERSION)
    .execute(&mut *work.db)
    .await?;
    sqlx::query(
        "update audits set verdict = 'undecided'
         where verdict = 'disputed' and study in (select study from studies where coalesce(solver_version, ?1) <> ?2)",
    )
    .bind(BEFORE_KEPT)
    .bind(SOLVER_VERSION)
    .execute(&mut *work.db)
    .await?;
    sqlx::query("update workers set left_ms = ?1 where left_ms is null and coalesce(solver_version, ?2) <> ?3")
        .bind(work.now)
        .bind(BEFORE_KEPT)
        .bind(SOLVER_VERSION)
        .execute(&mut *work.db)
        .await?;
    Ok(())
}

/// Workers could not renew while nobody was here: every lease gets a full term.
async fn renew_all(work: &mut Work<'_>) -> Result<u64, StoreError> {
    // Those whose result waits to be checked are nobody's to renew.
    let renewed = sqlx::query(
        "update jobs set leased_ms = ?2,
                         lease_until_ms = iif(exists (select 1 from unchecked_results as u where u.job = jobs.job), ?3, ?1)
         where state = 'leased'",
    )
        .bind(work.now + work.config.lease_ms())
        .bind(work.now)
        .bind(work.now + millis(work.config.check_limit))
        .execute(&mut *work.db)
        .await?;
    Ok(renewed.rows_affected())
}

/// A wall clock set back between two runs would make waits endless.
async fn shorten_waits(work: &mut Work<'_>) -> Result<(), StoreError> {
    sqlx::query("update jobs set not_before_ms = min(not_before_ms, ?) where state = 'delayed'")
        .bind(work.now + millis(work.config.max_backoff))
        .execute(&mut *work.db)
        .await?;
    Ok(())
}

async fn shorten_quarantines(work: &mut Work<'_>) -> Result<(), StoreError> {
    sqlx::query(
        "update workers set quarantined_until_ms = min(quarantined_until_ms, ?)
         where left_ms is null and quarantined_until_ms is not null",
    )
    .bind(work.now + millis(work.config.quarantine))
    .execute(&mut *work.db)
    .await?;
    Ok(())
}

async fn list_running(db: &mut SqliteConnection) -> Result<Vec<i64>, StoreError> {
    Ok(sqlx::query_scalar("select study from studies where condition = 'running' order by study").fetch_all(db).await?)
}
