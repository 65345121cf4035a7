//! The optimum of a network, found.

use std::ops::ControlFlow;

use manduca_numerics::kinematics::Clearance;
use manduca_numerics::optimise::{self, GaStop, Generation, Optimum, Phase, Problem};
use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::task::{GenerationMessage, OptimiseResult, OptimiseTask, Progress};
use manduca_protocol::{network, resolve};

use super::{ComputeError, bounds, finite, scaled};

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
        clearance: &|x| clearance.of(x),
        margin_m: spec.clearance_margin_mm * 1e-3,
        bounds: how.bounds,
        penalty_r: spec.penalty_r,
        penalty_s: spec.penalty_s,
    };
    let total = u64::from(spec.generations);
    let mut hear = |at: &optimise::Progress| {
        let stage = match at.phase {
            Phase::Genetic => format!("generation {}", at.generation),
            Phase::Simplex => "simplex".into(),
        };
        let note = format!("{stage}, best fitness {:.5}", at.best);
        report(Progress { done: at.generation as u64, total, note });
        ControlFlow::Continue(())
    };
    let optimum = optimise::optimise(&problem, &how.ga, &how.simplex, &mut hear)
        .map_err(|e| ComputeError::Failed(e.to_string()))?;
    result(&optimum)
}

fn result(optimum: &Optimum) -> Result<OptimiseResult, ComputeError> {
    let score = &optimum.score;
    finite(optimum.point.iter().chain(&score.outputs).copied())?;
    finite([score.fitness, score.penalty, score.clearance_m])?;
    finite(optimum.history.iter().flat_map(|g| [g.best, g.mean]))?;
    let generation = |(i, g): (usize, &Generation)| GenerationMessage {
        generation: u32::try_from(i).unwrap_or(u32::MAX),
        best: g.best,
        mean: g.mean,
    };
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
        solver_version: SOLVER_VERSION.into(),
    })
}
