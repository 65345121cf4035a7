//! Results of a group of exchanges.

use std::collections::{BTreeMap, HashMap, HashSet};

use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use manduca_protocol::task::JobKind;
use manduca_protocol::view::{JobRole, JobState};
use manduca_protocol::worker::{Fault, Rejected};
use sqlx::QueryBuilder;
use sqlx::sqlite::{Sqlite, SqliteConnection};

use super::{Effects, Exchanged, Party};
use crate::event::Event;
use crate::store::audits;
use crate::store::blame::{Failed, contradict};
use crate::store::complete::{JobRow, Judged, Prepared, Stored, doubt, find_jobs, find_stored, judge, verdict};
use crate::store::evidence::{Class, refuse};
use crate::store::fail::{Cause, fail_attempt};
use crate::store::names::{state_name, uuid};
use crate::store::unchecked::{Kept, keep};
use crate::store::{StoreError, Work};

/// Rows of one insertion: few different statements, so that all stay prepared.
const CHUNKS: [usize; 4] = [64, 16, 4, 1];

/// A result to be stored.
pub(in crate::store) struct Finish<'r> {
    worker: WorkerId,
    pub(in crate::store) result: &'r Prepared,
    state: JobState,
    reason: Option<&'r str>,
    pub(in crate::store) study: i64,
    pub(in crate::store) role: JobRole,
    pub(in crate::store) ordinal: u32,
    /// Whether an attempt failed before.
    failed: bool,
    pub(in crate::store) key: Option<Vec<u8>>,
}

impl<'r> Finish<'r> {
    /// The end of a job, which is told and counted.
    pub(in crate::store) fn of(
        job: &mut JobRow,
        worker: WorkerId,
        result: &'r Prepared,
        (state, reason): (JobState, Option<&'r str>),
        effects: &mut Effects,
        events: &mut Vec<Event>,
    ) -> Self {
        note(effects, job, worker);
        events.push(Event::Completed {
            study: job.study_id,
            job: job.job,
            role: job.role,
            worker,
            outcome: state_name(state),
            wall_s: result.provenance.wall_s,
        });
        let (study, role, ordinal, failed) = (job.study, job.role, job.ordinal, job.failures > 0);
        Self { worker, result, state, reason, study, role, ordinal, failed, key: job.key.take() }
    }
}

/// What is known of the jobs whose results come in.
#[derive(Default)]
pub(in crate::store) struct Book {
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
            let doubt = match &job {
                Some(job) => doubt(work, job, result).await?,
                None => None,
            };
            let job = job.filter(|_| doubt.is_none());
            if let Some((job, ended)) = job.and_then(|job| verdict(job, worker, result).map(|v| (job, v))) {
                if result.kind != JobKind::Simulate {
                    wait(told, result.job, keep(work, job, worker, result).await?);
                    continue;
                }
                told.accepted.push(result.job);
                pending.push(Finish::of(job, worker, result, ended, effects, work.events));
                book.stale.insert(result.job);
                continue;
            }
            match judge(book.jobs.get(&result.job), book.stored.get(&result.job), worker, result, doubt) {
                Judged::Replay => told.accepted.push(result.job),
                Judged::Refused(class, reason) => {
                    refuse(work, &mut effects.evidence, worker, result, class, &reason).await?;
                    told.rejected.push(Rejected { job: result.job, reason });
                }
                Judged::Unusable(reason) => {
                    refuse(work, &mut effects.evidence, worker, result, Class::Refused, &reason).await?;
                    if let Some(job) = book.jobs.get(&result.job) {
                        let failed = Failed { worker, fault: Fault::Machine, reason: &reason };
                        fail_unusable(work, job, failed, effects).await?;
                    }
                    book.stale.insert(result.job);
                    told.rejected.push(Rejected { job: result.job, reason });
                }
            }
        }
    }
    store(work, pending, &mut book, effects).await
}

/// Tells what became of a result that is to be checked.
fn wait(told: &mut Exchanged, job: JobId, kept: Kept) {
    match kept {
        Kept::Anew => told.unchecked.push(job),
        Kept::Before => {}
        Kept::Another => {
            let reason = "another result of this attempt is being checked".to_owned();
            return told.rejected.push(Rejected { job, reason });
        }
    }
    told.accepted.push(job);
}

/// Counts a result which is taken.
fn note(effects: &mut Effects, job: &JobRow, worker: WorkerId) {
    effects.moved.insert(job.study);
    let tally = effects.tallies.entry(worker).or_default();
    tally.completed += 1;
    tally.released += u32::from(job.state == JobState::Leased);
}

/// The attempt fails, if it is still leased.
pub(in crate::store) async fn fail_unusable(
    work: &mut Work<'_>,
    job: &JobRow,
    failed: Failed<'_>,
    effects: &mut Effects,
) -> Result<(), StoreError> {
    let leased = job.state == JobState::Leased;
    if leased {
        fail_attempt(work, job, Cause::Failed(failed), &mut effects.tallies).await?;
    }
    let tally = effects.tallies.entry(failed.worker).or_default();
    tally.failed += 1;
    tally.released += u32::from(leased);
    effects.moved.insert(job.study);
    Ok(())
}

/// Stores results, ends their jobs, and those of equal simulations which wait.
pub(in crate::store) async fn store(
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
    audits::follow(work, &pending).await?;
    let mut seen = HashSet::new();
    let keyed: Vec<_> = pending
        .iter()
        .filter_map(|f| Some((f, f.key.as_ref()?)))
        .filter(|(_, key)| seen.insert(*key))
        .map(|(f, key)| (f.result.job.0, state_name(f.state), f.reason, hex(key), f.study))
        .collect();
    let shared = share(work.db, &json(&keyed)?).await?;
    for same in &shared {
        let study = StudyId(uuid(&same.id)?);
        work.events.push(Event::Shared { study, job: JobId(same.job), from: JobId(same.source) });
        effects.moved.insert(same.study);
        // Whatever comes in for it now is a second result.
        book.stale.insert(JobId(same.job));
    }
    audits::choose_shared(work, &shared).await
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

/// A job finished by an equal one's result.
#[derive(Debug, sqlx::FromRow)]
pub(in crate::store) struct Shared {
    pub(in crate::store) job: i64,
    pub(in crate::store) study: i64,
    pub(in crate::store) role: String,
    pub(in crate::store) ordinal: i64,
    pub(in crate::store) key: Vec<u8>,
    source: i64,
    id: Vec<u8>,
}

/// Finishes equal simulations which still wait, in whatever study: what has been
/// flown once is not flown again, but for studies that take nothing of others. Those
/// being flown are left to their workers.
async fn share(db: &mut SqliteConnection, finished: &str) -> Result<Vec<Shared>, StoreError> {
    let shared = sqlx::query_as(
        "update jobs set state = d.value ->> 1, reason = d.value ->> 2, result_of = d.value ->> 0, not_before_ms = null
         from json_each(?) as d
         where jobs.key = unhex(d.value ->> 3) and jobs.state in ('ready', 'delayed') and jobs.job <> d.value ->> 0
           and (jobs.study = d.value ->> 4 or (select not s.fresh from studies as s where s.study = jobs.study))
         returning job, study, role, ordinal, key, result_of as source,
                   (select id from studies as s where s.study = jobs.study) as id",
    )
    .bind(finished)
    .fetch_all(db)
    .await?;
    Ok(shared)
}
