//! What a worker is given and what it returns, per kind of job.

use manduca_numerics::simulation;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::point::ParameterValues;
use crate::search::{SearchResult, SearchTask};
use crate::study::{ModelSpec, OptimisationSpec, SurrogateSpec};

/// Kind of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum JobKind {
    /// Fly one stroke.
    Simulate,
    /// Train the network.
    Train,
    /// Optimise on the network.
    Optimise,
    /// One round of a search which asks for simulations.
    Search,
}

/// What to compute. The bulk (`dataset`, `network`) is filled in by the
/// coordinator when a worker asks for a job's task.
#[allow(clippy::large_enum_variant, reason = "a task is built once per job and never stored in bulk")]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Task {
    /// Fly one stroke.
    Simulate(SimulateTask),
    /// Train the network.
    Train(TrainTask),
    /// Optimise on the network.
    Optimise(OptimiseTask),
    /// One round of a search.
    Search(SearchTask),
}

/// One simulation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SimulateTask {
    /// Model with its settings.
    pub model: ModelSpec,
    /// The stroke.
    pub parameters: ParameterValues,
}

impl SimulateTask {
    /// Name of this simulation's content: equal tasks flown by equal solver
    /// versions have equal keys and equal results.
    pub fn key(&self) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new();
        hasher.update(b"manduca simulate ");
        hasher.update(simulation::SOLVER_VERSION.as_bytes());
        // A task is maps with ordered keys and numbers: its serialisation is canonical and cannot fail.
        hasher.update(&serde_json::to_vec(self).unwrap_or_default());
        *hasher.finalize().as_bytes()
    }
}

/// A sample as the trainer sees it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TrainSample {
    /// Ten values in table order.
    pub x: [f64; 10],
    /// L+, D+, M+, P+.
    pub y: [f64; 4],
    /// Their standard errors; 0 where unknown.
    #[serde(default)]
    pub se: [f64; 4],
}

/// Bounds in table order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BoundsMessage {
    /// Lower ends.
    pub lower: [f64; 10],
    /// Upper ends.
    pub upper: [f64; 10],
}

/// One training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TrainTask {
    /// Network and stopping rule.
    pub surrogate: SurrogateSpec,
    /// Seed.
    pub seed: u64,
    /// Bounds of the inputs.
    pub bounds: BoundsMessage,
    /// Samples ordered by index.
    pub dataset: Vec<TrainSample>,
    /// Preset of the insect and changes to it: whose strokes they are.
    #[serde(default)]
    pub model: ModelSpec,
    /// Where an earlier attempt stood.
    #[serde(default)]
    pub checkpoint: Option<Box<TrainCheckpoint>>,
}

/// A trained network: inputs to [0, 1] by their bounds, one sigmoid layer, linear outputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct NetworkMessage {
    /// Bounds of the inputs.
    pub bounds: BoundsMessage,
    /// Neurons x 10, row by row.
    pub hidden_weights: Vec<f64>,
    /// One per neuron.
    pub hidden_biases: Vec<f64>,
    /// 4 x neurons, row by row.
    pub output_weights: Vec<f64>,
    /// L+, D+, M+, P+.
    pub output_biases: [f64; 4],
}

/// How the networks' inputs and outputs stand to strokes and their means.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "features", rename_all = "kebab-case")]
pub enum FrameMessage {
    /// The ten parameters to L+, D+, M+, P+.
    Paper,
    /// Stroke-plane axes at a reference frequency: N, T, M about the hinge line, P.
    Physical {
        /// The reference frequency, Hz.
        reference_hz: f64,
        /// Centre of mass from the hinge line along the stroke plane and normal to it, over c.
        arm: [f64; 2],
        /// Whether predictions obey the fore-aft mirror law.
        mirror: bool,
    },
}

/// A trained surrogate: the mean of its networks in their frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SurrogateMessage {
    /// What the networks learnt.
    pub frame: FrameMessage,
    /// One or more networks of the same bounds.
    pub networks: Vec<NetworkMessage>,
}

/// One network of an ensemble, trained.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MemberMessage {
    /// The network of the best validation error.
    pub network: NetworkMessage,
    /// Its iterations.
    pub curve: Vec<EpochMessage>,
    /// Iteration the network is from.
    pub best_iteration: u32,
    /// Why it stopped.
    pub stopped: String,
}

/// A training after some iteration: another worker goes on from it to the same bits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TrainCheckpoint {
    /// Networks which are done.
    pub members: Vec<MemberMessage>,
    /// Where the present one stands.
    pub network: NetworkMessage,
    /// What is made small, there.
    pub objective: f64,
    /// Damping of the next step.
    pub damping: f64,
    /// What a refused step multiplies it by.
    pub growth: f64,
    /// The present network's iterations so far.
    pub curve: Vec<EpochMessage>,
    /// The present network's best state.
    pub best: NetworkMessage,
}

/// Where a long job can be taken up again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Checkpoint {
    /// Of a training.
    Train(Box<TrainCheckpoint>),
}

/// One optimisation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OptimiseTask {
    /// Model (for the clearance of the wings).
    pub model: ModelSpec,
    /// Bounds: those of the study narrowed by the optimisation.
    pub bounds: BoundsMessage,
    /// What to optimise and how.
    pub optimisation: OptimisationSpec,
    /// Seed.
    pub seed: u64,
    /// What to optimise on.
    pub surrogate: SurrogateMessage,
}

/// What a job returns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum JobResult {
    /// Of a simulation.
    Simulate(Box<SimulateResult>),
    /// Of a training.
    Train(Box<TrainResult>),
    /// Of an optimisation.
    Optimise(Box<OptimiseResult>),
    /// Of a round of a search.
    Search(Box<SearchResult>),
}

/// Mean and standard error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Estimate {
    /// Mean over the strokes kept.
    pub mean: f64,
    /// Standard error of the mean.
    pub se: f64,
}

/// Four means in SI units.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MeansMessage {
    /// Lift, N.
    pub lift_n: Estimate,
    /// Drag, positive rearward, N.
    pub drag_n: Estimate,
    /// Pitching moment about the centre of mass, nose up, N m.
    pub pitch_moment_nm: Estimate,
    /// Power, W.
    pub power_w: Estimate,
}

/// Four scaled values with standard errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ScaledEstimates {
    /// L+ = L/W.
    pub lift: Estimate,
    /// D+ = D/W.
    pub drag: Estimate,
    /// M+ = M/(W c).
    pub pitch_moment: Estimate,
    /// P+ = P/P0.
    pub power: Estimate,
}

/// Four scaled values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Scaled {
    /// L+.
    pub lift: f64,
    /// D+.
    pub drag: f64,
    /// M+.
    pub pitch_moment: f64,
    /// P+.
    pub power: f64,
}

/// Power of one joint, both wings, means over the strokes kept.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JointPower {
    /// Against the air, W.
    pub aerodynamic_w: f64,
    /// Against the wing's inertia, W.
    pub inertial_w: f64,
    /// Positive part of the sum, W.
    pub required_w: f64,
}

/// Power per joint.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JointPowers {
    /// Sweep.
    pub sweep: JointPower,
    /// Elevation.
    pub elevation: JointPower,
    /// Rotation.
    pub rotation: JointPower,
}

/// What a simulation says. An infeasible stroke is an answer, not a failure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "outcome", rename_all = "kebab-case")]
pub enum SimulateOutcome {
    /// Flown.
    Ok {
        /// In SI units.
        means: MeansMessage,
        /// As the paper scales them.
        scaled: ScaledEstimates,
        /// Power per joint.
        joints: JointPowers,
        /// W/N; absent where nothing is lifted.
        power_per_lift_w_per_n: Option<f64>,
        /// Strokes in the means.
        strokes_averaged: u32,
    },
    /// Not flown to the end.
    Infeasible {
        /// Why.
        reason: String,
    },
}

/// A simulation's result. Where and how long it took travels beside it, in
/// [`Provenance`], so that equal simulations have equal results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SimulateResult {
    /// What it says.
    #[serde(flatten)]
    pub outcome: SimulateOutcome,
    /// Version of the numbers.
    pub solver_version: String,
}

/// Who computed a result and how.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Provenance {
    /// Wall time of the computation, s.
    pub wall_s: f64,
    /// Instruction level, such as `avx512`; levels with fused multiply-add give equal bits.
    pub level: String,
}

/// One iteration of the training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EpochMessage {
    /// Which network of the ensemble, from 0.
    #[serde(default)]
    pub network: u32,
    /// Iteration.
    pub iteration: u32,
    /// Mean squared errors over what the network learns: the four scaled outputs, with
    /// physical features at the reference frequency.
    pub train_mse: f64,
    /// On the validation share.
    pub validation_mse: f64,
    /// On the test share.
    pub test_mse: f64,
    /// Damping which the next step tries first.
    #[serde(default)]
    pub damping: f64,
}

/// Errors on one share of the samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ErrorsMessage {
    /// Root mean square errors.
    pub rmse: Scaled,
    /// Correlation of prediction and simulation.
    pub correlation: Scaled,
    /// Samples in this share.
    pub count: u32,
}

/// A training's result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TrainResult {
    /// What predicts.
    pub surrogate: SurrogateMessage,
    /// Training curves, one network after the other.
    pub curve: Vec<EpochMessage>,
    /// Iteration each network is from.
    pub best_iterations: Vec<u32>,
    /// Why each stopped.
    pub stops: Vec<String>,
    /// Errors on the training share.
    pub train: ErrorsMessage,
    /// Errors on the validation share.
    pub validation: ErrorsMessage,
    /// Errors on the test share.
    pub test: ErrorsMessage,
    /// Version of the numbers.
    pub solver_version: String,
}

/// One generation of the genetic algorithm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct GenerationMessage {
    /// Generation.
    pub generation: u32,
    /// Best fitness.
    pub best: f64,
    /// Mean fitness.
    pub mean: f64,
}

/// What constraints cost at an optimum: by how much P+ rises per unit of what is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Prices {
    /// Per unit of L+.
    pub lift: f64,
    /// Per unit of D+.
    pub drag: f64,
    /// Per unit of M+.
    pub pitch_moment: f64,
    /// Per mm of clearance margin.
    pub clearance_per_mm: f64,
    /// Per width of the box by which the bound a parameter lies at is raised; 0 away from bounds.
    pub bounds: ParameterValues,
}

/// A point where no small change within the constraints saves power.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LocalOptimum {
    /// The stroke.
    pub parameters: ParameterValues,
    /// What the network predicts there.
    pub predicted: Scaled,
    /// Least distance of the wings from the plane of symmetry, mm.
    pub clearance_mm: f64,
    /// Descents which ended here.
    pub hits: u32,
}

/// What sequential quadratic programming knows of its optimum.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Optimality {
    /// What the constraints cost.
    pub multipliers: Prices,
    /// Residual of the conditions of Karush, Kuhn and Tucker, per width of the box.
    pub kkt_residual: f64,
    /// Largest violation of trim, or of clearance in cm.
    pub violation: f64,
    /// Descents begun.
    pub starts: u32,
    /// Descents which converged.
    pub converged: u32,
    /// Distinct optima, the least power first, at most 50.
    pub optima: Vec<LocalOptimum>,
}

/// An optimisation's result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OptimiseResult {
    /// The optimum.
    pub parameters: ParameterValues,
    /// What the network predicts there.
    pub predicted: Scaled,
    /// Fitness F (paper Eq. 8).
    pub fitness: f64,
    /// Its penalty part.
    pub penalty: f64,
    /// Least distance of the wings from the plane of symmetry, mm.
    pub clearance_mm: f64,
    /// Generations; none of `sqp`.
    pub history: Vec<GenerationMessage>,
    /// Why the search stopped.
    pub stopped: String,
    /// Evaluations of the network.
    pub evaluations: u64,
    /// What `sqp` knows beside; absent for `paper`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub optimality: Option<Optimality>,
    /// Version of the numbers.
    pub solver_version: String,
}

/// Where a running job is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Progress {
    /// Steps done.
    pub done: u64,
    /// Steps at most.
    pub total: u64,
    /// In words, such as `iteration 34, validation 2.1e-3`.
    pub note: String,
}
