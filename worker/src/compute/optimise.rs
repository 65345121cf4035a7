//! The optimum of a network, found.

use std::ops::ControlFlow;

use manduca_numerics::kinematics::Clearance;
use manduca_numerics::optimise::sqp::{self, Flight, SqpProgress, SqpSettings};
use manduca_numerics::optimise::{self, GaStop, Generation, OptimiseError, Optimum, Phase, Problem};
use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::network;
use manduca_protocol::resolve::{self, ResolvedOptimisation};
use manduca_protocol::study::Method;
use manduca_protocol::task::{
    GenerationMessage, LocalOptimum, Optimality, OptimiseResult, OptimiseTask, Prices, Progress,
};

use super::{ComputeError, bounds, finite, scaled};

/// Most optima told of one search.
const MOST_OPTIMA: usize = 50;

/// Optimises on the network of a task.
pub(super) fn optimise(task: &OptimiseTask, report: &mut dyn FnMut(Progress)) -> Result<OptimiseResult, ComputeError> {
    let model = resolve::model(&task.model, "/model").map_err(ComputeError::Refused)?;
    let spec = &task.optimisation;
    let how = resolve::optimisation(spec, &bounds(&task.bounds), task.seed).map_err(ComputeError::Refused)?;
    let surrogate = network::surrogate(&task.surrogate)
        .map_err(|why| ComputeError::Refused(vec![FieldProblem::new("/surrogate", why)]))?;
    let clearance = Clearance::new(&model.insect, model.elevation_phase);
    let problem = Problem {
        predict: &|points, values| surrogate.predict_into(points, values),
        clearance: &|points, values| clearance.of_each(points, values),
        margin_m: spec.clearance_margin_mm * 1e-3,
        bounds: how.bounds,
        penalty_r: spec.penalty_r,
        penalty_s: spec.penalty_s,
    };
    match spec.method {
        Method::Sqp => {
            let flight = Flight {
                surrogate: &surrogate,
                clearance: Some(&clearance),
                margin_m: problem.margin_m,
                bounds: how.bounds,
            };
            match descend(&problem, &flight, &how.sqp, report) {
                // No stroke in trim: what comes nearest is an answer too, and says what it is.
                Err(Search::Nothing(why)) => {
                    let mut nearest = breed(&problem, &how, report)?;
                    nearest.stopped = format!("{why}; the least of the penalised fitness instead");
                    Ok(nearest)
                }
                Err(Search::Failed(error)) => Err(error),
                Ok(found) => Ok(found),
            }
        }
        Method::Paper => breed(&problem, &how, report),
    }
}

/// Genetic algorithm, then simplex.
fn breed(
    problem: &Problem<'_>,
    how: &ResolvedOptimisation,
    report: &mut dyn FnMut(Progress),
) -> Result<OptimiseResult, ComputeError> {
    let total = how.ga.generations as u64;
    let mut hear = |at: &optimise::Progress| {
        let stage = match at.phase {
            Phase::Genetic => format!("generation {}", at.generation),
            Phase::Simplex => "simplex".into(),
        };
        let note = format!("{stage}, best fitness {:.5}", at.best);
        report(Progress { done: at.generation as u64, total, note });
        ControlFlow::Continue(())
    };
    let optimum = optimise::optimise(problem, &how.ga, &how.simplex, &mut hear)
        .map_err(|e| ComputeError::Failed(e.to_string()))?;
    result(&optimum)
}

/// Why descents gave no optimum.
enum Search {
    /// None converged, as this says.
    Nothing(String),
    /// Something is wrong.
    Failed(ComputeError),
}

impl From<ComputeError> for Search {
    fn from(error: ComputeError) -> Self {
        Self::Failed(error)
    }
}

impl From<OptimiseError> for Search {
    fn from(error: OptimiseError) -> Self {
        match error {
            OptimiseError::NothingConverged { .. } => Self::Nothing(error.to_string()),
            _ => Self::Failed(ComputeError::Failed(error.to_string())),
        }
    }
}

/// Sequential quadratic programming from many starts.
fn descend(
    problem: &Problem<'_>,
    flight: &Flight<'_>,
    how: &SqpSettings,
    report: &mut dyn FnMut(Progress),
) -> Result<OptimiseResult, Search> {
    let mut hear = |at: &SqpProgress| {
        let note = format!("{} descents ended, least power {:.5}", at.ended, at.best);
        report(Progress { done: at.ended as u64, total: at.starts as u64, note });
        ControlFlow::Continue(())
    };
    let found = sqp::minimise(flight, how, &mut hear)?;
    let best = found.best();
    let [lift, drag, pitch_moment] = best.multipliers;
    finite(best.point.iter().chain(&best.outputs).chain(&best.multipliers).chain(&best.bound_multipliers).copied())?;
    finite([best.clearance_m, best.clearance_multiplier_per_mm, best.residual, best.violation])?;
    // The fitness of the paper's formula at the same point, so that both methods compare.
    let Some(score) = problem.score(&[best.point]).pop() else {
        return Err(ComputeError::Failed("the optimum has no fitness".into()).into());
    };
    finite([score.fitness, score.penalty])?;
    let local = |o: &sqp::LocalOptimum| LocalOptimum {
        parameters: ParameterValues(o.point),
        predicted: scaled(o.outputs),
        clearance_mm: o.clearance_m * 1e3,
        hits: count(o.hits),
    };
    Ok(OptimiseResult {
        parameters: ParameterValues(best.point),
        predicted: scaled(best.outputs),
        fitness: score.fitness,
        penalty: score.penalty,
        clearance_mm: best.clearance_m * 1e3,
        history: Vec::new(),
        stopped: "every descent has ended".into(),
        evaluations: found.evaluations as u64,
        optimality: Some(Optimality {
            multipliers: Prices {
                lift,
                drag,
                pitch_moment,
                clearance_per_mm: best.clearance_multiplier_per_mm,
                bounds: ParameterValues(best.bound_multipliers),
            },
            kkt_residual: best.residual,
            violation: best.violation,
            starts: count(found.starts),
            converged: count(found.converged),
            optima: found.optima.iter().take(MOST_OPTIMA).map(local).collect(),
        }),
        solver_version: SOLVER_VERSION.into(),
    })
}

fn count(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

fn result(optimum: &Optimum) -> Result<OptimiseResult, ComputeError> {
    let score = &optimum.score;
    finite(optimum.point.iter().chain(&score.outputs).copied())?;
    finite([score.fitness, score.penalty, score.clearance_m])?;
    finite(optimum.history.iter().flat_map(|g| [g.best, g.mean]))?;
    let generation =
        |(i, g): (usize, &Generation)| GenerationMessage { generation: count(i), best: g.best, mean: g.mean };
    Ok(OptimiseResult {
        parameters: ParameterValues(optimum.point),
        predicted: scaled(score.outputs),
        fitness: score.fitness,
        penalty: score.penalty,
        clearance_mm: score.clearance_m * 1e3,
        history: optimum.history.iter().enumerate().map(generation).collect(),
        stopped: match optimum.ga_stop {
            GaStop::Stalled => "the best fitness no longer changed".into(),
            GaStop::Generations => "all generations were made".into(),
            GaStop::Interrupted => "interrupted".into(),
        },
        evaluations: optimum.evaluations as u64,
        optimality: None,
        solver_version: SOLVER_VERSION.into(),
    })
}
