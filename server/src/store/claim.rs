//! Ready jobs are leased.

use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use manduca_numerics::parameters::Point;
use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use manduca_protocol::study::StudySpec;
use manduca_protocol::view::JobRole;
use sqlx::sqlite::SqliteConnection;

use super::names::{named, role_name, unsigned};
use super::shares::Offer;
use super::stock::Stock;
use super::unreadable::{fail_unreadable, of_study};
use super::workers::patience_ms;
use super::{StoreError, Work, body};
use crate::http::cursor::hex;

/// Most studies that one claim finds unreadable.
const MOST_SPOILT: usize = 64;
/// Studies whose audits are looked at in one claim.
const MOST_AUDITED: i64 = 16;

/// A job just leased, with what its task is composed from.
#[derive(Debug, Clone)]
pub(crate) struct Leased {
    pub(crate) job: JobId,
    pub(crate) attempt: u32,
    pub(crate) study: StudyId,
    pub(crate) role: JobRole,
    pub(crate) ordinal: u32,
    /// Of a simulation.
    pub(crate) parameters: Option<String>,
    /// What is asked of the study.
    pub(crate) spec: Arc<StudySpec>,
}

/// Leases ready jobs to these workers in turn, one each, as far as there are any. Running studies
/// share them ([`Rota::share`]); of one study comes first what brings it nearer to its end, then its
/// samples. Audits come before all, each to a worker that is fit for it.
pub(super) async fn claim(work: &mut Work<'_>, workers: &[WorkerId]) -> Result<Vec<Option<Leased>>, StoreError> {
    if workers.is_empty() {
        return Ok(Vec::new());
    }
    let mut spoilt = 0;
    let given = loop {
        match choose(work, workers).await {
            // Nothing is leased yet: without that study the choice is another one.
            Err(StoreError::Unreadable(study, why)) if spoilt < MOST_SPOILT => {
                spoilt += 1;
                fail_unreadable(work, study, &why).await?;
            }
            given => break given?,
        }
    };
    let holders: Vec<_> =
        given.iter().zip(workers).filter_map(|(l, w)| Some((l.as_ref()?.job.0, hex(w.0.as_bytes())))).collect();
    if !holders.is_empty() {
        lease_jobs(work, &holders).await?;
    }
    Ok(given)
}

/// A job for each of these workers in turn, as far as there are any.
///
/// # Errors
/// When a study or one of its jobs cannot be read, or the store fails.
async fn choose(work: &mut Work<'_>, workers: &[WorkerId]) -> Result<Vec<Option<Leased>>, StoreError> {
    let mut given: Vec<Option<Leased>> = workers.iter().map(|_| None).collect();
    // As many as samples were finished, and found wrong the sooner.
    audit(work, workers, &mut given).await?;
    let open: Vec<usize> = (0..workers.len()).filter(|place| given[*place].is_none()).collect();
    let offers = list_offers(work.db).await?;
    let order = work.rota.share(&offers, open.len());
    let mut stock = Stock::open(work, &offers, &order).await?;
    for (place, study) in open.into_iter().zip(order) {
        let found = match stock.take(study, workers[place]) {
            Some((role, row)) => Some((study, role, row)),
            None => stock.take_any(work, &offers, workers[place]).await?,
        };
        if let Some((study, role, row)) = found {
            given[place] = Some(of_study(study, leased(work, study, role, row).await)?);
        }
    }
    Ok(given)
}

/// The lease of a job as this attempt.
///
/// # Errors
/// When the study or the job cannot be read: then no task could be made of it.
pub(super) async fn leased(
    work: &mut Work<'_>,
    study: i64,
    role: JobRole,
    row: ReadyRow,
) -> Result<Leased, StoreError> {
    let (study, spec) = work.specs.of(work.db, study).await?;
    let (job, attempt, ordinal, parameters) = row;
    let (attempt, ordinal) = (unsigned(attempt)?, unsigned(ordinal)?);
    if let Some(parameters) = &parameters {
        body::from_json::<Point>(parameters.as_bytes())
            .map_err(|why| StoreError::Corrupt(format!("job {job}: its parameters: {why}")))?;
    }
    Ok(Leased { job: JobId(job), attempt, study, role, ordinal, parameters, spec })
}

/// Gives audits of the oldest studies to those who may do them.
async fn audit(work: &mut Work<'_>, workers: &[WorkerId], given: &mut [Option<Leased>]) -> Result<(), StoreError> {
    for study in list_audited(work.db).await? {
        let open: Vec<usize> = (0..workers.len()).filter(|place| given[*place].is_none()).collect();
        if open.is_empty() {
            break;
        }
        let asking: Vec<WorkerId> = open.iter().map(|place| workers[*place]).collect();
        for (place, row) in open.into_iter().zip(of_study(study, list_audits(work, study, &asking).await)?) {
            if let Some(row) = row {
                given[place] = Some(of_study(study, leased(work, study, JobRole::Audit, row).await)?);
            }
        }
    }
    Ok(())
}

/// An audit for each of these workers, or `None` if there is nothing it may audit.
async fn list_audits(
    work: &mut Work<'_>,
    study: i64,
    workers: &[WorkerId],
) -> Result<Vec<Option<ReadyRow>>, StoreError> {
    let others = Others::find(work).await?;
    let (mut taken, mut found) = (HashSet::new(), Vec::with_capacity(workers.len()));
    let mut offers: HashMap<WorkerId, Vec<ReadyRow>> = HashMap::new();
    for &worker in workers {
        let offered = match offers.entry(worker) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => {
                entry.insert(list_audits_for(work.db, study, worker, &others, workers.len()).await?)
            }
        };
        let audit = offered.iter().position(|row| !taken.contains(&row.0)).map(|i| offered.swap_remove(i));
        taken.extend(audit.as_ref().map(|row| row.0));
        found.push(audit);
    }
    Ok(found)
}

/// Who else could audit.
struct Others {
    /// Tokens of the workers which may be given jobs: how many, and one of them.
    tokens: i64,
    token: Option<String>,
    /// These workers: how many, and one of them.
    workers: i64,
    worker: Vec<u8>,
}

impl Others {
    async fn find(work: &mut Work<'_>) -> Result<Self, StoreError> {
        let tokens: Vec<(Option<String>, i64, Vec<u8>)> = sqlx::query_as(
            "select token, count(*), min(id) from workers
             where left_ms is null and last_seen_ms >= ?1 and not draining and set_aside_ms is null
               and coalesce(quarantined_until_ms, 0) <= ?2
             group by token",
        )
        .bind(work.now - patience_ms(work.config.lease_ms()))
        .bind(work.now)
        .fetch_all(&mut *work.db)
        .await?;
        let workers = tokens.iter().map(|(_, n, _)| n).sum();
        let count = tokens.len() as i64;
        let (token, worker) = tokens.into_iter().next().map(|(token, _, worker)| (token, worker)).unwrap_or_default();
        Ok(Self { tokens: count, token, workers, worker })
    }
}

/// Audits of results that came in under another token; of results of another worker where nobody
/// has another token; of its own where nobody else is there, so that no study waits for ever.
async fn list_audits_for(
    db: &mut SqliteConnection,
    study: i64,
    worker: WorkerId,
    others: &Others,
    limit: usize,
) -> Result<Vec<ReadyRow>, StoreError> {
    let rows = sqlx::query_as(
        "select a.job, a.attempt + 1, a.ordinal, a.parameters
         from jobs as a join jobs as s on s.study = a.study and s.role = 'sample' and s.ordinal = a.ordinal
         join results as r on r.job = coalesce(s.result_of, s.job) join workers as w on w.id = r.worker
         where a.state = 'ready' and a.study = ?1 and a.role = 'audit'
           and (w.token is not (select token from workers where id = ?2)
                or iif(?3 = 1, w.token is ?4, ?3 = 0)
                   and (r.worker <> ?2 or iif(?5 = 1, r.worker = ?6, ?5 = 0)))
         order by a.ordinal limit 0 + ?7",
    )
    .bind(study)
    .bind(worker.0.as_bytes().as_slice())
    .bind(others.tokens)
    .bind(&others.token)
    .bind(others.workers)
    .bind(&others.worker)
    .bind(limit as i64)
    .fetch_all(db)
    .await?;
    Ok(rows)
}

/// What running studies offer but audits, study by study: first what brings each nearer to its end.
async fn list_offers(db: &mut SqliteConnection) -> Result<Vec<Offer>, StoreError> {
    let rows: Vec<(i64, String, i64, i64, Option<String>)> = sqlx::query_as(
        "select c.study, c.role, c.n,
                (select coalesce(sum(max(0, min(l.n, 1000000000000))), 0) from study_counts as l
                 where l.study = c.study and l.state = 'leased'),
                s.submitted_by
         from studies as s cross join study_counts as c on c.study = s.study
         where s.condition = 'running' and c.state = 'ready' and c.n > 0 and c.role <> 'audit'
         order by c.study, c.role = 'sample', c.role",
    )
    .fetch_all(db)
    .await?;
    let offer = |(study, role, ready, leased, owner): (i64, String, i64, i64, Option<String>)| {
        Ok(Offer {
            study,
            role: of_study(study, named(&role))?,
            ready: unsigned(ready)?,
            leased: unsigned(leased)?,
            owner,
        })
    };
    rows.into_iter().map(offer).collect()
}

/// The oldest studies which have audits ready.
async fn list_audited(db: &mut SqliteConnection) -> Result<Vec<i64>, StoreError> {
    let found = sqlx::query_scalar(
        "select c.study from study_counts as c join studies as s on s.study = c.study
         where c.role = 'audit' and c.state = 'ready' and c.n > 0 and s.condition in ('running', 'succeeded')
         order by c.study limit 0 + ?",
    )
    .bind(MOST_AUDITED)
    .fetch_all(db)
    .await?;
    Ok(found)
}

/// Job, the attempt it is leased as, ordinal, parameters.
pub(super) type ReadyRow = (i64, i64, i64, Option<String>);

/// Ready jobs, with how often each failed. Nobody else writes between this and the lease.
pub(super) async fn list_ready(
    db: &mut SqliteConnection,
    study: i64,
    role: JobRole,
    limit: usize,
) -> Result<Vec<(ReadyRow, i64)>, StoreError> {
    let rows: Vec<(i64, i64, i64, Option<String>, i64)> = sqlx::query_as(
        "select job, attempt + 1, ordinal, parameters, failures from jobs
         where state = 'ready' and study = ? and role = ? order by ordinal limit 0 + ?",
    )
    .bind(study)
    .bind(role_name(role))
    .bind(limit as i64)
    .fetch_all(db)
    .await?;
    Ok(rows.into_iter().map(|(job, attempt, ordinal, p, failures)| ((job, attempt, ordinal, p), failures)).collect())
}

async fn lease_jobs(work: &mut Work<'_>, holders: &[(i64, String)]) -> Result<(), StoreError> {
    let holders = serde_json::to_string(holders).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    sqlx::query(
        "update jobs set state = 'leased', attempt = attempt + 1, worker = unhex(d.value ->> 1), lease_until_ms = ?1,
                         leased_ms = ?3, progress = null
         from json_each(?2) as d where jobs.job = d.value ->> 0",
    )
    .bind(work.now + work.config.lease_ms())
    .bind(holders)
    .bind(work.now)
    .execute(&mut *work.db)
    .await?;
    Ok(())
}
