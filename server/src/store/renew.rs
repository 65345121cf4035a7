//! Leases are renewed by the workers which compute.

use super::checkpoint::{PreparedRenewal, save};
use super::{StoreError, Work};
use manduca_protocol::ids::WorkerId;

/// Gives a lease a new term, and keeps the checkpoint which came with it; false when it is no longer this worker's.
pub(super) async fn renew(
    work: &mut Work<'_>,
    worker: WorkerId,
    prepared: &PreparedRenewal,
) -> Result<bool, StoreError> {
    let renewal = &prepared.renewal;
    let progress = renewal.progress.as_ref().and_then(|p| serde_json::to_string(p).ok());
    let renewed = sqlx::query(
        "update jobs set lease_until_ms = ?1, progress = coalesce(?2, progress)
         where job = ?3 and attempt = ?4 and worker = ?5 and state = 'leased'",
    )
    .bind(work.now + work.config.lease_ms())
    .bind(progress)
    .bind(renewal.job.0)
    .bind(renewal.attempt)
    .bind(worker.0.as_bytes().as_slice())
    .execute(&mut *work.db)
    .await?;
    let renewed = renewed.rows_affected() > 0;
    if renewed {
        save(work, prepared).await?;
    }
    Ok(renewed)
}
