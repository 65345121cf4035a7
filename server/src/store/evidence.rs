//! Refused results are kept for whoever looks into a fault, the newest of them.

use std::collections::BTreeMap;

use manduca_protocol::ids::{JobId, WorkerId};
use manduca_protocol::watch::EvidenceView;
use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use super::complete::Prepared;
use super::names::{unsigned, uuid};
use super::{Store, StoreError, Work};
use crate::clock::rfc3339;
use crate::event::Event;

/// Largest body kept, bytes as stored.
const LARGEST_BODY: usize = 64 << 10;

/// Most results of a worker kept of one commit, of each class; the rest is counted.
const KEPT_AT_ONCE: u64 = 3;

/// Why a result is evidence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Class {
    /// Not the present attempt's.
    Refused,
    /// Other numbers for the same simulation by an equal machine.
    Nondeterminism,
}

impl Class {
    fn name(self) -> &'static str {
        match self {
            Self::Refused => "refused",
            Self::Nondeterminism => "nondeterminism",
        }
    }
}

/// The first of several results refused, and how many there were.
struct First {
    job: JobId,
    attempt: u32,
    reason: String,
    level: String,
    results: u64,
}

/// What a commit refuses, by worker and class.
#[derive(Default)]
pub(super) struct Evidence(BTreeMap<(WorkerId, Class), First>);

/// Keeps a refused result, if it is among the first few.
pub(super) async fn refuse(
    work: &mut Work<'_>,
    evidence: &mut Evidence,
    worker: WorkerId,
    result: &Prepared,
    class: Class,
    reason: &str,
) -> Result<(), StoreError> {
    let first = evidence.0.entry((worker, class)).or_insert_with(|| First {
        job: result.job,
        attempt: result.attempt,
        reason: reason.into(),
        level: result.provenance.level.clone(),
        results: 0,
    });
    first.results += 1;
    if first.results <= KEPT_AT_ONCE {
        insert_refused(work, worker, result, class, reason).await?;
    }
    Ok(())
}

/// Makes known what was refused, and makes room for it.
pub(super) async fn settle(work: &mut Work<'_>, evidence: Evidence) -> Result<(), StoreError> {
    for ((worker, class), First { job, attempt, reason, level, results }) in evidence.0 {
        delete_oldest_of(work, class, worker).await?;
        delete_beyond(work, class).await?;
        work.events.push(match class {
            Class::Refused => Event::Refused { job, worker, attempt, reason, results },
            Class::Nondeterminism => Event::Nondeterminism { job, worker, attempt, level, results },
        });
    }
    Ok(())
}

/// Keeps the newest of a worker.
async fn delete_oldest_of(work: &mut Work<'_>, class: Class, worker: WorkerId) -> Result<(), StoreError> {
    sqlx::query(
        "delete from refused_results where class = ?1 and worker = ?2 and refused <= (
             select r.refused from refused_results as r where r.class = ?1 and r.worker = ?2
             order by r.refused desc limit 1 offset ?3)",
    )
    .bind(class.name())
    .bind(worker.0.as_bytes().as_slice())
    .bind(work.config.evidence_per_worker)
    .execute(&mut *work.db)
    .await?;
    Ok(())
}

/// Makes room in a class: the oldest of the worker with most goes, so that none washes out what
/// there is of others.
async fn delete_beyond(work: &mut Work<'_>, class: Class) -> Result<(), StoreError> {
    let there: i64 = sqlx::query_scalar("select count(*) from refused_results where class = ?")
        .bind(class.name())
        .fetch_one(&mut *work.db)
        .await?;
    for _ in i64::from(work.config.evidence)..there {
        sqlx::query(
            "delete from refused_results where refused = (
                 select min(r.refused) from refused_results as r where r.class = ?1
                 group by r.worker order by count(*) desc, min(r.refused) limit 1)",
        )
        .bind(class.name())
        .execute(&mut *work.db)
        .await?;
    }
    Ok(())
}

async fn insert_refused(
    work: &mut Work<'_>,
    worker: WorkerId,
    result: &Prepared,
    class: Class,
    reason: &str,
) -> Result<(), StoreError> {
    let body = (result.body.len() <= LARGEST_BODY).then_some(result.body.as_slice());
    sqlx::query(
        "insert into refused_results (job, attempt, worker, class, reason, digest, body, level, refused_ms, token)
         values (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, (select w.token from workers as w where w.id = ?3))",
    )
    .bind(result.job.0)
    .bind(result.attempt)
    .bind(worker.0.as_bytes().as_slice())
    .bind(class.name())
    .bind(reason)
    .bind(result.digest.as_slice())
    .bind(body)
    .bind(&result.provenance.level)
    .bind(work.now)
    .execute(&mut *work.db)
    .await?;
    Ok(())
}

type EvidenceRow = (i64, i64, Vec<u8>, String, String, String, i64, Option<String>, Option<String>);

impl Store {
    /// Evidence, the newest first, without what cannot be read.
    pub(crate) async fn evidence(&self, class: Option<&str>, limit: u32) -> Result<Vec<EvidenceView>, StoreError> {
        let rows = sqlx::query(
            "select r.job, r.attempt, r.worker, r.class, r.reason, r.level, r.refused_ms, w.name,
                    coalesce(r.token, w.token), r.refused
             from refused_results as r left join workers as w on w.id = r.worker
             where ?1 is null or r.class = ?1 order by r.refused desc limit ?2",
        )
        .bind(class)
        .bind(limit)
        .fetch_all(self.readers())
        .await?;
        Ok(rows.iter().filter_map(listed).collect())
    }
}

/// A piece of evidence, or nothing where its row cannot be read: one damaged row must not hide the others.
fn listed(row: &SqliteRow) -> Option<EvidenceView> {
    let raw: Result<EvidenceRow, sqlx::Error> = sqlx::FromRow::from_row(row);
    let read = raw.map_err(StoreError::from).and_then(view);
    let told = |error: &StoreError| {
        let evidence: i64 = row.try_get("refused").unwrap_or_default();
        tracing::error!(evidence, error.cause = %error, "A refused result cannot be read and is passed over");
    };
    read.inspect_err(told).ok()
}

fn view(row: EvidenceRow) -> Result<EvidenceView, StoreError> {
    let (job, attempt, worker, class, reason, level, at, worker_name, token) = row;
    let (attempt, worker) = (unsigned(attempt)?, WorkerId(uuid(&worker)?));
    Ok(EvidenceView { job: JobId(job), attempt, worker, worker_name, token, class, reason, level, at: rfc3339(at) })
}
