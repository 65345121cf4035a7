//! The counters per study, role and state. The triggers of the migration keep them.

use manduca_protocol::view::{JobCounts, JobRole, JobState};
use sqlx::sqlite::SqliteExecutor;

use super::StoreError;
use super::names::{named, role_name, unsigned};

/// The counters of one role of a study.
pub(super) async fn read_counts(
    db: impl SqliteExecutor<'_>,
    study: i64,
    role: JobRole,
) -> Result<JobCounts, StoreError> {
    let rows: Vec<(String, i64)> = sqlx::query_as("select state, n from study_counts where study = ? and role = ?")
        .bind(study)
        .bind(role_name(role))
        .fetch_all(db)
        .await?;
    let mut counts = JobCounts::default();
    for (state, n) in rows {
        *slot(&mut counts, named(&state)?) = unsigned(n)?;
    }
    Ok(counts)
}

fn slot(counts: &mut JobCounts, state: JobState) -> &mut u64 {
    match state {
        JobState::Ready => &mut counts.ready,
        JobState::Delayed => &mut counts.delayed,
        JobState::Leased => &mut counts.leased,
        JobState::Succeeded => &mut counts.succeeded,
        JobState::Infeasible => &mut counts.infeasible,
        JobState::Dead => &mut counts.dead,
        JobState::Cancelled => &mut counts.cancelled,
    }
}

/// Jobs which still wait or run.
pub(crate) fn open_jobs(counts: &JobCounts) -> u64 {
    counts.ready + counts.delayed + counts.leased
}
