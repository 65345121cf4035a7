//! A training: what it is given, where it stands, what it returns.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::flat;
use crate::study::{ModelSpec, SurrogateSpec};
use crate::task::{BoundsMessage, Scaled};

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
    /// Where an earlier attempt stood at the fit of a gaussian process.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fit: Option<Box<FitCheckpoint>>,
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
#[serde(tag = "features", rename_all = "kebab-case", try_from = "flat::FrameFields")]
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
        /// Whether the networks are given -ln(1 - K² + 1/200) for K and ln(1 + C²) for C; earlier ones are not.
        #[serde(default)]
        sharpness: bool,
    },
}

/// One output of a gaussian process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ProcessOutputMessage {
    /// Lengths of correlation, of a box from -1 to 1.
    pub lengths: [f64; 10],
    /// Standard deviation about the mean.
    pub amplitude: f64,
    /// Standard deviation of what samples have beside it and their standard errors.
    pub noise: f64,
    /// Mean.
    pub mean: f64,
    /// One weight per point.
    pub weights: Vec<f64>,
}

/// A gaussian process of squared-exponential covariance, one length per parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ProcessMessage {
    /// Bounds of the inputs.
    pub bounds: BoundsMessage,
    /// The samples' ten values as the frame gives them, in table order.
    pub points: Vec<[f64; 10]>,
    /// The four outputs of the frame.
    pub outputs: [ProcessOutputMessage; 4],
}

/// A trained surrogate in its frame: the mean of networks, or a gaussian process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SurrogateMessage {
    /// What was learnt.
    pub frame: FrameMessage,
    /// One or more networks of the same bounds; none where a gaussian process predicts.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub networks: Vec<NetworkMessage>,
    /// The gaussian process, in place of networks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub process: Option<Box<ProcessMessage>>,
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

/// The fit of a gaussian process after some of its ascents: another worker goes on from it to the same bits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FitCheckpoint {
    /// The ascents which have ended.
    pub ascents: Vec<AscentMessage>,
}

/// An ascent to the likeliest lengths, amplitude and noise of an output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AscentMessage {
    /// Which of the fit's, from 0.
    pub ascent: u32,
    /// Logarithms of lengths, amplitude and noise at its end.
    pub at: Vec<f64>,
    /// Iterations made.
    pub iterations: u32,
    /// Why it ended.
    pub stopped: String,
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
    /// Training curves, one network after the other; empty of a gaussian process.
    pub curve: Vec<EpochMessage>,
    /// Iteration each network is from; of a gaussian process, iterations of each output's likelihood.
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
