//! Workers come, are heard of, and go.

use std::collections::{BTreeMap, HashMap};

use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::ids::WorkerId;
use manduca_protocol::worker::MAX_WAIT_S;

use super::names::{unsigned, uuid};
use super::{Operation, StoreError, Work};
use crate::auth::Caller;
use crate::config::{Config, millis};
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
        inherit(work, self.worker).await?;
        let (name, slots, level) = (self.name, self.slots, self.level);
        work.events.push(Event::Registered { worker: self.worker, name, slots, level, by: self.token });
        Ok(())
    }
}

/// One that was set aside stays so when it comes again under its name and token: another process is the same machine.
async fn inherit(work: &mut Work<'_>, worker: WorkerId) -> Result<(), StoreError> {
    sqlx::query(
        "update workers set set_aside_ms = ?2, set_aside_reason = o.set_aside_reason
         from workers as o
         where workers.id = ?1 and o.name = workers.name and o.token is workers.token and o.set_aside_ms is not null",
    )
    .bind(worker.0.as_bytes().as_slice())
    .bind(work.now)
    .execute(&mut *work.db)
    .await?;
    Ok(())
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
pub(super) async fn give_back_leases(work: &mut Work<'_>, worker: WorkerId) -> Result<u64, StoreError> {
    let returned = sqlx::query(
        "update jobs set state = 'ready', worker = null, lease_until_ms = null, progress = null
         where worker = ? and state = 'leased'
           and not exists (select 1 from unchecked_results as u where u.job = jobs.job)",
    )
    .bind(worker.0.as_bytes().as_slice())
    .execute(&mut *work.db)
    .await?;
    Ok(returned.rows_affected())
}

/// How long a worker may say nothing and still count as alive, ms. An idle one waits in one request and says nothing
/// meanwhile.
pub(super) fn patience_ms(lease_ms: i64) -> i64 {
    lease_ms + (MAX_WAIT_S * 1000.0) as i64
}

/// Failures which nobody has confirmed or contradicted count for this long, ms. Workers which wait
/// for each other's verdicts go on by then.
pub(super) const DOUBT_MS: i64 = 60_000;

/// How the coordinator stands to a worker.
#[derive(Debug, Clone)]
pub(super) struct Standing {
    /// The token that alone speaks for it.
    pub(super) token: Option<String>,
    quarantined: bool,
    set_aside: bool,
    pub(super) draining: bool,
    slots: u32,
    leased: u32,
    is_proven: bool,
    /// Failures of it lately which nobody has confirmed or contradicted yet; before its first success, all.
    doubts: u32,
}

impl Standing {
    /// Whether it is given jobs.
    pub(super) fn may_work(&self) -> bool {
        !self.quarantined && !self.set_aside && !self.draining
    }

    /// Jobs it may be given now, after what has just ended. Its failures in doubt count where another
    /// worker could confirm or contradict them.
    pub(super) fn room(&self, config: &Config, ended: Tally, is_alone: bool) -> usize {
        let leased = self.leased.saturating_sub(ended.released);
        let doubts = if is_alone { 0 } else { self.doubts + ended.failed };
        let most = self.slots.saturating_mul(config.leases_per_slot);
        let most = match self.is_proven || ended.completed > 0 {
            true if doubts >= config.doubts => 0,
            true => most,
            false => most.min(config.probation.saturating_sub(doubts)),
        };
        most.saturating_sub(leased) as usize
    }

    /// Whether it matters if another worker is there.
    pub(super) fn is_doubted(&self, ended: Tally) -> bool {
        self.doubts + ended.failed > 0
    }
}

#[derive(sqlx::FromRow)]
struct RawStanding {
    id: Vec<u8>,
    quarantined_until_ms: Option<i64>,
    draining: bool,
    token: Option<String>,
    slots: i64,
    completed: i64,
    leased: i64,
    doubts: i64,
    set_aside: bool,
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
         returning id, quarantined_until_ms, draining, token, slots, completed, set_aside_ms is not null as set_aside,
           (select count(*) from jobs as j where j.state = 'leased' and j.worker = workers.id) as leased,
           (select count(*) from failures as f
            where (f.open = 1 or completed = 0) and f.worker = workers.id and f.failed_ms > ?3) as doubts",
    )
    .bind(work.now)
    .bind(named)
    .bind(work.now - DOUBT_MS)
    .fetch_all(&mut *work.db)
    .await?;
    known.into_iter().map(|raw| standing(raw, work.now)).collect()
}

fn standing(raw: RawStanding, now: i64) -> Result<(WorkerId, Standing), StoreError> {
    let standing = Standing {
        token: raw.token,
        quarantined: raw.quarantined_until_ms.is_some_and(|until| until > now),
        set_aside: raw.set_aside,
        draining: raw.draining,
        slots: unsigned(raw.slots)?,
        leased: unsigned(raw.leased)?,
        is_proven: raw.completed > 0,
        doubts: unsigned(raw.doubts)?,
    };
    Ok((WorkerId(uuid(&raw.id)?), standing))
}

/// Since when a worker must have been heard of to count as there. One that waits for work says
/// nothing meanwhile.
pub(super) fn alive_since(work: &Work<'_>) -> i64 {
    work.now - work.config.lease_ms() - (MAX_WAIT_S * 1000.0) as i64
}

/// Some workers which are there and may be given jobs.
pub(super) async fn list_able(work: &mut Work<'_>, limit: usize) -> Result<Vec<WorkerId>, StoreError> {
    let able: Vec<Vec<u8>> = sqlx::query_scalar(
        "select id from workers where left_ms is null and last_seen_ms >= ? and draining = 0
           and coalesce(quarantined_until_ms, 0) <= ? limit 0 + ?",
    )
    .bind(alive_since(work))
    .bind(work.now)
    .bind(limit as i64)
    .fetch_all(&mut *work.db)
    .await?;
    able.iter().map(|id| uuid(id).map(WorkerId)).collect()
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
    /// Leases which ended thereby.
    pub(super) released: u32,
    /// Strikes, or fewer of them.
    pub(super) struck: i64,
}

/// The tallies of several workers.
pub(super) type Tallies = BTreeMap<WorkerId, Tally>;

/// Adds to what workers have finished and failed. One which has too many strikes
/// is set aside for a while: it may be the machine. Afterwards one more
/// strike sets it aside again, and one success clears it.
pub(super) async fn add_to_tallies(work: &mut Work<'_>, tallies: &Tallies) -> Result<(), StoreError> {
    if tallies.is_empty() {
        return Ok(());
    }
    let rows: Vec<_> = tallies.iter().map(|(w, t)| (hex(w.0.as_bytes()), t.completed, t.failed, t.struck)).collect();
    let rows = serde_json::to_string(&rows).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    // Whoever has strikes taken back goes on at once.
    let counted: Vec<(Vec<u8>, String, i64)> = sqlx::query_as(
        "update workers set completed = completed + (d.value ->> 1), failed = failed + (d.value ->> 2),
                            strikes = iif(d.value ->> 1 > 0, 0, max(0, strikes + (d.value ->> 3))),
                            quarantined_until_ms = iif(d.value ->> 3 < 0, null, quarantined_until_ms)
         from json_each(?) as d where workers.id = unhex(d.value ->> 0)
         returning id, name, strikes",
    )
    .bind(rows)
    .fetch_all(&mut *work.db)
    .await?;
    for (id, name, strikes) in counted {
        let worker = WorkerId(uuid(&id)?);
        let struck = tallies.get(&worker).is_some_and(|tally| tally.struck > 0);
        if struck && strikes >= i64::from(work.config.strikes) {
            quarantine(work, &id).await?;
            let seconds = work.config.quarantine.as_secs_f64();
            work.events.push(Event::Quarantined { worker, name, strikes, seconds });
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
