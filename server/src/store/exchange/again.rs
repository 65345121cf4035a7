//! Jobs whose lease never reached its worker, because the answer which carried it was lost.

use super::Party;
use crate::store::claim::{Leased, leased};
use crate::store::names::named;
use crate::store::unreadable::fail_unreadable;
use crate::store::{StoreError, Work};

/// Gives each worker which says what it has the rest of what is leased to it, as the same
/// attempt: nobody else has computed it, and no failure is counted.
pub(super) async fn give(work: &mut Work<'_>, parties: &mut [Party<'_>]) -> Result<(), StoreError> {
    for party in parties {
        let Some(have) = &party.exchange.have else { continue };
        let have = serde_json::to_string(have).map_err(|e| StoreError::Corrupt(e.to_string()))?;
        let worker = party.exchange.worker.0.as_bytes().as_slice();
        let missed: Vec<(i64, i64, i64, Option<String>, i64, String)> = sqlx::query_as(
            "select job, attempt, ordinal, parameters, study, role from jobs
             where state = 'leased' and worker = ? and job not in (select value from json_each(?))
               and not exists (select 1 from unchecked_results as u where u.job = jobs.job)
             order by job limit 0 + ?",
        )
        .bind(worker)
        .bind(&have)
        .bind(party.left() as i64)
        .fetch_all(&mut *work.db)
        .await?;
        for (job, attempt, ordinal, parameters, study, role) in missed {
            let row = (job, attempt, ordinal, parameters);
            let again = match named(&role) {
                Ok(role) => leased(work, study, role, row).await,
                Err(error) => Err(error),
            };
            match again {
                Ok(again) => {
                    renew(work, &again).await?;
                    party.told.leased.push(again);
                }
                Err(StoreError::Corrupt(why)) => fail_unreadable(work, study, &why).await?,
                Err(error) => return Err(error),
            }
        }
    }
    Ok(())
}

/// Its worker begins only now.
async fn renew(work: &mut Work<'_>, lease: &Leased) -> Result<(), StoreError> {
    sqlx::query("update jobs set lease_until_ms = ?, leased_ms = ? where job = ?")
        .bind(work.now + work.config.lease_ms())
        .bind(work.now)
        .bind(lease.job.0)
        .execute(&mut *work.db)
        .await?;
    Ok(())
}
