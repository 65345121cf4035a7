//! Where long jobs stand, so that another attempt can go on.

use manduca_protocol::task::Checkpoint;
use manduca_protocol::worker::Renewal;

use super::{Store, StoreError, Work, body};
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
        let packed = checkpoint.and_then(|at| body::pack(serde_json::to_vec(&at).ok()?).ok());
        Self { renewal, checkpoint: packed }
    }
}

/// Keeps the checkpoint of a lease which has just been renewed.
pub(super) async fn save(work: &mut Work<'_>, renewal: &PreparedRenewal) -> Result<(), StoreError> {
    let Some(body) = &renewal.checkpoint else { return Ok(()) };
    sqlx::query(
        "insert into checkpoints (job, attempt, body, saved_ms) values (?1, ?2, ?3, ?4)
         on conflict (job) do update set attempt = ?2, body = ?3, saved_ms = ?4",
    )
    .bind(renewal.renewal.job.0)
    .bind(renewal.renewal.attempt)
    .bind(body.as_slice())
    .bind(work.now)
    .execute(&mut *work.db)
    .await?;
    Ok(())
}

impl Store {
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
