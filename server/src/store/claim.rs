//! Ready jobs are leased.

use std::sync::Arc;

use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use manduca_protocol::study::StudySpec;
use manduca_protocol::view::JobRole;
use sqlx::sqlite::SqliteConnection;

use super::names::{named, unsigned};
use super::{StoreError, Work};
use crate::http::cursor::hex;

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

/// Leases ready jobs to these workers in turn, one each, as far as there are
/// any: first what brings a study nearer to its end (one training frees a whole
/// study, one sample does not), then samples of the oldest study.
pub(super) async fn claim(work: &mut Work<'_>, workers: &[WorkerId]) -> Result<Vec<Leased>, StoreError> {
    let mut leased = Vec::new();
    if workers.is_empty() {
        return Ok(leased);
    }
    for (study, role) in list_claimable(work.db, workers.len()).await? {
        let left = workers.len() - leased.len();
        if left == 0 {
            break;
        }
        let rows = list_ready(work.db, study, &role, left).await?;
        if rows.is_empty() {
            continue;
        }
        let (id, spec) = work.specs.of(work.db, study).await?;
        let role = named::<JobRole>(&role)?;
        for (job, attempt, ordinal, parameters) in rows {
            leased.push(Leased {
                job: JobId(job),
                attempt: unsigned(attempt + 1)?,
                study: id,
                role,
                ordinal: unsigned(ordinal)?,
                parameters,
                spec: spec.clone(),
            });
        }
    }
    let holders: Vec<_> = leased.iter().zip(workers).map(|(l, w)| (l.job.0, hex(w.0.as_bytes()))).collect();
    if !holders.is_empty() {
        lease_jobs(work, &holders).await?;
    }
    Ok(leased)
}

async fn list_claimable(db: &mut SqliteConnection, limit: usize) -> Result<Vec<(i64, String)>, StoreError> {
    let rows = sqlx::query_as(
        "select c.study, c.role from study_counts as c join studies as s on s.study = c.study
         where c.state = 'ready' and c.n > 0 and s.condition = 'running'
         order by c.role = 'sample', c.study limit ?",
    )
    .bind(limit as i64)
    .fetch_all(db)
    .await?;
    Ok(rows)
}

type ReadyRow = (i64, i64, i64, Option<String>);

/// Nobody else writes between this and the lease.
async fn list_ready(
    db: &mut SqliteConnection,
    study: i64,
    role: &str,
    limit: usize,
) -> Result<Vec<ReadyRow>, StoreError> {
    let rows = sqlx::query_as(
        "select job, attempt, ordinal, parameters from jobs
         where state = 'ready' and study = ? and role = ? order by ordinal limit ?",
    )
    .bind(study)
    .bind(role)
    .bind(limit as i64)
    .fetch_all(db)
    .await?;
    Ok(rows)
}

async fn lease_jobs(work: &mut Work<'_>, holders: &[(i64, String)]) -> Result<(), StoreError> {
    let holders = serde_json::to_string(holders).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    sqlx::query(
        "update jobs set state = 'leased', attempt = attempt + 1, worker = unhex(d.value ->> 1), lease_until_ms = ?1,
                         progress = null
         from json_each(?2) as d where jobs.job = d.value ->> 0",
    )
    .bind(work.now + work.config.lease_ms())
    .bind(holders)
    .execute(&mut *work.db)
    .await?;
    Ok(())
}
