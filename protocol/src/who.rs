//! Workers, and who computed what.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::ids::{JobId, WorkerId};

/// The origin of a result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ComputedBy {
    /// The job that was computed: the job itself, or the earlier one whose result it shares.
    pub job: JobId,
    /// The worker that computed it.
    pub worker: WorkerId,
    /// The name of this worker.
    pub worker_name: String,
    /// The name of the token that registered this worker; absent where no tokens were asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub token: Option<String>,
}

impl ComputedBy {
    /// The worker and its token, for people.
    pub fn sentence(&self) -> String {
        match &self.token {
            Some(token) => format!("worker `{}` of token `{token}`", self.worker_name),
            None => format!("worker `{}`", self.worker_name),
        }
    }
}

/// A worker. `GET /v1/workers`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WorkerView {
    /// Id.
    pub id: WorkerId,
    /// Name.
    pub name: String,
    /// Slots.
    pub slots: u32,
    /// Instruction level.
    pub level: String,
    /// Jobs it has now.
    pub leased: u64,
    /// Jobs it has finished.
    pub completed: u64,
    /// Attempts it has failed.
    pub failed: u64,
    /// Seconds since it was last heard of.
    pub last_seen_s: f64,
    /// Whether it still counts as alive.
    pub alive: bool,
    /// Attempts failed in a row.
    #[serde(default)]
    pub strikes: u32,
    /// Whether it is given no jobs for a while, because too many attempts in a row failed.
    #[serde(default)]
    pub quarantined: bool,
    /// Whether it was asked to finish what it has and leave.
    #[serde(default)]
    pub draining: bool,
    /// The name of the token that registered it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub token: Option<String>,
    /// The name of the token that asked it to leave.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drained_by: Option<String>,
    /// Why it is given no jobs until an operator readmits it: a wrong result, or an operator's word.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub set_aside: Option<String>,
}
