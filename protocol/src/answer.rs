//! Answers of a study: predictions, optima.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::ids::StudyId;
use crate::optimum::{Optimality, OptimiseResult};
use crate::point::ParameterValues;
use crate::search::Standing;
use crate::task::{Scaled, ScaledEstimates, SimulateOutcome, SimulateResult};
use crate::trust::is_none;
use crate::view::{StageSeconds, StudyState};

/// Ask the network. `POST /v1/studies/{study}/surrogate/predictions`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PredictionRequest {
    /// Points, at most 1000.
    pub points: Vec<ParameterValues>,
}

/// The network's answers in the order asked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PredictionResponse {
    /// Scaled values.
    pub predictions: Vec<Scaled>,
    /// Who predicts: the surrogate as it was trained, which knows nothing of the strokes that refining flew since.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by: Option<String>,
    /// Root mean square errors of these predictions on strokes of the box which the surrogate has not seen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub test_rmse: Option<Scaled>,
    /// Points outside the box of the study: nothing was learnt there.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outside: Vec<OutsideBox>,
}

impl PredictionResponse {
    /// Who predicts.
    pub const BY: &str = "the surrogate as it was trained, without what refining flew near optima";
}

/// A point outside the box of the study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OutsideBox {
    /// Which of the points asked for, from 0.
    pub point: u32,
    /// The parameters which are beyond their bounds.
    pub parameters: Vec<String>,
}

/// One optimisation with its re-simulation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OptimumView {
    /// Name of the optimisation.
    pub name: String,
    /// `pending`, `optimised`, `verified` or `failed`.
    pub status: OptimumStatus,
    /// What the optimiser found.
    pub optimum: Option<OptimiseResult>,
    /// The UVLM flown there again.
    pub simulated: Option<SimulateResult>,
    /// Simulated minus predicted.
    pub gap: Option<Scaled>,
    /// How the generations of a `direct` optimisation stand, once the first is flown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub breeding: Option<SearchView>,
    /// How the search around it stands, once it has begun.
    pub search: Option<SearchView>,
    /// Least distance of the refined optimum's wings from the plane of symmetry, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refined_clearance_mm: Option<f64>,
    /// The published stroke which answers the same question: insect, model and bounds are the paper's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub paper: Option<String>,
    /// What to know before the optimum is believed: that it is not in trim, or keeps less than the margin asked for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

impl OptimumView {
    /// L+, D+, M+ and P+ of the optimum flown again, where it could be flown.
    pub fn simulated_scaled(&self) -> Option<ScaledEstimates> {
        match self.simulated.as_ref().map(|s| &s.outcome) {
            Some(SimulateOutcome::Ok { scaled, .. }) => Some(*scaled),
            _ => None,
        }
    }
}

/// A search which asks for simulations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SearchView {
    /// How it stands after its last round.
    pub standing: Standing,
    /// Why it ended; none while it goes on.
    pub ended: Option<String>,
    /// Whether it ended because prediction and simulation agree.
    pub converged: bool,
}

/// How far an optimisation is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OptimumStatus {
    /// Not yet optimised.
    Pending,
    /// Optimised, not yet simulated again.
    Optimised,
    /// Simulated again.
    Verified,
    /// Refined until the search ended.
    Refined,
    /// A job of it died.
    Failed,
}

/// The answer of a study. `GET /v1/studies/{study}/optimum`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StudyResult {
    /// The study.
    pub study: StudyId,
    /// Its state.
    pub state: StudyState,
    /// Samples.
    pub samples: SampleCounts,
    /// Test errors of the network.
    pub surrogate: Option<SurrogateErrors>,
    /// Optima.
    pub optimisations: Vec<OptimumResult>,
    /// Wall time per stage.
    pub stages_s: StageSeconds,
    /// Version of the numbers.
    pub solver_version: String,
    /// Results that all of this rests on although they are not believed any more.
    #[serde(default, skip_serializing_if = "is_none")]
    pub disowned_results: u64,
}

/// How the samples ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[allow(missing_docs)]
pub struct SampleCounts {
    pub succeeded: u64,
    pub infeasible: u64,
    pub dead: u64,
}

/// Test errors of the network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SurrogateErrors {
    /// Root mean square errors of the scaled outputs on the test share.
    pub rmse: Scaled,
}

/// One optimum, flat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OptimumResult {
    /// Name of the optimisation.
    pub name: String,
    /// How far it is.
    pub status: OptimumStatus,
    /// The optimum.
    pub parameters: Option<ParameterValues>,
    /// By the network.
    pub predicted: Option<Scaled>,
    /// By the solver.
    pub simulated: Option<ScaledEstimates>,
    /// Why the solver has no means there.
    pub infeasible: Option<String>,
    /// Simulated power per lift.
    pub power_per_lift_w_per_n: Option<f64>,
    /// Why the search of `parameters` ended; of `sqp` also that no stroke in trim was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stopped: Option<String>,
    /// Least distance of the wings from the plane of symmetry, mm, by `parameters`.
    pub clearance_mm: Option<f64>,
    /// The same by the refined optimum.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refined_clearance_mm: Option<f64>,
    /// The clearance asked for, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clearance_margin_mm: Option<f64>,
    /// The published stroke which answers the same question: insect, model and bounds are the paper's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub paper: Option<String>,
    /// What to know before the optimum is believed: that it is not in trim, or keeps less than the margin asked for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// What the constraints cost, and how exact the optimum is; absent for `paper`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub optimality: Option<Optimality>,
    /// The generations which found it, of `direct`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub breeding: Option<SearchView>,
    /// The refined optimum, once the search around the first has begun.
    pub refined: Option<SearchView>,
}
