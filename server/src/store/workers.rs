//! Workers come, are heard of, and go.

use std::collections::{BTreeMap, HashMap};

use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::ids::WorkerId;

use super::names::uuid;
use super::{Operation, StoreError, Work};
use crate::auth::Caller;
use crate::config::millis;
use crate::event::Event;
use crate::http::cursor::hex;

/// A worker introduces itself; it computes this coordinator's numbers, or had been refused.
pub(crate) struct Register {
    pub(crate) worker: WorkerId,
    pub(crate) name: String,
    pub(crate) slots: u32,
    pub(crate) level: String,
    /// Name of the token that registers it.
    pub(crate) token: Option<String>,
}

impl Operation for Register {
    type Output = ();

    async fn apply(self, work: &mut Work<'_>) -> Result<(), StoreError> {
        sqlx::query(
            "insert into workers (id, name, slots, level, registered_ms, last_seen_ms, solver_version, token)
             values (?1, ?2, ?3, ?4, ?5, ?5, ?6, ?7)",
        )
        .bind(self.worker.0.as_bytes().as_slice())
        .bind(&self.name)
        .bind(self.slots)
        .bind(&self.level)
        .bind(work.now)
        .bind(SOLVER_VERSION)
        .bind(&self.token)
        .execute(&mut *work.db)
        .await?;
        let (name, slots, level) = (self.name, self.slots, self.level);
        work.events.push(Event::Registered { worker: self.worker, name, slots, level, by: self.token });
        Ok(())
    }
}

/// A worker says goodbye. Saying it twice is as good as once.
pub(crate) struct Deregister {
    pub(crate) worker: WorkerId,
    pub(crate) caller: Caller,
}

impl Operation for Deregister {
    type Output = ();

    async fn apply(self, work: &mut Work<'_>) -> Result<(), StoreError> {
        let token = find_token(work, self.worker).await?.ok_or(StoreError::UnknownWorker(self.worker))?;
        if !self.caller.is_admin() && !self.caller.speaks_for(token.as_deref()) {
            return Err(of_another_token(self.worker));
        }
        mark_left(work, self.worker).await?;
        let jobs = give_back_leases(work, self.worker).await?;
        work.events.push(Event::Left { worker: self.worker, jobs, by: self.caller.named() });
        if jobs > 0 {
            work.events.push(Event::Ready);
        }
        Ok(())
    }
}

/// The name of the token that registered a worker, if the worker is known.
async fn find_token(work: &mut Work<'_>, worker: WorkerId) -> Result<Option<Option<String>>, StoreError> {
    let found = sqlx::query_scalar("select token from workers where id = ?")
        .bind(worker.0.as_bytes().as_slice())
        .fetch_optional(&mut *work.db)
        .await?;
    Ok(found)
}

/// The refusal of what only the token of a worker may do.
pub(super) fn of_another_token(worker: WorkerId) -> StoreError {
    StoreError::AnotherToken(format!("worker {worker} was registered with another token, which alone speaks for it"))
}

async fn mark_left(work: &mut Work<'_>, worker: WorkerId) -> Result<(), StoreError> {
    sqlx::query("update workers set left_ms = coalesce(left_ms, ?) where id = ?")
        .bind(work.now)
        .bind(worker.0.as_bytes().as_slice())
        .execute(&mut *work.db)
        .await?;
    Ok(())
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
#[derive(Debug, Clone)]
pub(super) struct Standing {
    /// The token that alone speaks for it.
    pub(super) token: Option<String>,
    quarantined: bool,
    pub(super) draining: bool,
}

impl Standing {
    /// Whether it is given jobs.
    pub(super) fn may_work(&self) -> bool {
        !self.quarantined && !self.draining
    }
}

#[derive(sqlx::FromRow)]
struct RawStanding {
    id: Vec<u8>,
    quarantined_until_ms: Option<i64>,
    draining: bool,
    token: Option<String>,
}

/// Notes that workers were heard of, each from this caller. Returns those which are registered, have
/// not left and are the caller's own; one without a token becomes that.
pub(super) async fn touch(
    work: &mut Work<'_>,
    workers: impl Iterator<Item = (WorkerId, &Caller)>,
) -> Result<HashMap<WorkerId, Standing>, StoreError> {
    let named: Vec<_> = workers.map(|(worker, caller)| (hex(worker.0.as_bytes()), caller.name())).collect();
    let named = serde_json::to_string(&named).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    let known: Vec<RawStanding> = sqlx::query_as(
        "update workers set last_seen_ms = ?1, token = coalesce(token, d.value ->> 1)
         from json_each(?2) as d
         where workers.id = unhex(d.value ->> 0) and left_ms is null
           and (token is null or d.value ->> 1 is null or token = d.value ->> 1)
         returning id, quarantined_until_ms, draining, token",
    )
    .bind(work.now)
    .bind(named)
    .fetch_all(&mut *work.db)
    .await?;
    known.into_iter().map(|raw| standing(raw, work.now)).collect()
}

fn standing(raw: RawStanding, now: i64) -> Result<(WorkerId, Standing), StoreError> {
    let quarantined = raw.quarantined_until_ms.is_some_and(|until| until > now);
    let standing = Standing { token: raw.token, quarantined, draining: raw.draining };
    Ok((WorkerId(uuid(&raw.id)?), standing))
}

/// Why a worker is not among those [`touch`] returned.
pub(super) async fn why_unknown(work: &mut Work<'_>, worker: WorkerId) -> Result<StoreError, StoreError> {
    let there: Option<i64> = sqlx::query_scalar("select 1 from workers where id = ? and left_ms is null")
        .bind(worker.0.as_bytes().as_slice())
        .fetch_optional(&mut *work.db)
        .await?;
    Ok(there.map_or(StoreError::UnknownWorker(worker), |_| of_another_token(worker)))
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
    /// Name of the token that asks for it.
    pub(crate) by: Option<String>,
}

impl Operation for Drain {
    type Output = ();

    async fn apply(self, work: &mut Work<'_>) -> Result<(), StoreError> {
        let asked = sqlx::query("update workers set draining = 1, drained_by = ? where id = ? and left_ms is null")
            .bind(&self.by)
            .bind(self.worker.0.as_bytes().as_slice())
            .execute(&mut *work.db)
            .await?;
        if asked.rows_affected() == 0 {
            return Err(StoreError::UnknownWorker(self.worker));
        }
        work.events.push(Event::Draining { worker: self.worker, by: self.by });
        // It may be waiting for work: it is told at once.
        work.events.push(Event::Ready);
        Ok(())
    }
}
