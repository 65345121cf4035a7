//! Workers come, are heard of, and go.

use std::collections::{BTreeMap, HashSet};

use manduca_protocol::ids::WorkerId;

use super::names::uuid;
use super::{Operation, StoreError, Work};
use crate::event::Event;
use crate::http::cursor::hex;

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

/// Notes that workers were heard of; gives those which are registered and have not left.
pub(super) async fn touch(
    work: &mut Work<'_>,
    workers: impl Iterator<Item = WorkerId>,
) -> Result<HashSet<WorkerId>, StoreError> {
    let named: Vec<String> = workers.map(|worker| hex(worker.0.as_bytes())).collect();
    let named = serde_json::to_string(&named).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    let known: Vec<Vec<u8>> = sqlx::query_scalar(
        "update workers set last_seen_ms = ?1
         where id in (select unhex(value) from json_each(?2)) and left_ms is null returning id",
    )
    .bind(work.now)
    .bind(named)
    .fetch_all(&mut *work.db)
    .await?;
    known.iter().map(|id| Ok(WorkerId(uuid(id)?))).collect()
}

/// What a worker has finished and failed.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tally {
    pub(super) completed: u32,
    pub(super) failed: u32,
}

/// Adds to what workers have finished and failed.
pub(super) async fn add_to_tallies(work: &mut Work<'_>, tallies: &BTreeMap<WorkerId, Tally>) -> Result<(), StoreError> {
    if tallies.is_empty() {
        return Ok(());
    }
    let rows: Vec<_> = tallies.iter().map(|(w, t)| (hex(w.0.as_bytes()), t.completed, t.failed)).collect();
    let rows = serde_json::to_string(&rows).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    sqlx::query(
        "update workers set completed = completed + (d.value ->> 1), failed = failed + (d.value ->> 2)
         from json_each(?) as d where workers.id = unhex(d.value ->> 0)",
    )
    .bind(rows)
    .execute(&mut *work.db)
    .await?;
    Ok(())
}
