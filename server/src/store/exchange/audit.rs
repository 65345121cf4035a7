//! Samples flown again by another worker, and compared.

use manduca_protocol::ids::JobId;
use manduca_protocol::view::JobRole;
use sqlx::sqlite::SqliteConnection;

use super::results::Finish;
use crate::event::Event;
use crate::store::evidence::{Class, Evidence, refuse};
use crate::store::unreadable::fail_unreadable;
use crate::store::{StoreError, Work};

/// A finished sample may be chosen for an audit; a finished audit is compared.
pub(super) async fn follow(
    work: &mut Work<'_>,
    finished: &Finish<'_>,
    evidence: &mut Evidence,
) -> Result<(), StoreError> {
    match (finished.role, &finished.key) {
        (JobRole::Sample, Some(key)) => {
            let spec = match work.specs.of(work.db, finished.study).await {
                Ok((_, spec)) => spec,
                Err(StoreError::Corrupt(why)) => return fail_unreadable(work, finished.study, &why).await,
                Err(error) => return Err(error),
            };
            if spec.audit > 0.0 && is_chosen(key, spec.audit) {
                insert_audit(work.db, finished.result.job).await?;
                work.events.push(Event::Ready);
            }
            Ok(())
        }
        (JobRole::Audit, _) => compare(work, finished, evidence).await,
        _ => Ok(()),
    }
}

/// Which samples are audited follows from what they fly, so that a study's audits are the same in every run.
fn is_chosen(key: &[u8], share: f64) -> bool {
    let digits = key.iter().take(6).fold(0_u64, |n, &byte| n << 8 | u64::from(byte));
    (digits as f64) < share * (1_u64 << 48) as f64
}

async fn insert_audit(db: &mut SqliteConnection, sample: JobId) -> Result<(), StoreError> {
    sqlx::query(
        "insert into jobs (study, role, ordinal, state, parameters)
         select study, 'audit', ordinal, 'ready', parameters from jobs where job = ?
         on conflict (study, role, ordinal) do nothing",
    )
    .bind(sample.0)
    .execute(db)
    .await?;
    Ok(())
}

async fn compare(work: &mut Work<'_>, audit: &Finish<'_>, evidence: &mut Evidence) -> Result<(), StoreError> {
    let Some((sample, digest, level)) = find_audited(work.db, audit.result.job).await? else { return Ok(()) };
    let agrees = digest == audit.result.digest;
    if !agrees {
        let (class, reason) = if level == audit.result.provenance.level {
            (Class::Nondeterminism, format!("audit of job {sample}, which has a different result"))
        } else {
            (Class::Refused, format!("audit of job {sample}, whose result is of another instruction level"))
        };
        refuse(work, evidence, audit.worker, audit.result, class, &reason).await?;
    }
    let Ok((study, _)) = work.specs.of(work.db, audit.study).await else { return Ok(()) };
    work.events.push(Event::Audited { study, job: JobId(sample), worker: audit.worker, agrees });
    Ok(())
}

/// The sample an audit is of, with its result's digest and level.
async fn find_audited(db: &mut SqliteConnection, audit: JobId) -> Result<Option<(i64, Vec<u8>, String)>, StoreError> {
    let found = sqlx::query_as(
        "select s.job, r.digest, r.level
         from jobs as a join jobs as s on s.study = a.study and s.role = 'sample' and s.ordinal = a.ordinal
         join results as r on r.job = s.job where a.job = ?",
    )
    .bind(audit.0)
    .fetch_optional(db)
    .await?;
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_of_samples_chosen_is_the_one_asked_for() {
        let chosen =
            |share| (0..10_000_u32).filter(|i| is_chosen(blake3::hash(&i.to_le_bytes()).as_bytes(), share)).count();
        assert_eq!((chosen(0.0), chosen(1.0)), (0, 10_000));
        assert!((60..140).contains(&chosen(0.01)), "{}", chosen(0.01));
    }
}
