//! The optimum of a network, found.

use std::ops::ControlFlow;

use manduca_numerics::kinematics::Clearance;
use manduca_numerics::optimise::sqp::{self, Flight, SqpProgress, SqpSettings};
use manduca_numerics::optimise::{self, Generation, OptimiseError, Optimum, Phase, Problem};
use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::network;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::resolve::{self, ResolvedOptimisation};
use manduca_protocol::study::Method;
use manduca_protocol::task::{
    GenerationMessage, LocalOptimum, Optimality, OptimiseResult, OptimiseTask, Prices, Progress,
};

use super::search::stopped;
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
        margin_m: spec.margin_m(),
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
                    let mut nearest = breed(&problem, &clearance, &how, report)?;
                    nearest.stopped = format!("{why}; the least of the penalised fitness instead");
                    Ok(nearest)
                }
                Err(Search::Failed(error)) => Err(error),
                Ok(found) => Ok(found),
            }
        }
        Method::Paper => breed(&problem, &clearance, &how, report),
        Method::Direct => {
            let why = "`direct` flies its generations: it is a search, no optimisation of a network";
            Err(ComputeError::Refused(vec![FieldProblem::new("/optimisation/method", why)]))
        }
    }
}

/// Genetic algorithm, then simplex.
fn breed(
    problem: &Problem<'_>,
    clearance: &Clearance,
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
    let mut optimum = optimise::optimise(problem, &how.ga, &how.simplex, &mut hear)
        .map_err(|e| ComputeError::Failed(e.to_string()))?;
    // The penalty of a lacking clearance holds it to within the simplex's tolerance only.
    let clear = sqp::cleared(clearance, &problem.bounds, &optimum.point, problem.margin_m);
    if clear != optimum.point
        && let Some(score) = problem.score(&[clear]).pop()
    {
        (optimum.point, optimum.score) = (clear, score);
    }
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
        stopped: stopped(optimum.ga_stop).into(),
        evaluations: optimum.evaluations as u64,
        optimality: None,
        solver_version: SOLVER_VERSION.into(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use manduca_protocol::task::{FrameMessage, NetworkMessage, SimulateOutcome, SimulateTask, SurrogateMessage};

    /// Four neurons, each of one parameter and one output: P+ = tanh f, L+ = lift + tanh beta,
    /// D+ = tanh phi0, M+ = tanh theta0, parameters scaled to [-1, 1].
    fn task(lift: f64) -> OptimiseTask {
        let mut hidden_weights = vec![0.0; 40];
        let mut output_weights = vec![0.0; 16];
        for (neuron, output) in [3, 0, 1, 2].into_iter().enumerate() {
            hidden_weights[10 * neuron + neuron] = 1.0;
            output_weights[4 * output + neuron] = 1.0;
        }
        let default = manduca_numerics::parameters::Bounds::default();
        let bounds = manduca_protocol::task::BoundsMessage { lower: default.lower, upper: default.upper };
        let optimisation = serde_json::json!({
            "name": "a", "starts": 20, "population": 50, "generations": 5, "clearance_margin_mm": -1000.0
        });
        OptimiseTask {
            model: manduca_protocol::study::ModelSpec::default(),
            bounds: bounds.clone(),
            optimisation: serde_json::from_value(optimisation).unwrap(),
            seed: 3,
            surrogate: SurrogateMessage {
                frame: FrameMessage::Paper,
                networks: vec![NetworkMessage {
                    bounds,
                    hidden_weights,
                    hidden_biases: vec![0.0; 4],
                    output_weights,
                    output_biases: [lift, 0.0, 0.0, 0.0],
                }],
                process: None,
            },
        }
    }

    #[test]
    fn descents_answer_with_their_prices() {
        let mut told = Vec::new();
        let found = optimise(&task(1.0), &mut |progress| told.push(progress.done)).unwrap();
        let known = found.optimality.unwrap();
        assert!((found.predicted.lift - 1.0).abs() < 1e-9 && found.parameters.0[0] == 15.0);
        // At the bound z = -1, and a width of the box is 2: the price is 2 (1 - tanh^2 1).
        let tanh = manduca_numerics::math::tanh(1.0);
        assert!((known.multipliers.bounds.0[0] - 2.0 * (1.0 - tanh * tanh)).abs() < 1e-9);
        assert!(known.multipliers.lift.abs() < 1e-9 && known.kkt_residual <= 1e-10);
        assert!((found.fitness - found.predicted.power).abs() < 1e-8);
        assert_eq!((known.starts, known.converged, told), (20, 20, vec![20]));
    }

    /// Power falls with the sweep, as far as the wings let it: half of such optima lay on the wrong side of their limit.
    #[test]
    fn an_optimum_which_rests_on_the_clearance_can_be_flown() {
        for (method, margin_mm, seeds) in
            [(Method::Sqp, 0.0, 8), (Method::Sqp, 1.25, 4), (Method::Sqp, -3.0, 4), (Method::Paper, 0.0, 4)]
        {
            for seed in 0..seeds {
                let mut task = OptimiseTask { seed, ..task(1.0) };
                let network = &mut task.surrogate.networks[0];
                (network.hidden_weights[0], network.hidden_weights[5]) = (0.0, -1.0);
                task.model.insect_changes.insert("hinge_offset_m".into(), 0.002);
                task.model.kind = manduca_protocol::study::ModelKind::QuasiSteady;
                let held = [("elevation_amplitude_deg", 5.0), ("rotation_mean_deg", 0.0), ("rotation_shape", 1.0)];
                let held = held.into_iter().chain([("rotation_amplitude_deg", 60.0), ("sweep_shape", 0.0)]);
                let held = held.map(|(name, value)| (name.to_owned(), manduca_protocol::study::Range::Held(value)));
                let spec = &mut task.optimisation;
                (spec.method, spec.clearance_margin_mm, spec.parameters) = (method, margin_mm, held.collect());
                (spec.population, spec.generations) = (Some(200), Some(40));
                let found = optimise(&task, &mut |_| {}).unwrap();
                let beyond = found.clearance_mm - margin_mm.max(0.0);
                assert!((0.0..0.05).contains(&beyond), "{method:?} {margin_mm} {seed}: {beyond}");
                let flown = SimulateTask { model: task.model, parameters: found.parameters };
                let outcome = crate::compute::simulate(&flown).unwrap().outcome;
                assert!(matches!(outcome, SimulateOutcome::Ok { .. }), "{method:?} {margin_mm} {seed}: {outcome:?}");
            }
        }
    }

    #[test]
    fn without_a_stroke_in_trim_the_nearest_is_told() {
        let found = optimise(&task(3.0), &mut |_| {}).unwrap();
        assert!(found.stopped.starts_with("none of 20 descents"), "{}", found.stopped);
        assert!(found.optimality.is_none() && found.penalty > 1.0 && found.history.len() == 5);
    }

    #[test]
    fn the_papers_method_breeds() {
        let mut task = task(1.0);
        task.optimisation.method = Method::Paper;
        let found = optimise(&task, &mut |_| {}).unwrap();
        assert!(found.optimality.is_none() && found.history.len() == 5 && found.fitness < 1.0);
    }
}
