//! Sums over all studies and workers, for those who watch and scale.

use manduca_protocol::worker::MAX_WAIT_S;

use super::names::unsigned;
use super::{Store, StoreError};

/// Jobs of one role in one state.
#[derive(Debug, Clone, sqlx::FromRow)]
pub(crate) struct Depth {
    pub(crate) role: String,
    pub(crate) state: String,
    pub(crate) jobs: i64,
}

/// What there is of workers.
#[derive(Debug, Clone, Default)]
pub(crate) struct WorkerSums {
    pub(crate) alive: u64,
    pub(crate) quarantined: u64,
    pub(crate) draining: u64,
    /// Slots of those which may be given jobs.
    pub(crate) slots: u64,
}

/// Jobs which want a slot now or soon, of studies which move.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Demand {
    pub(crate) ready: u64,
    pub(crate) delayed: u64,
    pub(crate) leased: u64,
}

impl Store {
    /// Jobs by role and state. A damaged counter is cut to what no counter comes to, for the sum must not overflow.
    pub(crate) async fn depths(&self) -> Result<Vec<Depth>, StoreError> {
        let depths = sqlx::query_as(
            "select role, state, sum(max(0, min(n, 1000000000000))) as jobs from study_counts
             group by role, state order by role, state",
        )
        .fetch_all(self.readers())
        .await?;
        Ok(depths)
    }

    /// Workers heard of as lately as those alive are.
    pub(crate) async fn worker_sums(&self, now: i64, lease_ms: i64) -> Result<WorkerSums, StoreError> {
        let patience_ms = lease_ms + (MAX_WAIT_S * 1000.0) as i64;
        let (alive, quarantined, draining, slots): (i64, i64, i64, i64) = sqlx::query_as(
            "select count(*), coalesce(sum(coalesce(quarantined_until_ms, 0) > ?1), 0), coalesce(sum(draining <> 0), 0),
                    coalesce(sum(iif(draining or set_aside_ms is not null or coalesce(quarantined_until_ms, 0) > ?1, 0,
                                     max(0, min(slots, 1000000)))), 0)
             from workers where left_ms is null and last_seen_ms >= ?2",
        )
        .bind(now)
        .bind(now - patience_ms)
        .fetch_one(self.readers())
        .await?;
        Ok(WorkerSums {
            alive: unsigned(alive)?,
            quarantined: unsigned(quarantined)?,
            draining: unsigned(draining)?,
            slots: unsigned(slots)?,
        })
    }

    /// What wants slots.
    pub(crate) async fn demand(&self) -> Result<Demand, StoreError> {
        let rows: Vec<(String, i64)> = sqlx::query_as(
            "select c.state, sum(min(c.n, 1000000000000)) from study_counts as c join studies as s on s.study = c.study
             where c.n > 0 and (c.state = 'leased' or c.state in ('ready', 'delayed') and s.condition = 'running')
             group by c.state",
        )
        .fetch_all(self.readers())
        .await?;
        let of = |state: &str| unsigned(rows.iter().find(|(name, _)| name == state).map_or(0, |(_, n)| *n));
        Ok(Demand { ready: of("ready")?, delayed: of("delayed")?, leased: of("leased")? })
    }
}
