//! Refused results are kept for whoever looks into a fault, the newest of them.

use manduca_protocol::ids::{JobId, WorkerId};
use manduca_protocol::watch::EvidenceView;

use super::complete::Prepared;
use super::names::{unsigned, uuid};
use super::{Store, StoreError, Work};
use crate::clock::rfc3339;
use crate::event::Event;

/// Largest body kept, bytes as stored.
const LARGEST_BODY: usize = 64 << 10;

/// Why a result is evidence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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

/// Keeps a refused result and makes it known.
pub(super) async fn refuse(
    work: &mut Work<'_>,
    worker: WorkerId,
    result: &Prepared,
    class: Class,
    reason: &str,
) -> Result<(), StoreError> {
    let kept = insert_refused(work, worker, result, class, reason).await?;
    delete_refused_before(work, kept - i64::from(work.config.evidence)).await?;
    let (job, attempt) = (result.job, result.attempt);
    work.events.push(match class {
        Class::Refused => Event::Refused { job, worker, attempt, reason: reason.into() },
        Class::Nondeterminism => Event::Nondeterminism { job, worker, attempt, level: result.provenance.level.clone() },
    });
    Ok(())
}

async fn insert_refused(
    work: &mut Work<'_>,
    worker: WorkerId,
    result: &Prepared,
    class: Class,
    reason: &str,
) -> Result<i64, StoreError> {
    let body = (result.body.len() <= LARGEST_BODY).then_some(result.body.as_slice());
    let inserted = sqlx::query(
        "insert into refused_results (job, attempt, worker, class, reason, digest, body, level, refused_ms)
         values (?, ?, ?, ?, ?, ?, ?, ?, ?)",
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
    Ok(inserted.last_insert_rowid())
}

async fn delete_refused_before(work: &mut Work<'_>, last: i64) -> Result<(), StoreError> {
    sqlx::query("delete from refused_results where refused <= ?").bind(last).execute(&mut *work.db).await?;
    Ok(())
}

type EvidenceRow = (i64, i64, Vec<u8>, String, String, String, i64, Option<String>, Option<String>);

impl Store {
    /// Evidence, the newest first.
    pub(crate) async fn evidence(&self, class: Option<&str>, limit: u32) -> Result<Vec<EvidenceView>, StoreError> {
        let rows: Vec<EvidenceRow> = sqlx::query_as(
            "select r.job, r.attempt, r.worker, r.class, r.reason, r.level, r.refused_ms, w.name, coalesce(r.token, w.token)
             from refused_results as r left join workers as w on w.id = r.worker
             where ?1 is null or r.class = ?1 order by r.refused desc limit ?2",
        )
        .bind(class)
        .bind(limit)
        .fetch_all(self.readers())
        .await?;
        rows.into_iter().map(view).collect()
    }
}

fn view(row: EvidenceRow) -> Result<EvidenceView, StoreError> {
    let (job, attempt, worker, class, reason, level, at, worker_name, token) = row;
    let (attempt, worker) = (unsigned(attempt)?, WorkerId(uuid(&worker)?));
    Ok(EvidenceView { job: JobId(job), attempt, worker, worker_name, token, class, reason, level, at: rfc3339(at) })
}
