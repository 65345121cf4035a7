//! Searches which ask for simulations: a chain of short jobs, state in, next
//! strokes out, so that no job ever waits for another.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::point::ParameterValues;
use crate::study::{ModelSpec, OptimisationSpec};
use crate::task::{BoundsMessage, Scaled, ScaledEstimates, SurrogateMessage};

/// A stroke which a search wanted flown; no means where it cannot be flown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FlownMessage {
    /// The stroke.
    pub parameters: ParameterValues,
    /// L+, D+, M+ and P+ with standard errors.
    pub scaled: Option<ScaledEstimates>,
}

/// One round of a search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SearchTask {
    /// Model (for the clearance of the wings).
    pub model: ModelSpec,
    /// Bounds: those of the study narrowed by the optimisation.
    pub bounds: BoundsMessage,
    /// What is sought.
    pub optimisation: OptimisationSpec,
    /// Seed.
    pub seed: u64,
    /// The surrogate whose optimum is refined.
    pub surrogate: SurrogateMessage,
    /// What the round before left; none in the first.
    pub state: Option<RefineState>,
    /// The strokes the round before asked for, in its order. First of all the
    /// surrogate's optimum, flown again.
    pub flown: Vec<FlownMessage>,
}

/// What a search carries from round to round: its trust region and what was flown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RefineState {
    /// Rounds done.
    pub round: u32,
    /// Radius, in widths of the box.
    pub radius: f64,
    /// Which stroke of `flown` the candidate will be.
    pub candidate: Option<u32>,
    /// L+, D+, M+, P+ predicted of it.
    pub predicted: Option<[f64; 4]>,
    /// Every stroke flown before this round's.
    pub flown: Vec<FlownMessage>,
}

/// What a round of a search returns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SearchResult {
    /// What follows.
    pub next: SearchNext,
    /// How it stands.
    pub standing: Standing,
    /// Version of the numbers.
    pub solver_version: String,
}

/// What follows a round of a search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "next", rename_all = "kebab-case")]
pub enum SearchNext {
    /// These strokes are to be flown, then comes the next round.
    Fly {
        /// To be handed to it.
        state: RefineState,
        /// The strokes.
        strokes: Vec<ParameterValues>,
    },
    /// Nothing: the search has ended.
    Done {
        /// Why.
        reason: String,
        /// Whether it ended because prediction and simulation agree, or the fitness stands still.
        converged: bool,
    },
}

/// How a search stands after a round.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Standing {
    /// Rounds or generations done.
    pub rounds: u32,
    /// Strokes flown.
    pub simulations: u32,
    /// Radius of the trust region, in widths of the box.
    pub radius: Option<f64>,
    /// The best stroke flown.
    pub best: Option<FlownMessage>,
    /// What was predicted there before it was flown.
    pub predicted: Option<Scaled>,
    /// Simulated power per lift of the best stroke, W/N.
    pub power_per_lift_w_per_n: Option<f64>,
    /// |1 - L+| + |D+| + |M+| and P+ of the best stroke after each stroke flown.
    pub history: Vec<[f64; 2]>,
}
