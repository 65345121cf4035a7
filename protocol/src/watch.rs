//! What those are shown who watch the service, scale it, or ask why.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::ids::{JobId, StudyId, WorkerId};
use crate::view::{JobRole, JobState};
use crate::who::ComputedBy;

/// How much there is to do, and for how many. `GET /v1/scaling`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ScalingView {
    /// Jobs which wait for a slot.
    pub ready_jobs: u64,
    /// Jobs which wait after a failure.
    pub delayed_jobs: u64,
    /// Jobs in slots.
    pub leased_jobs: u64,
    /// Workers heard of lately.
    pub workers: u64,
    /// Their slots, without those of workers draining or set aside.
    pub slots: u64,
    /// Slots without a job.
    pub idle_slots: u64,
    /// Slots which would have a job if there were as many.
    pub wanted_slots: u64,
}

/// Who has a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LeaseView {
    /// The worker.
    pub worker: WorkerId,
    /// Its name.
    pub name: String,
    /// The name of the token that registered it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub token: Option<String>,
    /// For how long it has had the job, s.
    pub running_s: Option<f64>,
    /// For how long it may, s.
    pub run_limit_s: f64,
    /// When the lease ends unless it is renewed, s from now.
    pub expires_s: f64,
}

/// An attempt that failed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FailedAttempt {
    /// Which attempt it was.
    pub attempt: u32,
    /// The worker that made it.
    pub worker: WorkerId,
    /// The name of this worker, while it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worker_name: Option<String>,
    /// The name of the token that registered this worker.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub token: Option<String>,
    /// What the worker blames: `refused` or `failed` is the task, `machine` its machine.
    pub fault: String,
    /// Why, cut after 300 characters.
    pub reason: String,
    /// RFC 3339, UTC.
    pub at: String,
}

/// Why a job is where it is. `GET /v1/jobs/{job}/explain`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Explanation {
    /// The job.
    pub job: JobId,
    /// Its study.
    pub study: StudyId,
    /// What it is for.
    pub role: JobRole,
    /// State.
    pub state: JobState,
    /// In sentences.
    pub because: Vec<String>,
    /// Ready jobs which are leased before it, about, where it is ready: running studies share the slots.
    pub jobs_ahead: Option<u64>,
    /// Until it may be leased again, s, where it is delayed.
    pub waits_s: Option<f64>,
    /// Who has it.
    pub lease: Option<LeaseView>,
    /// Who computed its result.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub computed_by: Option<ComputedBy>,
    /// Attempts which failed.
    pub failures: u32,
    /// Workers which were lost with it.
    #[serde(default)]
    pub losses: u32,
    /// Why the last one did, or why the stroke is infeasible.
    pub last_failure: Option<String>,
    /// The attempts that failed and are not contradicted by a result, as far as they are kept.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failed_attempts: Vec<FailedAttempt>,
    /// Slots of all workers which may be given jobs.
    pub slots: u64,
}

/// A result which was refused, or which contradicts one taken before. `GET /v1/evidence`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EvidenceView {
    /// The job.
    pub job: JobId,
    /// The attempt it was returned as.
    pub attempt: u32,
    /// Who returned it.
    pub worker: WorkerId,
    /// The name of this worker, while it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worker_name: Option<String>,
    /// The name of the token that registered this worker.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub token: Option<String>,
    /// `refused` or `nondeterminism`.
    pub class: String,
    /// Why.
    pub reason: String,
    /// Instruction level it was computed on.
    pub level: String,
    /// RFC 3339, UTC.
    pub at: String,
}
