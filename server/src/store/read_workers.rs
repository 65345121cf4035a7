//! Workers as users see them.

use manduca_protocol::ids::WorkerId;
use manduca_protocol::who::WorkerView;
use manduca_protocol::worker::MAX_WAIT_S;
use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use super::names::{unsigned, uuid};
use super::{Store, StoreError};
use crate::http::cursor::hex;

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

    /// A page of the workers heard of within a day which have not said goodbye, by id and so by age. The next one
    /// stands in for one that cannot be read.
    pub(crate) async fn workers_page(
        &self,
        filter: &WorkerFilter,
        now: i64,
        lease_ms: i64,
    ) -> Result<Vec<WorkerView>, StoreError> {
        let (mut page, limit) = (Vec::new(), filter.limit as usize);
        let mut after = filter.after.map_or_else(Vec::new, |after| after.0.as_bytes().to_vec());
        loop {
            let wanted = limit - page.len();
            let rows = self.some_workers(filter, &after, now, wanted as i64).await?;
            page.extend(rows.iter().filter_map(|row| listed(row, now, lease_ms)));
            match rows.last() {
                Some(last) if rows.len() == wanted && page.len() < limit => after = last.try_get("id")?,
                _ => return Ok(page),
            }
        }
    }

    /// So many rows of workers, after the one of this id.
    async fn some_workers(
        &self,
        filter: &WorkerFilter,
        after: &[u8],
        now: i64,
        limit: i64,
    ) -> Result<Vec<SqliteRow>, StoreError> {
        let id = filter.find.as_ref().and_then(|text| text.parse::<WorkerId>().ok());
        let rows = sqlx::query(
            "select w.id, w.name, w.slots, w.level, w.completed, w.failed, w.last_seen_ms,
                    w.strikes, w.quarantined_until_ms, w.draining, w.token, w.drained_by,
                    iif(w.set_aside_ms is null, null, w.set_aside_reason) as set_aside,
                    (select count(*) from jobs as j where j.state = 'leased' and j.worker = w.id) as leased
             from workers as w where w.left_ms is null and w.last_seen_ms >= ?1 and w.id > ?2
               and (?3 is null or w.name = ?3 or w.id = ?4)
             order by w.id limit ?5",
        )
        .bind(now - LISTED_MS)
        .bind(after)
        .bind(&filter.find)
        .bind(id.map(|id| id.0.as_bytes().to_vec()))
        .bind(limit)
        .fetch_all(self.readers())
        .await?;
        Ok(rows)
    }

    /// Workers heard of within a day which have not said goodbye, by name.
    pub(crate) async fn workers(&self, now: i64, lease_ms: i64) -> Result<Vec<WorkerView>, StoreError> {
        // The jobs counted here are those in hand, read from the index of leases.
        let rows = sqlx::query(
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
        Ok(rows.iter().filter_map(|row| listed(row, now, lease_ms)).collect())
    }
}

/// A worker of a list, or nothing where its row cannot be read: one damaged row must not hide the others.
fn listed(row: &SqliteRow, now: i64, lease_ms: i64) -> Option<WorkerView> {
    let raw: Result<RawWorker, sqlx::Error> = sqlx::FromRow::from_row(row);
    let read = raw.map_err(StoreError::from).and_then(|raw| view(raw, now, lease_ms));
    let told = |error: &StoreError| {
        let worker = hex(&row.try_get::<Vec<u8>, _>("id").unwrap_or_default());
        tracing::error!(%worker, error.cause = %error, "A worker cannot be read and is passed over");
    };
    read.inspect_err(told).ok()
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
        completed: unsigned(row.completed.max(0))?,
        failed: unsigned(row.failed.max(0))?,
        last_seen_s: silent_ms as f64 / 1000.0,
        alive: silent_ms <= patience_ms,
        strikes: unsigned(row.strikes.max(0))?,
        quarantined: row.quarantined_until_ms.is_some_and(|until| until > now),
        draining: row.draining,
        token: row.token,
        drained_by: row.drained_by,
        set_aside: row.set_aside,
    })
}
