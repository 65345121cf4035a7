//! Samples flown again by another worker, and compared before anything is learnt from them.

use std::collections::BTreeMap;

use manduca_protocol::ids::{JobId, WorkerId};
use manduca_protocol::view::JobRole;
use sqlx::sqlite::SqliteConnection;

use super::exchange::results::{Finish, Shared};
use super::names::{unsigned, uuid};
use super::unreadable::fail_unreadable;
use super::{StoreError, Work};
use crate::event::Event;

/// Whether a sample is audited. The secret of its study decides, so that nobody who computes it can tell.
fn is_chosen(secret: &[u8; 32], key: &[u8], share: f64) -> bool {
    let hash = blake3::keyed_hash(secret, key);
    let digits = hash.as_bytes().iter().take(6).fold(0_u64, |n, &byte| n << 8 | u64::from(byte));
    (digits as f64) < share * (1_u64 << 48) as f64
}

/// Queues the audits of those of a study's samples that are chosen and have their result, whoever's it is.
pub(super) async fn choose<'k>(
    work: &mut Work<'_>,
    study: i64,
    samples: impl Iterator<Item = (u32, &'k [u8])>,
) -> Result<(), StoreError> {
    let known = match work.specs.known(work.db, study).await {
        Ok(known) => known,
        Err(StoreError::Corrupt(why)) => return fail_unreadable(work, study, &why).await,
        Err(error) => return Err(error),
    };
    if known.spec.audit <= 0.0 {
        return Ok(());
    }
    let chosen: Vec<u32> = samples
        .filter(|(_, key)| is_chosen(&known.secret, key, known.spec.audit))
        .map(|(ordinal, _)| ordinal)
        .collect();
    if !chosen.is_empty() && insert(work.db, study, &chosen).await? > 0 {
        work.events.push(Event::Ready);
    }
    Ok(())
}

/// An audit that was cancelled with an earlier result of its sample is queued again.
async fn insert(db: &mut SqliteConnection, study: i64, samples: &[u32]) -> Result<u64, StoreError> {
    let samples = serde_json::to_string(samples).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    let inserted = sqlx::query(
        "insert into jobs (study, role, ordinal, state, parameters)
         select s.study, 'audit', s.ordinal, 'ready', s.parameters
         from json_each(?2) as d cross join jobs as s
             on s.study = ?1 and s.role = 'sample' and s.ordinal = d.value
         where s.state in ('succeeded', 'infeasible')
         on conflict (study, role, ordinal) do update set state = 'ready', failures = 0, losses = 0, reason = null
             where state = 'cancelled'",
    )
    .bind(study)
    .bind(samples)
    .execute(db)
    .await?;
    Ok(inserted.rows_affected())
}

/// Finished samples may be chosen for an audit; finished audits are compared.
pub(super) async fn follow(work: &mut Work<'_>, finished: &[Finish<'_>]) -> Result<(), StoreError> {
    let mut samples: BTreeMap<i64, Vec<(u32, &[u8])>> = BTreeMap::new();
    let mut audits = Vec::new();
    for finish in finished {
        match (finish.role, &finish.key) {
            (JobRole::Sample, Some(key)) => samples.entry(finish.study).or_default().push((finish.ordinal, key)),
            (JobRole::Audit, _) => audits.push(finish.result.job.0),
            _ => {}
        }
    }
    for (study, samples) in samples {
        choose(work, study, samples.into_iter()).await?;
    }
    if audits.is_empty() { Ok(()) } else { compare(work, &audits).await }
}

/// Samples that share an earlier result are audited like those flown for their study.
pub(super) async fn choose_shared(work: &mut Work<'_>, shared: &[Shared]) -> Result<(), StoreError> {
    let mut samples: BTreeMap<i64, Vec<(u32, &[u8])>> = BTreeMap::new();
    for same in shared.iter().filter(|same| same.role == "sample") {
        let ordinal = unsigned(same.ordinal)?;
        samples.entry(same.study).or_default().push((ordinal, &same.key));
    }
    for (study, samples) in samples {
        choose(work, study, samples.into_iter()).await?;
    }
    Ok(())
}

#[derive(Debug, sqlx::FromRow)]
struct Pair {
    audit: i64,
    study: i64,
    sample: i64,
    auditor: Vec<u8>,
    independent: bool,
    agrees: bool,
}

/// Compares audits that have just ended with the results of their samples.
async fn compare(work: &mut Work<'_>, audits: &[i64]) -> Result<(), StoreError> {
    let audits = serde_json::to_string(audits).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    let pairs: Vec<Pair> = sqlx::query_as(
        "select a.job as audit, a.study, s.job as sample, ra.worker as auditor,
                wa.token is not ws.token as independent, ra.digest = rs.digest as agrees
         from json_each(?) as d
         cross join jobs as a on a.job = d.value
         cross join jobs as s on s.study = a.study and s.role = 'sample' and s.ordinal = a.ordinal
         cross join results as ra on ra.job = a.job
         cross join results as rs on rs.job = coalesce(s.result_of, s.job)
         cross join workers as wa on wa.id = ra.worker
         cross join workers as ws on ws.id = rs.worker",
    )
    .bind(audits)
    .fetch_all(&mut *work.db)
    .await?;
    for pair in pairs {
        record(work, &pair).await?;
        let Ok((study, _)) = work.specs.of(work.db, pair.study).await else { continue };
        let worker = WorkerId(uuid(&pair.auditor)?);
        work.events.push(Event::Audited { study, job: JobId(pair.sample), worker, agrees: pair.agrees });
    }
    Ok(())
}

async fn record(work: &mut Work<'_>, pair: &Pair) -> Result<(), StoreError> {
    sqlx::query("insert or replace into audits (job, study, sample, independent, verdict) values (?, ?, ?, ?, ?)")
        .bind(pair.audit)
        .bind(pair.study)
        .bind(pair.sample)
        .bind(pair.independent)
        .bind(if pair.agrees { "agrees" } else { "disputed" })
        .execute(&mut *work.db)
        .await?;
    Ok(())
}

/// Whether a difference between a sample and its audit waits to be settled.
pub(super) async fn is_disputed(db: &mut SqliteConnection, study: i64) -> Result<bool, StoreError> {
    let disputed = sqlx::query_scalar("select exists (select 1 from audits where study = ? and verdict = 'disputed')")
        .bind(study)
        .fetch_one(db)
        .await?;
    Ok(disputed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(i: u32) -> [u8; 32] {
        *blake3::hash(&i.to_le_bytes()).as_bytes()
    }

    fn secret(seed: u32) -> [u8; 32] {
        *blake3::hash(&[b"secret ".as_slice(), &seed.to_le_bytes()].concat()).as_bytes()
    }

    #[test]
    fn the_share_of_samples_chosen_is_the_one_asked_for_and_the_secret_decides() {
        let chosen = |secret: &[u8; 32], share| (0..10_000_u32).filter(|i| is_chosen(secret, &key(*i), share)).count();
        let one = secret(1);
        assert_eq!((chosen(&one, 0.0), chosen(&one, 1.0)), (0, 10_000));
        assert!((60..140).contains(&chosen(&one, 0.01)), "{}", chosen(&one, 0.01));
        // Two secrets agree on a tenth of a tenth, not on all of it.
        let both = |i: &u32| is_chosen(&one, &key(*i), 0.1) && is_chosen(&secret(2), &key(*i), 0.1);
        assert!((60..140).contains(&(0..10_000_u32).filter(both).count()));
    }

    /// Probability that one of `forged` results is among those audited.
    fn found(forged: u32, share: f64) -> f64 {
        1.0 - (1.0 - share).powi(forged as i32)
    }

    #[test]
    fn a_liar_is_found_as_often_as_is_stated() {
        // docs/reliability.md has the first digits, of one worker of three.
        let stated = [
            (500, 0.1, [0.16, 0.58, 0.98]),
            (500, 0.01, [0.02, 0.10, 0.36]),
            (500, 0.001, [0.0, 0.0, 0.0]),
            (5000, 0.1, [0.81, 1.0, 1.0]),
            (5000, 0.01, [0.16, 0.58, 0.98]),
            (5000, 0.001, [0.02, 0.10, 0.36]),
        ];
        for (samples, forged, told) in stated {
            let forged = (f64::from(samples) / 3.0 * forged).round() as u32;
            for (share, told) in [0.01, 0.05, 0.2].into_iter().zip(told) {
                assert!((found(forged, share) - told).abs() < 0.0051, "{samples} {forged} {share}");
            }
        }
    }

    #[test]
    fn no_guess_helps_a_liar() {
        /// What decided before there was a secret, and what every worker can compute.
        fn guessed(key: &[u8], share: f64) -> bool {
            let digits = key.iter().take(6).fold(0_u64, |n, &byte| n << 8 | u64::from(byte));
            (digits as f64) < share * (1_u64 << 48) as f64
        }
        // Of 167 results three are forged: any, or such as a guess says are not audited.
        let liars: [&dyn Fn(u32) -> bool; 2] = [&|_| true, &|i| !guessed(&key(i), 0.2)];
        for (liar, forges) in liars.into_iter().enumerate() {
            let caught = (0..100_u32).filter(|seed| {
                let mut forged = (0..167).map(|i| 1000 * seed + i).filter(|i| forges(*i)).take(3);
                forged.any(|i| is_chosen(&secret(*seed), &key(i), 0.2))
            });
            // 48.8 expected of 100, with a standard deviation of 5.0: four of them either way.
            let (caught, expected) = (caught.count() as f64, 100.0 * found(3, 0.2));
            assert!((caught - expected).abs() < 20.0, "liar {liar}: {caught} of 100, not {expected}");
        }
    }
}
