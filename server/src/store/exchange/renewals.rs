//! Leases renewed by a group of exchanges.

use std::collections::HashSet;

use super::Party;
use crate::http::cursor::hex;
use crate::store::checkpoint::save;
use crate::store::{StoreError, Work};

/// Gives leases a new term and keeps the checkpoints which came with them; a
/// worker is told of those which are no longer its own.
pub(super) async fn take(work: &mut Work<'_>, parties: &mut [Party<'_>]) -> Result<(), StoreError> {
    let mut asked = Vec::new();
    for party in parties.iter() {
        let worker = hex(party.exchange.worker.0.as_bytes());
        for renewal in party.exchange.renew.iter().map(|prepared| &prepared.renewal) {
            let progress = renewal.progress.as_ref().and_then(|p| serde_json::to_string(p).ok());
            asked.push((renewal.job.0, renewal.attempt, worker.clone(), progress));
        }
    }
    if asked.is_empty() {
        return Ok(());
    }
    let renewed = renew(work, &asked).await?;
    for party in parties {
        let worker = party.exchange.worker;
        for prepared in &party.exchange.renew {
            let renewal = &prepared.renewal;
            let held = (renewal.job.0, i64::from(renewal.attempt), worker.0.as_bytes().to_vec());
            if renewed.contains(&held) {
                save(work, worker, prepared).await?;
            } else {
                party.told.cancel.push(renewal.job);
            }
        }
    }
    Ok(())
}

async fn renew(
    work: &mut Work<'_>,
    asked: &[(i64, u32, String, Option<String>)],
) -> Result<HashSet<(i64, i64, Vec<u8>)>, StoreError> {
    let asked = serde_json::to_string(asked).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    let renewed: Vec<(i64, i64, Vec<u8>)> = sqlx::query_as(
        "update jobs set lease_until_ms = ?1, progress = coalesce(d.value ->> 3, progress)
         from json_each(?2) as d
         where jobs.job = d.value ->> 0 and jobs.attempt = d.value ->> 1 and jobs.worker = unhex(d.value ->> 2)
           and jobs.state = 'leased'
         returning job, attempt, worker",
    )
    .bind(work.now + work.config.lease_ms())
    .bind(asked)
    .fetch_all(&mut *work.db)
    .await?;
    Ok(renewed.into_iter().collect())
}
