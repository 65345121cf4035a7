//! Results of a group of exchanges.

use std::collections::{HashMap, HashSet};

use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use manduca_protocol::view::{JobRole, JobState};
use manduca_protocol::worker::Rejected;
use sqlx::sqlite::{Sqlite, SqliteConnection};
use sqlx::{QueryBuilder, Row};

use super::{Effects, Party, audit};
use crate::event::Event;
use crate::store::complete::{JobRow, Prepared, Taken, complete, find_jobs, verdict};
use crate::store::names::{state_name, uuid};
use crate::store::{StoreError, Work};

/// Rows of one insertion: few different statements, so that all stay prepared.
const CHUNKS: [usize; 4] = [64, 16, 4, 1];

/// A result to be stored.
pub(super) struct Finish<'r> {
    pub(super) worker: WorkerId,
    pub(super) result: &'r Prepared,
    state: JobState,
    reason: Option<&'r str>,
    pub(super) study: i64,
    pub(super) role: JobRole,
    pub(super) key: Option<Vec<u8>>,
}

/// Takes the results of all parties, in their order.
pub(super) async fn take(
    work: &mut Work<'_>,
    parties: &mut [Party<'_>],
    effects: &mut Effects,
) -> Result<(), StoreError> {
    let named: Vec<JobId> = parties.iter().flat_map(|p| p.exchange.complete.iter().map(|r| r.job)).collect();
    if named.is_empty() {
        return Ok(());
    }
    let mut jobs = find_jobs(work.db, &named).await?;
    let mut pending = Vec::with_capacity(named.len());
    for party in parties {
        let (worker, told) = (party.exchange.worker, &mut party.told);
        for result in &party.exchange.complete {
            let job = jobs.get_mut(&result.job);
            if let Some((job, (state, reason))) = job.and_then(|job| verdict(job, worker, result).map(|v| (job, v))) {
                job.state = state;
                effects.moved.insert(job.study);
                effects.tallies.entry(worker).or_default().completed += 1;
                told.accepted.push(result.job);
                work.events.push(Event::Completed {
                    study: job.study_id,
                    job: job.job,
                    role: job.role,
                    worker,
                    outcome: state_name(state),
                    wall_s: result.provenance.wall_s,
                });
                let (study, role) = (job.study, job.role);
                pending.push(Finish { worker, result, state, reason, study, role, key: job.key.take() });
                continue;
            }
            // It is judged by what is stored, so that must be up to date.
            store(work, std::mem::take(&mut pending), &mut jobs, effects).await?;
            match complete(work, worker, result).await? {
                Taken::Replay => told.accepted.push(result.job),
                Taken::Refused(reason) => told.rejected.push(Rejected { job: result.job, reason }),
                Taken::Failed(reason, study) => {
                    effects.tallies.entry(worker).or_default().failed += 1;
                    effects.moved.insert(study);
                    told.rejected.push(Rejected { job: result.job, reason });
                }
            }
            jobs.extend(find_jobs(work.db, &[result.job]).await?);
        }
    }
    store(work, pending, &mut jobs, effects).await
}

/// Stores results, ends their jobs, and those of equal simulations which wait.
async fn store(
    work: &mut Work<'_>,
    pending: Vec<Finish<'_>>,
    jobs: &mut HashMap<JobId, JobRow>,
    effects: &mut Effects,
) -> Result<(), StoreError> {
    if pending.is_empty() {
        return Ok(());
    }
    let mut rest = pending.as_slice();
    for size in CHUNKS {
        while rest.len() >= size {
            let (chunk, others) = rest.split_at(size);
            insert_results(work.db, work.now, chunk).await?;
            rest = others;
        }
    }
    let ended: Vec<_> = pending.iter().map(|f| (f.result.job.0, state_name(f.state), f.reason)).collect();
    finish_jobs(work.db, &json(&ended)?).await?;
    for finished in &pending {
        audit::follow(work, finished).await?;
    }
    let mut seen = HashSet::new();
    let keyed: Vec<_> = pending
        .iter()
        .filter_map(|f| Some((f, f.key.as_ref()?)))
        .filter(|(_, key)| seen.insert(*key))
        .map(|(f, key)| (f.result.job.0, state_name(f.state), f.reason, hex(key)))
        .collect();
    for (job, study, from, id) in share(work.db, &json(&keyed)?).await? {
        work.events.push(Event::Shared { study: StudyId(uuid(&id)?), job: JobId(job), from: JobId(from) });
        effects.moved.insert(study);
        // Whatever comes in for it now is a second result.
        jobs.remove(&JobId(job));
    }
    Ok(())
}

fn json(value: &impl serde::Serialize) -> Result<String, StoreError> {
    serde_json::to_string(value).map_err(|e| StoreError::Corrupt(e.to_string()))
}

fn hex(bytes: &[u8]) -> String {
    crate::http::cursor::hex(bytes)
}

async fn insert_results(db: &mut SqliteConnection, now: i64, chunk: &[Finish<'_>]) -> Result<(), StoreError> {
    let mut insertion: QueryBuilder<Sqlite> = QueryBuilder::new(
        "insert into results (job, attempt, worker, digest, body, summary, wall_s, level, finished_ms) ",
    );
    insertion.push_values(chunk, |mut row, Finish { worker, result, .. }| {
        row.push_bind(result.job.0)
            .push_bind(result.attempt)
            .push_bind(worker.0.as_bytes().as_slice())
            .push_bind(result.digest.as_slice())
            .push_bind(result.body.as_slice())
            .push_bind(result.summary.as_deref())
            .push_bind(result.provenance.wall_s)
            .push_bind(&result.provenance.level)
            .push_bind(now);
    });
    insertion.build().execute(db).await?;
    Ok(())
}

async fn finish_jobs(db: &mut SqliteConnection, ended: &str) -> Result<(), StoreError> {
    sqlx::query(
        "update jobs set state = d.value ->> 1, reason = d.value ->> 2,
                         lease_until_ms = null, not_before_ms = null, progress = null
         from json_each(?) as d where jobs.job = d.value ->> 0",
    )
    .bind(ended)
    .execute(db)
    .await?;
    Ok(())
}

/// Finishes equal simulations which still wait, in whatever study: what has been
/// flown once is not flown again. Those being flown are left to their workers.
async fn share(db: &mut SqliteConnection, finished: &str) -> Result<Vec<(i64, i64, i64, Vec<u8>)>, StoreError> {
    let rows = sqlx::query(
        "update jobs set state = d.value ->> 1, reason = d.value ->> 2, result_of = d.value ->> 0, not_before_ms = null
         from json_each(?) as d
         where jobs.key = unhex(d.value ->> 3) and jobs.state in ('ready', 'delayed') and jobs.job <> d.value ->> 0
         returning job, study, result_of, (select id from studies as s where s.study = jobs.study)",
    )
    .bind(finished)
    .fetch_all(db)
    .await?;
    rows.iter().map(|row| Ok((row.try_get(0)?, row.try_get(1)?, row.try_get(2)?, row.try_get(3)?))).collect()
}
