//! Users stop studies, for now or for good, and set them going again.

use manduca_protocol::ids::StudyId;
use manduca_protocol::view::{JobRole, StudyState};
use sqlx::sqlite::SqliteConnection;

use super::advance::{StudyRow, end_stage, find_study, set_stage};
use super::blame;
use super::count::{open_jobs, read_counts};
use super::names::{Condition, Stage, role_name};
use super::unreadable::{advance_or_fail, cancel_unreadable};
use super::{Operation, StoreError, Work};
use crate::event::Event;

/// What a user wants of a study.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Action {
    /// No new leases.
    Pause,
    /// Leases again.
    Resume,
    /// The end.
    Cancel,
    /// Jobs given up are tried again.
    RetryFailed,
}

impl Action {
    /// Its name in paths and in the log.
    fn name(self) -> &'static str {
        match self {
            Self::Pause => "pause",
            Self::Resume => "resume",
            Self::Cancel => "cancel",
            Self::RetryFailed => "retry-failed",
        }
    }
}

/// Does what a user wants. Wanting what already is changes nothing.
pub(crate) struct Control {
    pub(crate) study: StudyId,
    pub(crate) action: Action,
    /// Name of the token that asks for it.
    pub(crate) by: Option<String>,
}

impl Operation for Control {
    type Output = ();

    async fn apply(self, work: &mut Work<'_>) -> Result<(), StoreError> {
        let study = find_number(work.db, self.study).await?;
        let row = match find_study(work.db, study).await {
            Err(StoreError::Corrupt(_)) if self.action == Action::Cancel => {
                cancel_jobs(work.db, study).await?;
                return cancel_unreadable(work, study).await;
            }
            row => row?,
        };
        let events = work.events.len();
        act(work, &row, self.action).await?;
        if work.events.len() > events {
            note_steering(work, &row, self.action.name(), self.by).await?;
        }
        Ok(())
    }
}

/// Keeps who steered a study, and what for in the log.
pub(super) async fn note_steering(
    work: &mut Work<'_>,
    row: &StudyRow,
    action: &'static str,
    by: Option<String>,
) -> Result<(), StoreError> {
    sqlx::query("update studies set steered_by = ? where study = ?")
        .bind(&by)
        .bind(row.study)
        .execute(&mut *work.db)
        .await?;
    work.events.push(Event::Steered { study: row.id, action, by });
    Ok(())
}

async fn act(work: &mut Work<'_>, row: &StudyRow, action: Action) -> Result<(), StoreError> {
    match (action, row.condition) {
        (Action::Pause, Condition::Running) => pause(work, row).await,
        (Action::Resume, Condition::Paused) => {
            row.check_numbers()?;
            resume(work, row).await
        }
        (Action::Cancel, Condition::Running | Condition::Paused | Condition::Failed) => cancel(work, row).await,
        (Action::RetryFailed, Condition::Running | Condition::Paused | Condition::Failed) => {
            row.check_numbers()?;
            retry_failed(work, row).await
        }
        (Action::Pause, Condition::Paused)
        | (Action::Resume, Condition::Running)
        | (Action::Cancel, Condition::Cancelled) => Ok(()),
        (action, condition) => Err(wrong_state(action, condition)),
    }
}

fn wrong_state(action: Action, condition: Condition) -> StoreError {
    let action = match action {
        Action::Pause => "paused",
        Action::Resume => "resumed",
        Action::Cancel => "cancelled",
        Action::RetryFailed => "retried",
    };
    let condition = match condition {
        Condition::Running => "is running",
        Condition::Paused => "is paused",
        Condition::Succeeded => "has succeeded",
        Condition::Failed => "has failed",
        Condition::Cancelled => "is cancelled",
    };
    StoreError::WrongState(format!("the study {condition} and cannot be {action}"))
}

/// The short number of a study.
pub(super) async fn find_number(db: &mut SqliteConnection, id: StudyId) -> Result<i64, StoreError> {
    sqlx::query_scalar("select study from studies where id = ?")
        .bind(id.0.as_bytes().as_slice())
        .fetch_optional(db)
        .await?
        .ok_or(StoreError::UnknownStudy(id))
}

async fn pause(work: &mut Work<'_>, row: &StudyRow) -> Result<(), StoreError> {
    set_condition(work.db, row.study, "paused").await?;
    work.events.push(Event::Moved { study: row.id, state: StudyState::Paused, reason: None });
    Ok(())
}

async fn resume(work: &mut Work<'_>, row: &StudyRow) -> Result<(), StoreError> {
    set_condition(work.db, row.study, "running").await?;
    work.events.push(Event::Moved { study: row.id, state: row.stage.state(), reason: None });
    work.events.push(Event::Ready);
    // What ran on may have finished the stage meanwhile.
    advance_or_fail(work, row.study).await
}

/// Final. Leased jobs are cancelled too: their workers hear of it at the next
/// renewal, and what they still return is refused.
async fn cancel(work: &mut Work<'_>, row: &StudyRow) -> Result<(), StoreError> {
    cancel_jobs(work.db, row.study).await?;
    end_stage(work, row.study, row.stage).await?;
    set_condition(work.db, row.study, "cancelled").await?;
    work.events.push(Event::Moved { study: row.id, state: StudyState::Cancelled, reason: None });
    Ok(())
}

async fn set_condition(db: &mut SqliteConnection, study: i64, condition: &'static str) -> Result<(), StoreError> {
    sqlx::query("update studies set condition = ? where study = ?").bind(condition).bind(study).execute(db).await?;
    Ok(())
}

async fn cancel_jobs(db: &mut SqliteConnection, study: i64) -> Result<(), StoreError> {
    sqlx::query(
        "update jobs set state = 'cancelled', lease_until_ms = null, not_before_ms = null, progress = null
         where study = ? and state in ('ready', 'delayed', 'leased')",
    )
    .bind(study)
    .execute(db)
    .await?;
    Ok(())
}

/// The stages whose dead jobs may run again when a study is in `stage`: the
/// optima of earlier optimisations can still be added to, but the network is
/// never trained again on other samples.
fn retried(stage: Stage) -> &'static [Stage] {
    match stage {
        Stage::Sampling => &[Stage::Sampling],
        Stage::Training => &[Stage::Training],
        Stage::Optimising | Stage::Verifying => &[Stage::Optimising, Stage::Verifying],
        Stage::Refining => &[Stage::Refining],
    }
}

async fn retry_failed(work: &mut Work<'_>, row: &StudyRow) -> Result<(), StoreError> {
    let mut first = None;
    for &stage in retried(row.stage) {
        for &role in stage.roles() {
            // What was computed by a worker whose results are disowned waits to be computed again.
            if row.condition == Condition::Failed && open_jobs(&read_counts(&mut *work.db, row.study, role).await?) > 0
            {
                first = first.or(Some(stage));
            }
            // A stroke given up has been answered: the search went on without it.
            if !matches!(role, JobRole::Probe | JobRole::Individual) && revive_dead(work.db, row.study, role).await? > 0
            {
                first = first.or(Some(stage));
            }
        }
    }
    let Some(stage) = first else {
        return match row.condition {
            Condition::Failed => Err(StoreError::WrongState(
                "the study has failed without a failed job: there is nothing to try again".into(),
            )),
            _ => Ok(()),
        };
    };
    work.events.push(Event::Ready);
    if row.condition == Condition::Failed || stage != row.stage {
        let paused = row.condition == Condition::Paused;
        set_stage(work, row, stage).await?;
        if paused {
            pause(work, row).await?;
        }
    }
    Ok(())
}

async fn revive_dead(db: &mut SqliteConnection, study: i64, role: JobRole) -> Result<u64, StoreError> {
    if read_counts(&mut *db, study, role).await?.dead == 0 {
        return Ok(0);
    }
    blame::forget(&mut *db, study, role_name(role)).await?;
    let revived = sqlx::query(
        "update jobs set state = 'ready', failures = 0, losses = 0, worker = null
         where state = 'dead' and study = ? and role = ?",
    )
    .bind(study)
    .bind(role_name(role))
    .execute(db)
    .await?;
    Ok(revived.rows_affected())
}
