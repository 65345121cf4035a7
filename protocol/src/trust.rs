//! What users are told of results that are compared, and of workers that are not believed.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::ids::WorkerId;

/// What became of a study's audits.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct AuditVerdicts {
    /// Equal results that came in under two different tokens.
    pub independent: u64,
    /// Equal results that came in under one token, or where no tokens are asked for.
    pub not_independent: u64,
    /// Different results that the coordinator has yet to settle by a flight of its own.
    pub disputed: u64,
    /// Different results that the coordinator could not settle.
    pub undecided: u64,
}

impl AuditVerdicts {
    /// Whether nothing was compared.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// A worker whose results in a study are not believed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct DistrustedWorker {
    /// The worker.
    pub worker: WorkerId,
    /// Its name.
    pub name: String,
    /// The token it registered with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub token: Option<String>,
    /// Why it is set aside; none once it was readmitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Results that were dropped; their jobs were queued again.
    pub replaced: u64,
    /// Results that the study still rests on.
    pub disowned: u64,
}

/// Whether a count is left out.
pub(crate) fn is_none(count: &u64) -> bool {
    *count == 0
}
