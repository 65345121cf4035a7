//! What users are shown.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::ids::{JobId, StudyId, WorkerId};
use crate::point::ParameterValues;
use crate::problem::FieldProblem;
use crate::study::{StudySpec, SurrogateKind};
use crate::task::{EpochMessage, ErrorsMessage, JobKind, Progress, Provenance, SimulateResult};
use crate::trust::{AuditVerdicts, DistrustedWorker, is_none};
use crate::who::ComputedBy;

pub use crate::answer::{
    OptimumResult, OptimumStatus, OptimumView, OutsideBox, PredictionRequest, PredictionResponse, SampleCounts,
    SearchView, StudyResult, SurrogateErrors,
};

/// State of a study.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StudyState {
    /// Simulations run.
    Sampling,
    /// The network is trained.
    Training,
    /// The network is optimised on.
    Optimising,
    /// Optima are simulated again.
    Verifying,
    /// Optima are refined by further simulations.
    Refining,
    /// Done.
    Succeeded,
    /// A stage could not be finished.
    Failed,
    /// Stopped by a user for good.
    Cancelled,
    /// Stopped by a user for now.
    Paused,
}

impl StudyState {
    /// Its name, on the wire and for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sampling => "sampling",
            Self::Training => "training",
            Self::Optimising => "optimising",
            Self::Verifying => "verifying",
            Self::Refining => "refining",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
            Self::Paused => "paused",
        }
    }
}

/// State of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum JobState {
    /// Waits for a worker.
    Ready,
    /// Waits after a failed attempt.
    Delayed,
    /// With a worker.
    Leased,
    /// Done.
    Succeeded,
    /// Answered: the stroke cannot be flown.
    Infeasible,
    /// Given up after the last attempt.
    Dead,
    /// Stopped by a user.
    Cancelled,
}

/// How many jobs are in each state.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[allow(missing_docs)]
pub struct JobCounts {
    pub ready: u64,
    pub delayed: u64,
    pub leased: u64,
    pub succeeded: u64,
    pub infeasible: u64,
    pub dead: u64,
    pub cancelled: u64,
}

/// A study in a list.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StudySummary {
    /// Id.
    pub id: StudyId,
    /// Name.
    pub name: String,
    /// State.
    pub state: StudyState,
    /// RFC 3339, UTC.
    pub created_at: String,
    /// Samples wanted.
    pub samples: u32,
    /// Samples which have their result.
    pub samples_succeeded: u64,
    /// The name of the token that submitted it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub submitted_by: Option<String>,
}

/// Wall time of the stages so far, s, pauses included.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[allow(missing_docs)]
pub struct StageSeconds {
    pub sampling: Option<f64>,
    pub training: Option<f64>,
    pub optimising: Option<f64>,
    pub verifying: Option<f64>,
    pub refining: Option<f64>,
}

/// A whole study. `GET /v1/studies/{study}`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StudyView {
    /// Id.
    pub id: StudyId,
    /// State.
    pub state: StudyState,
    /// The stage a paused study returns to.
    pub paused_from: Option<StudyState>,
    /// Why it failed.
    pub failure: Option<String>,
    /// RFC 3339, UTC.
    pub created_at: String,
    /// The name of the token that submitted it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub submitted_by: Option<String>,
    /// The name of the token that last paused, resumed, cancelled or retried it, or added an optimisation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steered_by: Option<String>,
    /// The study as submitted.
    pub spec: StudySpec,
    /// Version of the numbers it was begun with.
    #[serde(default)]
    pub solver_version: String,
    /// Sampling jobs by state.
    pub samples: JobCounts,
    /// Jobs of the present stage by state.
    pub stage_jobs: JobCounts,
    /// Where the stage's one long job is, or generations which are flown: strokes done and at most asked for.
    pub progress: Option<Progress>,
    /// Jobs per second over the last minute of this stage.
    pub rate_per_s: Option<f64>,
    /// Estimated seconds to the end of this stage.
    pub eta_s: Option<f64>,
    /// Samples flown again, by another worker where there is one, by state.
    #[serde(default)]
    pub audits: JobCounts,
    /// What became of these.
    #[serde(default, skip_serializing_if = "AuditVerdicts::is_empty")]
    pub audit_verdicts: AuditVerdicts,
    /// Workers whose results in this study are not believed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub distrusted: Vec<DistrustedWorker>,
    /// Results that the study rests on although they are not believed.
    #[serde(default, skip_serializing_if = "is_none")]
    pub disowned_results: u64,
    /// Wall time per stage.
    pub stages_s: StageSeconds,
    /// Errors of the network on the test share.
    pub surrogate: Option<ErrorsMessage>,
    /// Optima found so far.
    pub optimisations: Vec<OptimumView>,
}

/// Training without the weights, also while it runs. `GET /v1/studies/{study}/surrogate`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SurrogateView {
    /// What predicts.
    #[serde(default)]
    pub kind: SurrogateKind,
    /// Training curves, one network after the other; while it trains, as far as it is. Of a network with thousands of
    /// iterations every n-th, the best and the last. A gaussian process has none.
    pub curve: Vec<EpochMessage>,
    /// Iteration each finished network is from.
    #[serde(default)]
    pub best_iterations: Vec<u32>,
    /// Why each finished network stopped.
    #[serde(default)]
    pub stops: Vec<String>,
    /// Neurons of each network; 0 of a gaussian process.
    pub neurons: u32,
    /// Errors on the training share, once it is done.
    pub train: Option<ErrorsMessage>,
    /// Errors on the validation share, once it is done.
    pub validation: Option<ErrorsMessage>,
    /// Errors on the test share, once it is done.
    pub test: Option<ErrorsMessage>,
    /// Results of its study that are not believed any more.
    #[serde(default, skip_serializing_if = "is_none")]
    pub disowned_results: u64,
}

/// A job in a list. `GET /v1/studies/{study}/jobs`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobView {
    /// Id.
    pub id: JobId,
    /// Kind.
    pub kind: JobKind,
    /// What it is for.
    pub role: JobRole,
    /// Index of the sample or of the optimisation.
    pub ordinal: u32,
    /// State.
    pub state: JobState,
    /// Attempts so far.
    pub attempt: u32,
    /// Worker which has it.
    pub worker: Option<WorkerId>,
    /// The name of this worker.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worker_name: Option<String>,
    /// The name of the token that registered this worker.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub token: Option<String>,
    /// Who computed its result.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub computed_by: Option<ComputedBy>,
    /// The last failure, or why it is infeasible.
    pub reason: Option<String>,
    /// Whether its result is that of an equal earlier simulation.
    pub cached: bool,
    /// How it was computed.
    pub provenance: Option<Provenance>,
}

/// What a job is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum JobRole {
    /// A sample of the design box.
    Sample,
    /// The training.
    Train,
    /// An optimisation.
    Optimise,
    /// An optimum flown again.
    Verify,
    /// One round of a search.
    Search,
    /// A stroke which a search asked for.
    Probe,
    /// One generation of a genetic algorithm whose fitness is flown.
    Generation,
    /// A stroke which a generation asked for.
    Individual,
    /// A sample flown again by another worker, to be compared.
    Audit,
}

/// One page of a list.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Page<T> {
    /// The items.
    pub items: Vec<T>,
    /// Where the next page begins; absent on the last.
    pub next_cursor: Option<String>,
}

/// One row of the dataset. `GET /v1/studies/{study}/dataset`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DatasetRow {
    /// Index of the sample.
    pub sample: u32,
    /// The stroke.
    pub parameters: ParameterValues,
    /// What the simulation says.
    #[serde(flatten)]
    pub result: SimulateResult,
    /// Who computed it, with `provenance=true`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub computed_by: Option<ComputedBy>,
    /// How it was computed, with `provenance=true`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub provenance: Option<Provenance>,
}

/// Whether a study would be accepted and what it would cost. `POST /v1/studies?dry_run=true`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DryRun {
    /// Simulations it would queue: samples, each optimum once more, and at most what the
    /// generations of its `direct` optimisations ask for; not what refining will.
    pub simulations: u64,
    /// Faults; empty when it would be accepted.
    pub errors: Vec<FieldProblem>,
}
