//! What a worker is given and what it returns, per kind of job.

use manduca_numerics::simulation;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::flat;
use crate::point::ParameterValues;
use crate::search::{SearchResult, SearchTask};
use crate::study::ModelSpec;

pub use crate::optimum::{GenerationMessage, LocalOptimum, Optimality, OptimiseResult, OptimiseTask, Prices};
pub use crate::training::{
    AscentMessage, EpochMessage, ErrorsMessage, FitCheckpoint, FrameMessage, MemberMessage, NetworkMessage,
    ProcessMessage, ProcessOutputMessage, SurrogateMessage, TrainCheckpoint, TrainResult, TrainSample, TrainTask,
};

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

impl JobKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Simulate, Self::Train, Self::Optimise, Self::Search];
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

/// Bounds in table order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BoundsMessage {
    /// Lower ends.
    pub lower: [f64; 10],
    /// Upper ends.
    pub upper: [f64; 10],
}

/// Where a long job can be taken up again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", try_from = "flat::CheckpointFields")]
pub enum Checkpoint {
    /// Of a training of networks.
    Train(Box<TrainCheckpoint>),
    /// Of the fit of a gaussian process.
    Fit(FitCheckpoint),
}

/// What a job returns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", try_from = "flat::ResultFields")]
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

impl ScaledEstimates {
    /// L+, D+, M+, P+ without their errors.
    pub fn means(&self) -> [f64; 4] {
        [self.lift, self.drag, self.pitch_moment, self.power].map(|estimate| estimate.mean)
    }
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
#[serde(try_from = "flat::SimulateFields")]
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
