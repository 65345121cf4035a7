//! Workers as users see them.

use manduca_protocol::ids::WorkerId;
use manduca_protocol::who::WorkerView;
use manduca_protocol::worker::MAX_WAIT_S;

use super::names::{unsigned, uuid};
use super::{Store, StoreError};

/// Workers silent for longer are no longer listed, ms.
const LISTED_MS: i64 = 24 * 3600 * 1000;
/// Most workers listed.
const MOST: i64 = 1000;

#[derive(sqlx::FromRow)]
struct RawWorker {
    id: Vec<u8>,
    name: String,
    slots: i64,
    level: String,
    completed: i64,
    failed: i64,
    last_seen_ms: i64,
    strikes: i64,
    quarantined_until_ms: Option<i64>,
    draining: bool,
    token: Option<String>,
    drained_by: Option<String>,
    set_aside: Option<String>,
    leased: i64,
}

/// Which workers are listed, and from where.
#[derive(Debug, Clone, Default)]
pub(crate) struct WorkerFilter {
    /// Name or id.
    pub(crate) find: Option<String>,
    /// After this one.
    pub(crate) after: Option<WorkerId>,
    pub(crate) limit: u32,
}

impl Store {
    /// Whether a worker has a job which is no simulation: the result of such a one may be large.
    pub(crate) async fn holds_large(&self, worker: WorkerId) -> Result<bool, StoreError> {
        let holds = sqlx::query_scalar(
            "select exists (select 1 from jobs where state = 'leased' and worker = ?
                            and role in ('train', 'optimise', 'search', 'generation'))",
        )
        .bind(worker.0.as_bytes().as_slice())
        .fetch_one(self.quick())
        .await?;
        Ok(holds)
    }

    /// A page of the workers heard of within a day which have not said goodbye, by id and so by age.
    pub(crate) async fn workers_page(
        &self,
        filter: &WorkerFilter,
        now: i64,
        lease_ms: i64,
    ) -> Result<Vec<WorkerView>, StoreError> {
        let id = filter.find.as_ref().and_then(|text| text.parse::<WorkerId>().ok());
        let rows: Vec<RawWorker> = sqlx::query_as(
            "select w.id, w.name, w.slots, w.level, w.completed, w.failed, w.last_seen_ms,
                    w.strikes, w.quarantined_until_ms, w.draining, w.token, w.drained_by,
                    iif(w.set_aside_ms is null, null, w.set_aside_reason) as set_aside,
                    (select count(*) from jobs as j where j.state = 'leased' and j.worker = w.id) as leased
             from workers as w where w.left_ms is null and w.last_seen_ms >= ?1 and w.id > ?2
               and (?3 is null or w.name = ?3 or w.id = ?4)
             order by w.id limit ?5",
        )
        .bind(now - LISTED_MS)
        .bind(filter.after.map_or_else(Vec::new, |after| after.0.as_bytes().to_vec()))
        .bind(&filter.find)
        .bind(id.map(|id| id.0.as_bytes().to_vec()))
        .bind(filter.limit)
        .fetch_all(self.readers())
        .await?;
        rows.into_iter().map(|row| view(row, now, lease_ms)).collect()
    }

    /// Workers heard of within a day which have not said goodbye, by name.
    pub(crate) async fn workers(&self, now: i64, lease_ms: i64) -> Result<Vec<WorkerView>, StoreError> {
        // The jobs counted here are those in hand, read from the index of leases.
        let rows: Vec<RawWorker> = sqlx::query_as(
            "select w.id, w.name, w.slots, w.level, w.completed, w.failed, w.last_seen_ms,
                    w.strikes, w.quarantined_until_ms, w.draining, w.token, w.drained_by,
                    iif(w.set_aside_ms is null, null, w.set_aside_reason) as set_aside,
                    (select count(*) from jobs as j where j.state = 'leased' and j.worker = w.id) as leased
             from workers as w where w.left_ms is null and w.last_seen_ms >= ? order by w.name, w.id limit ?",
        )
        .bind(now - LISTED_MS)
        .bind(MOST)
        .fetch_all(self.readers())
        .await?;
        rows.into_iter().map(|row| view(row, now, lease_ms)).collect()
    }
}

fn view(row: RawWorker, now: i64, lease_ms: i64) -> Result<WorkerView, StoreError> {
    let silent_ms = (now - row.last_seen_ms).max(0);
    // An idle worker waits in one request and says nothing meanwhile.
    let patience_ms = lease_ms + (MAX_WAIT_S * 1000.0) as i64;
    Ok(WorkerView {
        id: WorkerId(uuid(&row.id)?),
        name: row.name,
        slots: unsigned(row.slots)?,
        level: row.level,
        leased: unsigned(row.leased)?,
        completed: unsigned(row.completed)?,
        failed: unsigned(row.failed)?,
        last_seen_s: silent_ms as f64 / 1000.0,
        alive: silent_ms <= patience_ms,
        strikes: unsigned(row.strikes)?,
        quarantined: row.quarantined_until_ms.is_some_and(|until| until > now),
        draining: row.draining,
        token: row.token,
        drained_by: row.drained_by,
        set_aside: row.set_aside,
    })
}
