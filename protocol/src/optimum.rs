//! An optimisation: what it is given and what it returns.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::point::ParameterValues;
use crate::study::{ModelSpec, OptimisationSpec};
use crate::task::{BoundsMessage, Scaled, SurrogateMessage};

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
    /// What the network predicts there; of `direct`, what was simulated while searching.
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
    /// Evaluations of the network; of `direct`, strokes asked for.
    pub evaluations: u64,
    /// What `sqp` knows beside; absent otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub optimality: Option<Optimality>,
    /// Version of the numbers.
    pub solver_version: String,
}
