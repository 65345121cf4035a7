//! The conversation of worker and coordinator.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::ids::{JobId, StudyId, WorkerId};
use crate::strict;
use crate::task::{Checkpoint, JobKind, JobResult, Progress, Provenance};

/// Version of the exchange this code speaks.
pub const PROTOCOL_VERSION: u32 = 4;
/// Oldest version of the exchange a coordinator of this code still takes.
pub const OLDEST_PROTOCOL_VERSION: u32 = 1;
/// Most items in any list of an exchange.
pub const MAX_BATCH: usize = 1000;
/// Items of a list of an exchange at which it is not read any further; from [`MAX_BATCH`] on it is refused as a whole.
const MOST_LISTED: usize = 4 * MAX_BATCH;
/// Longest wait for work, s.
pub const MAX_WAIT_S: f64 = 30.0;

/// A worker introduces itself. `POST /v1/workers`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RegisterRequest {
    /// Name for people, such as the host's.
    pub name: String,
    /// Compute slots.
    pub slots: u32,
    /// Version of the exchange it speaks.
    pub protocol_version: u32,
    /// Version of its numbers; must be the coordinator's.
    pub solver_version: String,
    /// Instruction level.
    pub level: String,
}

/// The coordinator's answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RegisterResponse {
    /// Its id, unique to the process.
    pub worker: WorkerId,
    /// How long a lease lasts without renewal, s.
    pub lease_s: f64,
    /// How often to renew, s.
    pub renew_s: f64,
}

/// One round trip. `POST /v1/workers/{worker}/exchange`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ExchangeRequest {
    /// Finished jobs.
    #[serde(default, deserialize_with = "strict::list::<MOST_LISTED, _, _>")]
    pub complete: Vec<Completion>,
    /// Failed attempts.
    #[serde(default, deserialize_with = "strict::list::<MOST_LISTED, _, _>")]
    pub fail: Vec<Failure>,
    /// Jobs still computing.
    #[serde(default, deserialize_with = "strict::list::<MOST_LISTED, _, _>")]
    pub renew: Vec<Renewal>,
    /// Every job it has, where an answer was lost which may have brought some: what is leased
    /// to it and not among these is given to it again, as the same attempt. Since version 2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub have: Option<Vec<JobId>>,
    /// How many new jobs are wanted.
    #[serde(default)]
    pub want: u32,
    /// How long to wait for one when there is none, s.
    #[serde(default)]
    pub wait_s: f64,
}

/// A finished job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Completion {
    /// The job.
    pub job: JobId,
    /// The attempt it was leased as.
    pub attempt: u32,
    /// The result.
    pub result: JobResult,
    /// How it was computed.
    pub provenance: Provenance,
}

/// A failed attempt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Failure {
    /// The job.
    pub job: JobId,
    /// The attempt it was leased as.
    pub attempt: u32,
    /// Why.
    pub reason: String,
    /// What the worker blames; its machine where left out. Since version 4.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fault: Option<Fault>,
}

/// What a worker blames for a failed attempt.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Fault {
    /// The task, which is not valid: no machine can compute it.
    Refused,
    /// The task, whose computation ended without a result.
    Failed,
    /// The machine: a crash, a run limit, a task that did not arrive.
    Machine,
}

impl Fault {
    /// Its name, on the wire and in the store.
    pub fn name(self) -> &'static str {
        match self {
            Self::Refused => "refused",
            Self::Failed => "failed",
            Self::Machine => "machine",
        }
    }
}

/// A job still computing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Renewal {
    /// The job.
    pub job: JobId,
    /// The attempt it was leased as.
    pub attempt: u32,
    /// How far it is.
    #[serde(default)]
    pub progress: Option<Progress>,
    /// Where it could be taken up again, if that has changed.
    #[serde(default)]
    pub checkpoint: Option<Checkpoint>,
}

/// The coordinator's answer.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ExchangeResponse {
    /// Results and failures taken (also a replay of one taken before).
    pub accepted: Vec<JobId>,
    /// Results and failures refused: the worker forgets them.
    pub rejected: Vec<Rejected>,
    /// New leases.
    pub jobs: Vec<Lease>,
    /// Jobs to stop: cancelled, or no longer this worker's.
    pub cancel: Vec<JobId>,
    /// Finish what runs, take nothing new, leave.
    pub drain: bool,
}

/// A refused result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Rejected {
    /// The job.
    pub job: JobId,
    /// Why.
    pub reason: String,
}

/// A leased job. Its task is at `GET /v1/jobs/{job}/task` when not inline.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Lease {
    /// The job.
    pub job: JobId,
    /// Which attempt this is, from 1.
    pub attempt: u32,
    /// Its study.
    pub study: StudyId,
    /// Its kind.
    pub kind: JobKind,
    /// Longest it may compute, s.
    pub run_limit_s: f64,
    /// What to compute; absent where it is large and must be fetched.
    pub task: Option<crate::task::Task>,
}
