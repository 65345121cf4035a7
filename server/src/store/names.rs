//! States and roles as the tables spell them.

use manduca_protocol::task::JobKind;
use manduca_protocol::view::{JobRole, JobState, StudyState};
use serde::Deserialize;
use serde::de::value::{Error, StrDeserializer};
use serde::de::{DeserializeOwned, IntoDeserializer};
use uuid::Uuid;

use super::StoreError;
use super::search::Chain;

/// Where a study is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Stage {
    Sampling,
    Training,
    Optimising,
    Verifying,
    Refining,
}

/// Whether a study moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Condition {
    Running,
    Paused,
    Succeeded,
    Failed,
    Cancelled,
}

impl Stage {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Sampling => "sampling",
            Self::Training => "training",
            Self::Optimising => "optimising",
            Self::Verifying => "verifying",
            Self::Refining => "refining",
        }
    }

    /// What most of the stage's jobs are for.
    pub(crate) fn role(self) -> JobRole {
        match self {
            Self::Sampling => JobRole::Sample,
            Self::Training => JobRole::Train,
            Self::Optimising => JobRole::Optimise,
            Self::Verifying => JobRole::Verify,
            Self::Refining => JobRole::Probe,
        }
    }

    /// All that jobs of the stage are for.
    pub(crate) fn roles(self) -> &'static [JobRole] {
        match self {
            Self::Sampling => &[JobRole::Sample, JobRole::Audit],
            Self::Training => &[JobRole::Train],
            Self::Optimising => &[JobRole::Optimise, JobRole::Individual, JobRole::Generation],
            Self::Verifying => &[JobRole::Verify],
            Self::Refining => &[JobRole::Probe, JobRole::Search],
        }
    }

    /// The search whose rounds and strokes take turns in this stage.
    pub(super) fn chain(self) -> Option<Chain> {
        match self {
            Self::Optimising => Some(Chain::Breeding),
            Self::Refining => Some(Chain::Refining),
            Self::Sampling | Self::Training | Self::Verifying => None,
        }
    }

    /// What users call a study which moves in this stage.
    pub(crate) fn state(self) -> StudyState {
        match self {
            Self::Sampling => StudyState::Sampling,
            Self::Training => StudyState::Training,
            Self::Optimising => StudyState::Optimising,
            Self::Verifying => StudyState::Verifying,
            Self::Refining => StudyState::Refining,
        }
    }
}

impl Condition {
    /// What users call a study in this condition.
    pub(crate) fn state(self, stage: Stage) -> StudyState {
        match self {
            Self::Running => stage.state(),
            Self::Paused => StudyState::Paused,
            Self::Succeeded => StudyState::Succeeded,
            Self::Failed => StudyState::Failed,
            Self::Cancelled => StudyState::Cancelled,
        }
    }
}

/// The name of a role.
pub(crate) fn role_name(role: JobRole) -> &'static str {
    match role {
        JobRole::Sample => "sample",
        JobRole::Train => "train",
        JobRole::Optimise => "optimise",
        JobRole::Verify => "verify",
        JobRole::Search => "search",
        JobRole::Probe => "probe",
        JobRole::Generation => "generation",
        JobRole::Individual => "individual",
        JobRole::Audit => "audit",
    }
}

/// The computation a role asks for.
pub(crate) fn kind_of(role: JobRole) -> JobKind {
    match role {
        JobRole::Sample | JobRole::Verify | JobRole::Probe | JobRole::Individual | JobRole::Audit => JobKind::Simulate,
        JobRole::Train => JobKind::Train,
        JobRole::Optimise => JobKind::Optimise,
        JobRole::Search | JobRole::Generation => JobKind::Search,
    }
}

/// The name of a job's state.
pub(crate) fn state_name(state: JobState) -> &'static str {
    match state {
        JobState::Ready => "ready",
        JobState::Delayed => "delayed",
        JobState::Leased => "leased",
        JobState::Succeeded => "succeeded",
        JobState::Infeasible => "infeasible",
        JobState::Dead => "dead",
        JobState::Cancelled => "cancelled",
    }
}

/// What a column's text names; the spelling is that of the wire.
pub(crate) fn named<T: DeserializeOwned>(text: &str) -> Result<T, StoreError> {
    let deserializer: StrDeserializer<'_, Error> = text.into_deserializer();
    T::deserialize(deserializer).map_err(|e| StoreError::Corrupt(e.to_string()))
}

/// The UUID in a column.
pub(super) fn uuid(bytes: &[u8]) -> Result<Uuid, StoreError> {
    Uuid::from_slice(bytes).map_err(|e| StoreError::Corrupt(e.to_string()))
}

/// A number which is never negative.
pub(super) fn unsigned<T: TryFrom<i64>>(value: i64) -> Result<T, StoreError> {
    T::try_from(value).map_err(|_| StoreError::Corrupt(format!("{value} is out of range")))
}
