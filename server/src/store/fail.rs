//! An attempt fails: the job waits and is tried again, or is given up.

use manduca_protocol::ids::{JobId, WorkerId};
use manduca_protocol::view::JobState;
use manduca_protocol::worker::{Failure, Fault};

use super::blame::{self, Failed};
use super::checkpoint::drop_inherited;
use super::complete::{JobRow, NO_JOB, NOT_PRESENT, find_job};
use super::workers::Tallies;
use super::{StoreError, Work};
use crate::event::Event;
use crate::validity::{LONGEST_TEXT, cut};

/// What became of a reported failure.
pub(super) enum Reported {
    /// Counted now; the study whose job it was.
    Counted(i64),
    /// Counted before.
    Known,
    /// Not this worker's to report.
    Refused(String),
}

/// A worker reports that its attempt failed.
pub(super) async fn fail(
    work: &mut Work<'_>,
    worker: WorkerId,
    failure: &Failure,
    tallies: &mut Tallies,
) -> Result<Reported, StoreError> {
    let Some(job) = find_job(work.db, failure.job).await? else {
        return Ok(Reported::Refused(NO_JOB.into()));
    };
    if !job.is_held_by(worker, failure.attempt) {
        return Ok(Reported::Refused(NOT_PRESENT.into()));
    }
    match job.state {
        JobState::Leased => {
            let reason = cut(&failure.reason, LONGEST_TEXT);
            let failed = Failed { worker, fault: failure.fault.unwrap_or(Fault::Machine), reason: &reason };
            fail_attempt(work, &job, Cause::Failed(failed), tallies).await?;
            Ok(Reported::Counted(job.study))
        }
        // The answer to the first report was lost, or the lease expired meanwhile: it is counted.
        JobState::Delayed | JobState::Ready | JobState::Dead => Ok(Reported::Known),
        JobState::Cancelled => Ok(Reported::Refused("the study was cancelled".into())),
        JobState::Succeeded | JobState::Infeasible => Ok(Reported::Refused("the job is finished".into())),
    }
}

/// How an attempt failed.
#[derive(Debug, Clone, Copy)]
pub(super) enum Cause<'r> {
    /// Its worker said so, or returned what is of no use.
    Failed(Failed<'r>),
    /// Its worker was not heard of.
    Expired(&'r str),
}

/// Counts a failure of a leased job, or the loss of its worker. After the last one the
/// job is dead; before, it waits longer from one failure to the next, since what failed
/// may be the machine. A lease which expired has been waited for: its job is ready at
/// once, and it is given up much later, since it is hardly ever the job which takes its
/// worker away.
pub(super) async fn fail_attempt(
    work: &mut Work<'_>,
    job: &JobRow,
    cause: Cause<'_>,
    tallies: &mut Tallies,
) -> Result<(), StoreError> {
    let (reason, expired) = match cause {
        Cause::Failed(failed) => (failed.reason, false),
        Cause::Expired(reason) => (reason, true),
    };
    let (failures, losses) = (job.failures + u32::from(!expired), job.losses + u32::from(expired));
    let dead = match cause {
        Cause::Failed(mut failed) => {
            // It went on from what another computed, which may be to blame.
            if drop_inherited(work, job, failed.worker).await? && failed.fault == Fault::Machine {
                failed.fault = Fault::Failed;
            }
            blame::note(work, job.job, job.attempt, failures, failed, tallies).await?
        }
        Cause::Expired(_) => losses >= work.config.max_losses,
    };
    let (state, not_before) = match (dead, expired) {
        (true, _) => ("dead", None),
        (false, true) => ("ready", None),
        // What nobody credible has tried yet does not wait for long.
        (false, false) => ("delayed", Some(work.now + work.config.backoff_ms(failures.min(work.config.max_attempts)))),
    };
    set_failed(work, job.job, state, [failures, losses], not_before, reason).await?;
    work.events.push(Event::Failed {
        study: job.study_id,
        job: job.job,
        attempt: job.attempt,
        reason: reason.into(),
        dead,
        expired,
    });
    if state == "ready" {
        work.events.push(Event::Ready);
    }
    Ok(())
}

async fn set_failed(
    work: &mut Work<'_>,
    job: JobId,
    state: &'static str,
    [failures, losses]: [u32; 2],
    not_before: Option<i64>,
    reason: &str,
) -> Result<(), StoreError> {
    sqlx::query(
        "update jobs set state = ?, failures = ?, losses = ?, not_before_ms = ?, reason = ?, lease_until_ms = null, progress = null
         where job = ?",
    )
    .bind(state)
    .bind(failures)
    .bind(losses)
    .bind(not_before)
    .bind(reason)
    .bind(job.0)
    .execute(&mut *work.db)
    .await?;
    Ok(())
}
