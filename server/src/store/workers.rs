//! Workers come, are heard of, and go.

use std::collections::{BTreeMap, HashMap};

use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::ids::WorkerId;

use super::names::uuid;
use super::{Operation, StoreError, Work};
use crate::config::millis;
use crate::event::Event;
use crate::http::cursor::hex;

/// A worker introduces itself; it computes this coordinator's numbers, or had been refused.
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
            "insert into workers (id, name, slots, level, registered_ms, last_seen_ms, solver_version)
             values (?1, ?2, ?3, ?4, ?5, ?5, ?6)",
        )
        .bind(self.worker.0.as_bytes().as_slice())
        .bind(&self.name)
        .bind(self.slots)
        .bind(&self.level)
        .bind(work.now)
        .bind(SOLVER_VERSION)
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

/// How the coordinator stands to a worker.
#[derive(Debug, Clone, Copy)]
pub(super) struct Standing {
    quarantined: bool,
    pub(super) draining: bool,
}

impl Standing {
    /// Whether it is given jobs.
    pub(super) fn may_work(self) -> bool {
        !self.quarantined && !self.draining
    }
}

/// Notes that workers were heard of; gives those which are registered and have not left.
pub(super) async fn touch(
    work: &mut Work<'_>,
    workers: impl Iterator<Item = WorkerId>,
) -> Result<HashMap<WorkerId, Standing>, StoreError> {
    let named: Vec<String> = workers.map(|worker| hex(worker.0.as_bytes())).collect();
    let named = serde_json::to_string(&named).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    let known: Vec<(Vec<u8>, Option<i64>, bool)> = sqlx::query_as(
        "update workers set last_seen_ms = ?1
         where id in (select unhex(value) from json_each(?2)) and left_ms is null
         returning id, quarantined_until_ms, draining",
    )
    .bind(work.now)
    .bind(named)
    .fetch_all(&mut *work.db)
    .await?;
    let standing = |(id, until, draining): &(Vec<u8>, Option<i64>, bool)| {
        let quarantined = until.is_some_and(|until| until > work.now);
        Ok((WorkerId(uuid(id)?), Standing { quarantined, draining: *draining }))
    };
    known.iter().map(standing).collect()
}

/// What a worker has finished and failed.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tally {
    pub(super) completed: u32,
    pub(super) failed: u32,
}

/// Adds to what workers have finished and failed. One which has failed too often
/// in a row is set aside for a while: it may be the machine. Afterwards one more
/// failure sets it aside again, and one success clears it.
pub(super) async fn add_to_tallies(work: &mut Work<'_>, tallies: &BTreeMap<WorkerId, Tally>) -> Result<(), StoreError> {
    if tallies.is_empty() {
        return Ok(());
    }
    let rows: Vec<_> = tallies.iter().map(|(w, t)| (hex(w.0.as_bytes()), t.completed, t.failed)).collect();
    let rows = serde_json::to_string(&rows).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    let counted: Vec<(Vec<u8>, String, i64)> = sqlx::query_as(
        "update workers set completed = completed + (d.value ->> 1), failed = failed + (d.value ->> 2),
                            strikes = iif(d.value ->> 1 > 0, 0, strikes + (d.value ->> 2))
         from json_each(?) as d where workers.id = unhex(d.value ->> 0)
         returning id, name, strikes",
    )
    .bind(rows)
    .fetch_all(&mut *work.db)
    .await?;
    for (id, name, strikes) in counted {
        if strikes >= i64::from(work.config.strikes) {
            quarantine(work, &id).await?;
            let seconds = work.config.quarantine.as_secs_f64();
            work.events.push(Event::Quarantined { worker: WorkerId(uuid(&id)?), name, strikes, seconds });
        }
    }
    Ok(())
}

async fn quarantine(work: &mut Work<'_>, worker: &[u8]) -> Result<(), StoreError> {
    sqlx::query("update workers set quarantined_until_ms = ?, strikes = ? where id = ?")
        .bind(work.now + millis(work.config.quarantine))
        .bind(work.config.strikes.saturating_sub(1))
        .bind(worker)
        .execute(&mut *work.db)
        .await?;
    Ok(())
}

/// Asks a worker to finish what it has and leave. Asking twice is as good as once.
pub(crate) struct Drain {
    pub(crate) worker: WorkerId,
}

impl Operation for Drain {
    type Output = ();

    async fn apply(self, work: &mut Work<'_>) -> Result<(), StoreError> {
        let asked = sqlx::query("update workers set draining = 1 where id = ? and left_ms is null")
            .bind(self.worker.0.as_bytes().as_slice())
            .execute(&mut *work.db)
            .await?;
        if asked.rows_affected() == 0 {
            return Err(StoreError::UnknownWorker(self.worker));
        }
        work.events.push(Event::Draining { worker: self.worker });
        // It may be waiting for work: it is told at once.
        work.events.push(Event::Ready);
        Ok(())
    }
}
