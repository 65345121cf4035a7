//! What the store decided, told after the commit which made it so.

use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use manduca_protocol::view::{JobRole, StudyState};

/// One decision.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Event {
    Submitted {
        study: StudyId,
        samples: u32,
        cached: u64,
        by: Option<String>,
    },
    /// A user steered a study.
    Steered {
        study: StudyId,
        /// What was asked, such as `pause`.
        action: &'static str,
        by: Option<String>,
    },
    Drawn {
        study: StudyId,
        jobs: u64,
    },
    Leased {
        worker: WorkerId,
        jobs: usize,
    },
    Completed {
        study: StudyId,
        job: JobId,
        role: JobRole,
        worker: WorkerId,
        outcome: &'static str,
        wall_s: f64,
    },
    Shared {
        study: StudyId,
        job: JobId,
        from: JobId,
    },
    Failed {
        study: StudyId,
        job: JobId,
        attempt: u32,
        reason: String,
        dead: bool,
        /// Whether nothing was heard of it, rather than that it failed.
        expired: bool,
    },
    /// Results were refused; the first of them is named.
    Refused {
        job: JobId,
        worker: WorkerId,
        attempt: u32,
        reason: String,
        results: u64,
    },
    /// Finished jobs got other results; the first of them is named.
    Nondeterminism {
        job: JobId,
        worker: WorkerId,
        attempt: u32,
        level: String,
        results: u64,
    },
    Moved {
        study: StudyId,
        state: StudyState,
        reason: Option<String>,
    },
    Registered {
        worker: WorkerId,
        name: String,
        slots: u32,
        level: String,
        by: Option<String>,
    },
    Left {
        worker: WorkerId,
        jobs: u64,
        by: Option<String>,
    },
    Quarantined {
        worker: WorkerId,
        name: String,
        strikes: i64,
        seconds: f64,
    },
    Draining {
        worker: WorkerId,
        by: Option<String>,
    },
    Audited {
        study: StudyId,
        job: JobId,
        worker: WorkerId,
        agrees: bool,
    },
    /// A result that is checked before it is believed.
    Unchecked {
        study: StudyId,
        job: JobId,
        role: JobRole,
        worker: WorkerId,
    },
    SetAside {
        worker: WorkerId,
        name: String,
        reason: String,
    },
    Readmitted {
        worker: WorkerId,
    },
    /// Results of a worker that are not believed any more, in one study.
    Disowned {
        study: StudyId,
        worker: WorkerId,
        /// Dropped, and their jobs queued again.
        replaced: i64,
        /// Kept, because something was built on them.
        marked: i64,
    },
    Pruned {
        study: StudyId,
        name: String,
        jobs: u64,
    },
    Recovered {
        leases: u64,
    },
    /// The coordinator could take no renewals for a while.
    Resumed {
        leases: u64,
        missed_s: f64,
    },
    /// Jobs may be leased which could not before.
    Ready,
}

impl Event {
    /// What this decision is counted as, if it is.
    pub(crate) fn name(&self) -> Option<&'static str> {
        Some(match self {
            Self::Submitted { .. } => "study_submitted",
            Self::Steered { .. } => "study_steered",
            Self::Drawn { .. } => "samples_drawn",
            Self::Leased { .. } => "leased",
            Self::Completed { .. } => "completed",
            Self::Shared { .. } => "shared",
            Self::Failed { expired: true, .. } => "lease_expired",
            Self::Failed { dead: true, .. } => "given_up",
            Self::Failed { .. } => "failed",
            Self::Refused { .. } => "refused",
            Self::Nondeterminism { .. } => "nondeterminism",
            Self::Moved { .. } => "study_moved",
            Self::Registered { .. } => "worker_registered",
            Self::Left { .. } => "worker_left",
            Self::Quarantined { .. } => "worker_quarantined",
            Self::Draining { .. } => "worker_draining",
            Self::Audited { agrees: true, .. } => "audit_agreed",
            Self::Audited { agrees: false, .. } => "audit_differed",
            Self::Unchecked { .. } => "unchecked",
            Self::SetAside { .. } => "worker_set_aside",
            Self::Readmitted { .. } => "worker_readmitted",
            Self::Disowned { .. } => "results_disowned",
            Self::Pruned { .. } => "study_pruned",
            Self::Recovered { .. } => "recovered",
            Self::Resumed { .. } => "resumed",
            Self::Ready => return None,
        })
    }

    /// How many decisions it tells of.
    pub(crate) fn count(&self) -> u64 {
        match self {
            Self::Refused { results, .. } | Self::Nondeterminism { results, .. } => *results,
            _ => 1,
        }
    }

    /// The study which it changed.
    pub(crate) fn study(&self) -> Option<StudyId> {
        match self {
            Self::Submitted { study, .. }
            | Self::Steered { study, .. }
            | Self::Drawn { study, .. }
            | Self::Completed { study, .. }
            | Self::Shared { study, .. }
            | Self::Failed { study, .. }
            | Self::Moved { study, .. }
            | Self::Audited { study, .. }
            | Self::Unchecked { study, .. }
            | Self::Disowned { study, .. }
            | Self::Pruned { study, .. } => Some(*study),
            Self::Leased { .. }
            | Self::Refused { .. }
            | Self::Nondeterminism { .. }
            | Self::Registered { .. }
            | Self::Left { .. }
            | Self::Quarantined { .. }
            | Self::Draining { .. }
            | Self::SetAside { .. }
            | Self::Readmitted { .. }
            | Self::Recovered { .. }
            | Self::Resumed { .. }
            | Self::Ready => None,
        }
    }

    /// Whether it changed what is told of workers.
    pub(crate) fn is_of_workers(&self) -> bool {
        matches!(
            self,
            Self::Leased { .. }
                | Self::Completed { .. }
                | Self::Failed { .. }
                | Self::Registered { .. }
                | Self::Left { .. }
                | Self::Quarantined { .. }
                | Self::Draining { .. }
                | Self::SetAside { .. }
                | Self::Readmitted { .. }
        )
    }

    /// The log line of this decision, if it has one.
    pub(crate) fn log(&self) {
        match self {
            Self::Submitted { study, samples, cached, by } => {
                tracing::info!(study.id = %study, study.samples = samples, study.cached = cached, by = by.as_deref(), "Study submitted");
            }
            Self::Steered { study, action, by } => {
                tracing::info!(study.id = %study, study.action = action, by = by.as_deref(), "Study steered");
            }
            Self::Drawn { study, jobs } => {
                tracing::info!(study.id = %study, jobs.count = jobs, "Further samples drawn for those without a result");
            }
            Self::Leased { worker, jobs } => {
                tracing::info!(worker.id = %worker, jobs.count = jobs, "Jobs leased");
            }
            Self::Completed { study, job, role, worker, outcome, wall_s } => {
                tracing::info!(study.id = %study, job.id = %job, job.role = ?role, job.outcome = outcome, job.wall_s = wall_s, worker.id = %worker, "Job completed");
            }
            Self::Shared { study, job, from } => {
                tracing::debug!(study.id = %study, job.id = %job, job.result_of = %from, "Job finished by an equal one's result");
            }
            Self::Failed { study, job, attempt, reason, dead: false, .. } => {
                tracing::warn!(study.id = %study, job.id = %job, job.attempt = attempt, job.reason = reason, "Attempt failed; the job will be tried again");
            }
            Self::Failed { study, job, attempt, reason, dead: true, .. } => {
                tracing::error!(study.id = %study, job.id = %job, job.attempt = attempt, job.reason = reason, "Attempt failed; the job is given up");
            }
            Self::Refused { job, worker, attempt, reason, results } => {
                tracing::warn!(job.id = %job, job.attempt = attempt, worker.id = %worker, job.reason = reason, results.count = results, "Results refused, of which this is the first");
            }
            Self::Nondeterminism { job, worker, attempt, level, results } => {
                tracing::warn!(job.id = %job, job.attempt = attempt, worker.id = %worker, worker.level = level, results.count = results, "A finished job got a different result from an equal machine");
            }
            Self::Moved { study, state, reason } => {
                tracing::info!(study.id = %study, study.state = ?state, study.reason = reason.as_deref(), "Study changed its state");
            }
            Self::Registered { worker, name, slots, level, by } => {
                tracing::info!(worker.id = %worker, worker.name = name, worker.slots = slots, worker.level = level, by = by.as_deref(), "Worker registered");
            }
            Self::Left { worker, jobs, by } => {
                tracing::info!(worker.id = %worker, jobs.count = jobs, by = by.as_deref(), "Worker left; its jobs are ready again");
            }
            Self::Quarantined { worker, name, strikes, seconds } => {
                tracing::warn!(worker.id = %worker, worker.name = name, worker.strikes = strikes, worker.quarantine_s = seconds, "Worker set aside: too many attempts failed in a row");
            }
            Self::Draining { worker, by } => {
                tracing::info!(worker.id = %worker, by = by.as_deref(), "Worker asked to finish what it has and leave");
            }
            Self::Audited { study, job, worker, agrees: true } => {
                tracing::info!(study.id = %study, job.id = %job, worker.id = %worker, "Audit agrees");
            }
            Self::Audited { study, job, worker, agrees: false } => {
                tracing::warn!(study.id = %study, job.id = %job, worker.id = %worker, "Audit differs; the coordinator flies the stroke itself");
            }
            Self::Unchecked { study, job, role, worker } => {
                tracing::debug!(study.id = %study, job.id = %job, job.role = ?role, worker.id = %worker, "Result is checked");
            }
            Self::SetAside { worker, name, reason } => {
                tracing::error!(worker.id = %worker, worker.name = name, worker.reason = reason, "Worker set aside until it is readmitted; its results are disowned");
            }
            Self::Readmitted { worker } => {
                tracing::info!(worker.id = %worker, "Worker readmitted");
            }
            Self::Disowned { study, worker, replaced, marked } => {
                tracing::warn!(study.id = %study, worker.id = %worker, results.replaced = replaced, results.marked = marked, "Results of a worker are disowned");
            }
            Self::Pruned { study, name, jobs } => {
                tracing::info!(study.id = %study, study.name = name, jobs.count = jobs, "Study removed, its time being over");
            }
            Self::Recovered { leases } => {
                tracing::info!(leases.count = leases, "Store opened; live leases have a new term");
            }
            Self::Resumed { leases, missed_s } => {
                tracing::warn!(
                    leases.count = leases,
                    server.missed_s = missed_s,
                    "No renewals could be taken for a while: the coordinator was stopped, or its disk was busy; live leases have a new term"
                );
            }
            Self::Ready => {}
        }
    }
}
