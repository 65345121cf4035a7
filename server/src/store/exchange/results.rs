//! Results of a group of exchanges.

use std::collections::{BTreeMap, HashMap, HashSet};

use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use manduca_protocol::view::{JobRole, JobState};
use manduca_protocol::worker::{Fault, Rejected};
use sqlx::sqlite::{Sqlite, SqliteConnection};
use sqlx::{QueryBuilder, Row};

use super::{Effects, Party, audit};
use crate::event::Event;
use crate::store::blame::{Failed, contradict};
use crate::store::complete::{JobRow, Judged, Prepared, Stored, find_jobs, find_stored, judge, verdict};
use crate::store::evidence::{Class, refuse};
use crate::store::fail::{Cause, fail_attempt};
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
    /// Whether an attempt failed before.
    failed: bool,
    pub(super) key: Option<Vec<u8>>,
}

/// What is known of the jobs whose results come in.
#[derive(Default)]
struct Book {
    jobs: HashMap<JobId, JobRow>,
    /// What finished jobs have.
    stored: HashMap<JobId, Stored>,
    /// Jobs which have changed since they were looked up.
    stale: HashSet<JobId>,
}

impl Book {
    async fn look_up(&mut self, db: &mut SqliteConnection, named: &[JobId]) -> Result<(), StoreError> {
        let jobs = find_jobs(db, named).await?;
        self.stored.extend(find_stored(db, jobs.values()).await?);
        self.jobs.extend(jobs);
        Ok(())
    }
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
    let mut book = Book::default();
    book.look_up(work.db, &named).await?;
    let mut pending = Vec::with_capacity(named.len());
    for party in parties {
        let (worker, told) = (party.exchange.worker, &mut party.told);
        for result in &party.exchange.complete {
            if book.stale.contains(&result.job) {
                // It is judged by what is stored, so that must be up to date.
                store(work, std::mem::take(&mut pending), &mut book, effects).await?;
                book.look_up(work.db, &[result.job]).await?;
                book.stale.remove(&result.job);
            }
            let job = book.jobs.get_mut(&result.job);
            if let Some((job, (state, reason))) = job.and_then(|job| verdict(job, worker, result).map(|v| (job, v))) {
                note(effects, job, worker);
                told.accepted.push(result.job);
                work.events.push(Event::Completed {
                    study: job.study_id,
                    job: job.job,
                    role: job.role,
                    worker,
                    outcome: state_name(state),
                    wall_s: result.provenance.wall_s,
                });
                let (study, role, failed) = (job.study, job.role, job.failures > 0);
                pending.push(Finish { worker, result, state, reason, study, role, failed, key: job.key.take() });
                book.stale.insert(result.job);
                continue;
            }
            match judge(book.jobs.get(&result.job), book.stored.get(&result.job), worker, result) {
                Judged::Replay => told.accepted.push(result.job),
                Judged::Refused(class, reason) => {
                    refuse(work, &mut effects.evidence, worker, result, class, &reason).await?;
                    told.rejected.push(Rejected { job: result.job, reason });
                }
                Judged::Unusable(reason) => {
                    refuse(work, &mut effects.evidence, worker, result, Class::Refused, &reason).await?;
                    fail_unusable(work, &book, worker, result, &reason, effects).await?;
                    book.stale.insert(result.job);
                    told.rejected.push(Rejected { job: result.job, reason });
                }
            }
        }
    }
    store(work, pending, &mut book, effects).await
}

/// Counts a result which is taken.
fn note(effects: &mut Effects, job: &JobRow, worker: WorkerId) {
    effects.moved.insert(job.study);
    let tally = effects.tallies.entry(worker).or_default();
    tally.completed += 1;
    tally.released += u32::from(job.state == JobState::Leased);
}

/// The attempt fails, if it is still leased.
async fn fail_unusable(
    work: &mut Work<'_>,
    book: &Book,
    worker: WorkerId,
    result: &Prepared,
    reason: &str,
    effects: &mut Effects,
) -> Result<(), StoreError> {
    let Some(job) = book.jobs.get(&result.job) else { return Ok(()) };
    let leased = job.state == JobState::Leased;
    if leased {
        let failed = Failed { worker, fault: Fault::Machine, reason };
        fail_attempt(work, job, Cause::Failed(failed), &mut effects.tallies).await?;
    }
    let tally = effects.tallies.entry(worker).or_default();
    tally.failed += 1;
    tally.released += u32::from(leased);
    effects.moved.insert(job.study);
    Ok(())
}

/// Stores results, ends their jobs, and those of equal simulations which wait.
async fn store(
    work: &mut Work<'_>,
    pending: Vec<Finish<'_>>,
    book: &mut Book,
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
    let failed: BTreeMap<_, _> = pending.iter().filter(|f| f.failed).map(|f| (f.result.job.0, f.worker)).collect();
    contradict(work, &failed, &mut effects.tallies).await?;
    let ended: Vec<_> = pending.iter().map(|f| (f.result.job.0, state_name(f.state), f.reason)).collect();
    finish_jobs(work.db, &json(&ended)?).await?;
    for finished in &pending {
        audit::follow(work, finished, &mut effects.evidence).await?;
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
        book.stale.insert(JobId(job));
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
