//! Ready jobs are leased.

use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use manduca_protocol::view::JobRole;
use sqlx::sqlite::SqliteConnection;

use super::names::{named, unsigned, uuid};
use super::{StoreError, Work};
use crate::event::Event;

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
    /// The study's specification, JSON.
    pub(crate) spec: std::sync::Arc<str>,
}

/// Leases at most `want` jobs to a worker: first what brings a study nearer to
/// its end (one training frees a whole study, one sample does not), then samples
/// of the oldest study.
pub(super) async fn claim(work: &mut Work<'_>, worker: WorkerId, want: u32) -> Result<Vec<Leased>, StoreError> {
    let mut leased = Vec::new();
    if want == 0 {
        return Ok(leased);
    }
    for (study, role) in list_claimable(work.db, want).await? {
        let left = want as usize - leased.len();
        if left == 0 {
            break;
        }
        let rows = lease_jobs(work, worker, study, &role, left).await?;
        if rows.is_empty() {
            continue;
        }
        let (id, spec) = find_spec(work.db, study).await?;
        let (id, spec, role) = (StudyId(uuid(&id)?), std::sync::Arc::<str>::from(spec), named::<JobRole>(&role)?);
        for (job, attempt, ordinal, parameters) in rows {
            leased.push(Leased {
                job: JobId(job),
                attempt: unsigned(attempt)?,
                study: id,
                role,
                ordinal: unsigned(ordinal)?,
                parameters,
                spec: spec.clone(),
            });
        }
    }
    if !leased.is_empty() {
        work.events.push(Event::Leased { worker, jobs: leased.len() });
    }
    Ok(leased)
}

async fn list_claimable(db: &mut SqliteConnection, limit: u32) -> Result<Vec<(i64, String)>, StoreError> {
    let rows = sqlx::query_as(
        "select c.study, c.role from study_counts as c join studies as s on s.study = c.study
         where c.state = 'ready' and c.n > 0 and s.condition = 'running'
         order by c.role = 'sample', c.study limit ?",
    )
    .bind(limit)
    .fetch_all(db)
    .await?;
    Ok(rows)
}

type LeasedRow = (i64, i64, i64, Option<String>);

async fn lease_jobs(
    work: &mut Work<'_>,
    worker: WorkerId,
    study: i64,
    role: &str,
    limit: usize,
) -> Result<Vec<LeasedRow>, StoreError> {
    let mut rows: Vec<LeasedRow> = sqlx::query_as(
        "update jobs set state = 'leased', attempt = attempt + 1, worker = ?1, lease_until_ms = ?2, progress = null
         where job in (select job from jobs where state = 'ready' and study = ?3 and role = ?4
                       order by ordinal limit ?5)
         returning job, attempt, ordinal, parameters",
    )
    .bind(worker.0.as_bytes().as_slice())
    .bind(work.now + work.config.lease_ms())
    .bind(study)
    .bind(role)
    .bind(limit as i64)
    .fetch_all(&mut *work.db)
    .await?;
    rows.sort_unstable_by_key(|row| row.2);
    Ok(rows)
}

async fn find_spec(db: &mut SqliteConnection, study: i64) -> Result<(Vec<u8>, String), StoreError> {
    Ok(sqlx::query_as("select id, spec from study_specs where study = ?").bind(study).fetch_one(db).await?)
}
