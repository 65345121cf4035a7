//! Where long jobs stand, so that another attempt can go on.

use manduca_protocol::ids::WorkerId;
use manduca_protocol::task::{Checkpoint, JobKind};
use manduca_protocol::worker::Renewal;

use super::complete::JobRow;
use super::names::kind_of;
use super::{Store, StoreError, Work, body};
use crate::config::millis;
use crate::validity;

/// A renewal whose checkpoint is ready for the store: compressed before it queues.
#[derive(Debug, Clone)]
pub(crate) struct PreparedRenewal {
    pub(crate) renewal: Renewal,
    pub(crate) checkpoint: Option<Vec<u8>>,
}

impl PreparedRenewal {
    /// Serialises and compresses the checkpoint of a renewal.
    ///
    /// One which cannot be, or is larger than any training's, is left out: it is a help, and its lease must live.
    pub(crate) fn new(mut renewal: Renewal) -> Self {
        let checkpoint = renewal.checkpoint.take().filter(validity::checkpoint);
        renewal.progress = renewal.progress.map(validity::progress);
        let packed = checkpoint.and_then(|at| body::pack_large(&at).ok());
        Self { renewal, checkpoint: packed.map(|packed| packed.body) }
    }
}

/// Keeps the checkpoint of a lease which has just been renewed.
pub(super) async fn save(work: &mut Work<'_>, worker: WorkerId, renewal: &PreparedRenewal) -> Result<(), StoreError> {
    let Some(body) = &renewal.checkpoint else { return Ok(()) };
    sqlx::query(
        "insert into checkpoints (job, attempt, body, saved_ms, worker) values (?1, ?2, ?3, ?4, ?5)
         on conflict (job) do update set attempt = ?2, body = ?3, saved_ms = ?4, worker = ?5,
             inherited = inherited or worker is not ?5",
    )
    .bind(renewal.renewal.job.0)
    .bind(renewal.renewal.attempt)
    .bind(body.as_slice())
    .bind(work.now)
    .bind(worker.0.as_bytes().as_slice())
    .execute(&mut *work.db)
    .await?;
    Ok(())
}

/// Drops the checkpoint of an attempt that failed, where another worker had a part in it and the attempt did not end at
/// its run limit: what was computed before may be what it failed of. Returns whether it was dropped.
pub(super) async fn drop_inherited(work: &mut Work<'_>, job: &JobRow, worker: WorkerId) -> Result<bool, StoreError> {
    if kind_of(job.role) == JobKind::Simulate {
        return Ok(false);
    }
    let limit = millis(work.config.run_limits.of(kind_of(job.role)));
    let dropped = sqlx::query(
        "delete from checkpoints where job = ?1 and (inherited or worker is not ?2)
           and coalesce((select leased_ms from jobs where job = ?1), ?3) + ?4 > ?3",
    )
    .bind(job.job.0)
    .bind(worker.0.as_bytes().as_slice())
    .bind(work.now)
    .bind(limit)
    .execute(&mut *work.db)
    .await?;
    Ok(dropped.rows_affected() > 0)
}

impl Store {
    /// The checkpoint from which the present attempt at a study's training goes on: one that came in under the token of
    /// the worker that has it.
    pub(crate) async fn resumed_checkpoint(&self, study: i64) -> Result<Option<Checkpoint>, StoreError> {
        let foreign: Option<bool> = sqlx::query_scalar(
            "select w.token is not h.token from jobs as j join checkpoints as c on c.job = j.job
             join workers as w on w.id = c.worker join workers as h on h.id = j.worker
             where j.study = ? and j.role = 'train' and j.ordinal = 0",
        )
        .bind(study)
        .fetch_optional(self.readers())
        .await?;
        if foreign == Some(true) { Ok(None) } else { self.checkpoint_of(study).await }
    }

    /// Where a study's training stands, while it has not ended.
    pub(crate) async fn checkpoint_of(&self, study: i64) -> Result<Option<Checkpoint>, StoreError> {
        let stored: Option<Vec<u8>> = sqlx::query_scalar(
            "select c.body from jobs as j join checkpoints as c on c.job = j.job
             where j.study = ? and j.role = 'train' and j.ordinal = 0",
        )
        .bind(study)
        .fetch_optional(self.readers())
        .await?;
        // What another version of this code has written is of no use, and no harm.
        match stored {
            Some(stored) => Ok(body::parse_apart(stored).await.ok()),
            None => Ok(None),
        }
    }
}
