//! Workers come, are heard of, and go.

use manduca_protocol::ids::WorkerId;

use super::{Operation, StoreError, Work};
use crate::event::Event;

/// A worker introduces itself.
pub(crate) struct Register {
    pub(crate) worker: WorkerId,
    pub(crate) name: String,
    pub(crate) slots: u32,
    pub(crate) level: String,
}

impl Operation for Register {
    type Output = ();

    async fn apply(self, work: &mut Work<'_>) -> Result<(), StoreError> {
        sqlx::query(
            "insert into workers (id, name, slots, level, registered_ms, last_seen_ms) values (?1, ?2, ?3, ?4, ?5, ?5)",
        )
        .bind(self.worker.0.as_bytes().as_slice())
        .bind(&self.name)
        .bind(self.slots)
        .bind(&self.level)
        .bind(work.now)
        .execute(&mut *work.db)
        .await?;
        let (name, slots, level) = (self.name, self.slots, self.level);
        work.events.push(Event::Registered { worker: self.worker, name, slots, level });
        Ok(())
    }
}

/// A worker says goodbye. Saying it twice is as good as once.
pub(crate) struct Deregister {
    pub(crate) worker: WorkerId,
}

impl Operation for Deregister {
    type Output = ();

    async fn apply(self, work: &mut Work<'_>) -> Result<(), StoreError> {
        if !mark_left(work, self.worker).await? {
            return Err(StoreError::UnknownWorker(self.worker));
        }
        let jobs = give_back_leases(work, self.worker).await?;
        work.events.push(Event::Left { worker: self.worker, jobs });
        if jobs > 0 {
            work.events.push(Event::Ready);
        }
        Ok(())
    }
}

async fn mark_left(work: &mut Work<'_>, worker: WorkerId) -> Result<bool, StoreError> {
    let left = sqlx::query("update workers set left_ms = coalesce(left_ms, ?) where id = ?")
        .bind(work.now)
        .bind(worker.0.as_bytes().as_slice())
        .execute(&mut *work.db)
        .await?;
    Ok(left.rows_affected() > 0)
}

/// The jobs are ready at once. No failure is counted; the attempt stays, so that
/// a late result of this worker is still told from the next one's.
async fn give_back_leases(work: &mut Work<'_>, worker: WorkerId) -> Result<u64, StoreError> {
    let returned = sqlx::query(
        "update jobs set state = 'ready', worker = null, lease_until_ms = null, progress = null
         where worker = ? and state = 'leased'",
    )
    .bind(worker.0.as_bytes().as_slice())
    .execute(&mut *work.db)
    .await?;
    Ok(returned.rows_affected())
}

/// Notes that a worker was heard of.
///
/// # Errors
/// When it is not registered, or has said goodbye.
pub(super) async fn touch(work: &mut Work<'_>, worker: WorkerId) -> Result<(), StoreError> {
    let known = sqlx::query("update workers set last_seen_ms = ? where id = ? and left_ms is null")
        .bind(work.now)
        .bind(worker.0.as_bytes().as_slice())
        .execute(&mut *work.db)
        .await?;
    if known.rows_affected() == 0 { Err(StoreError::UnknownWorker(worker)) } else { Ok(()) }
}

/// Adds to what a worker has finished and failed.
pub(super) async fn add_to_tally(
    work: &mut Work<'_>,
    worker: WorkerId,
    completed: u32,
    failed: u32,
) -> Result<(), StoreError> {
    sqlx::query("update workers set completed = completed + ?, failed = failed + ? where id = ?")
        .bind(completed)
        .bind(failed)
        .bind(worker.0.as_bytes().as_slice())
        .execute(&mut *work.db)
        .await?;
    Ok(())
}
