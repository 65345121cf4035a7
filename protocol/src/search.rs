//! Searches which ask for simulations: a chain of short jobs, state in, next
//! strokes out, so that no job ever waits for another.

use manduca_numerics::refine::Region;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::flat;
use crate::point::ParameterValues;
use crate::study::{ModelSpec, OptimisationSpec};
use crate::task::{BoundsMessage, OptimiseResult, Scaled, ScaledEstimates, SurrogateMessage};

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
    /// The surrogate whose optimum is refined; none where generations are flown, or what they left is refined.
    #[serde(default)]
    pub surrogate: Option<SurrogateMessage>,
    /// Which search it is, and what the round before left.
    pub state: SearchState,
    /// The strokes the round before asked for, in its order. Before the first round of refining,
    /// the optimum flown again.
    pub flown: Vec<FlownMessage>,
}

/// Which search, and what it carries from round to round.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "search", rename_all = "kebab-case", try_from = "flat::StateFields")]
pub enum SearchState {
    /// A genetic algorithm whose fitness is flown.
    Breed(BreedState),
    /// A trust region around an optimum.
    Refine(RefineState),
}

/// A genetic algorithm between two generations; empty before the first.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BreedState {
    /// Every individual, 0 to 1 within the bounds and beyond, those which survived first.
    pub genes: Vec<[f64; 10]>,
    /// Fitness of each survivor; none where its stroke cannot be flown.
    pub elite: Vec<Option<f64>>,
    /// Best and mean fitness of each generation.
    pub history: Vec<[Option<f64>; 2]>,
    /// The best individual: its parameters, which may lie outside the bounds, and its fitness.
    pub best: Option<([f64; 10], f64)>,
    /// The best stroke flown.
    pub champion: Option<FlownMessage>,
    /// Strokes flown.
    pub simulations: u32,
}

/// A trust region and what was flown for it.
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
    /// Weight of the trim in the merit by which strokes are compared.
    pub weight: f64,
    /// What trim costs, at the last optimum predicted.
    pub prices: Option<TrimPrices>,
    /// Every stroke flown before this round's.
    pub flown: Vec<FlownMessage>,
    /// Strokes flown near the optimum by generations: the model rests on them where there is no surrogate.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub around: Vec<FlownMessage>,
}

impl RefineState {
    /// Before the first round, with what generations have flown.
    pub fn first(around: Vec<FlownMessage>) -> Self {
        let Region { radius, weight, .. } = Region::default();
        Self { round: 0, radius, candidate: None, predicted: None, weight, prices: None, flown: Vec::new(), around }
    }
}

/// By how much P+ rises per unit asked for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TrimPrices {
    /// Of L+.
    pub lift: f64,
    /// Of D+.
    pub drag: f64,
    /// Of M+.
    pub pitch_moment: f64,
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
#[serde(tag = "next", rename_all = "kebab-case", try_from = "flat::NextFields")]
pub enum SearchNext {
    /// These strokes are to be flown, then comes the next round.
    Fly {
        /// To be handed to it.
        state: Box<SearchState>,
        /// The strokes.
        strokes: Vec<ParameterValues>,
    },
    /// Generations have ended with this optimum; it is flown again like any other.
    Found {
        /// The best stroke flown, its means in place of a prediction.
        optimum: Box<OptimiseResult>,
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
    /// Radius of the trust region, in widths of the box; none of generations.
    pub radius: Option<f64>,
    /// The best stroke flown.
    pub best: Option<FlownMessage>,
    /// What was predicted there before it was flown.
    pub predicted: Option<Scaled>,
    /// Simulated power per lift of the best stroke, W/N.
    pub power_per_lift_w_per_n: Option<f64>,
    /// Fitness of the best stroke; of generations only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fitness: Option<f64>,
    /// What trim costs at the last optimum predicted; of refining only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prices: Option<TrimPrices>,
    /// Simulated P+ of the best stroke, corrected to exact trim by these prices.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trimmed_power: Option<f64>,
    /// |1 - L+| + |D+| + |M+| and P+ of the best stroke after each stroke flown; of
    /// generations, best and mean fitness after each.
    pub history: Vec<[f64; 2]>,
}
