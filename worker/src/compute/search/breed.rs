//! A generation of a genetic algorithm whose fitness is flown.

use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::Clearance;
use manduca_numerics::optimise::direct::{self, Bearing, Bred, Champion, Direct};
use manduca_numerics::optimise::{Fitness, GaSnapshot, GaStop, Generation};
use manduca_numerics::parameters::Point;
use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::resolve::{self, ResolvedModel};
use manduca_protocol::search::{BreedState, FlownMessage, SearchNext, SearchResult, SearchState, SearchTask, Standing};
use manduca_protocol::task::{GenerationMessage, OptimiseResult};

use super::{means, power_per_lift};
use crate::compute::{ComputeError, bounds, finite, scaled};

/// Judges the generation flown and asks for the next.
pub(super) fn breed(
    task: &SearchTask,
    model: &ResolvedModel,
    state: &BreedState,
) -> Result<SearchResult, ComputeError> {
    let spec = &task.optimisation;
    let how = resolve::optimisation(spec, &bounds(&task.bounds), task.seed).map_err(ComputeError::Refused)?;
    let clearance = Clearance::new(&model.insect, model.elevation_phase);
    let search = Direct {
        fitness: Fitness {
            bounds: how.bounds,
            margin_m: spec.margin_m(),
            penalty_r: spec.penalty_r,
            penalty_s: spec.penalty_s,
        },
        ga: how.ga,
        clearance: &|x| clearance.of(x),
    };
    let bred = begun(&search, state, &clearance)?;
    let flown: Vec<(Point, Option<[f64; 4]>)> =
        task.flown.iter().map(|f| (f.parameters.0, f.scaled.as_ref().map(|s| means(s).0))).collect();
    let bearing = direct::step(&search, bred, &flown).map_err(|e| ComputeError::Failed(e.to_string()))?;
    let simulations = state.simulations + u32::try_from(flown.len()).unwrap_or(u32::MAX);
    result(task, model, state, simulations, bearing)
}

/// What the round before left; none before the first generation.
fn begun(search: &Direct<'_>, state: &BreedState, clearance: &Clearance) -> Result<Option<Bred>, ComputeError> {
    if state.genes.is_empty() {
        return Ok(None);
    }
    let number = |fitness: Option<f64>| fitness.unwrap_or(f64::INFINITY);
    let champion = state.champion.as_ref().map(|flown| {
        let missing = || ComputeError::Refused(vec![FieldProblem::new("/state/champion", "was not flown")]);
        let (outputs, _) = means(flown.scaled.as_ref().ok_or_else(missing)?);
        let point = flown.parameters.0;
        Ok(Champion { point, score: search.fitness.judge(&point, outputs, clearance.of(&point)) })
    });
    Ok(Some(Bred {
        ga: GaSnapshot {
            units: state.genes.clone(),
            elite: state.elite.iter().copied().map(number).collect(),
            history: state.history.iter().map(|[b, m]| Generation { best: number(*b), mean: number(*m) }).collect(),
            best: state.best,
        },
        champion: champion.transpose()?,
    }))
}

fn result(
    task: &SearchTask,
    model: &ResolvedModel,
    before: &BreedState,
    simulations: u32,
    bearing: Bearing,
) -> Result<SearchResult, ComputeError> {
    let (champion, history) = match &bearing {
        Bearing::Fly { bred, .. } => (bred.champion, bred.ga.history.clone()),
        Bearing::Done { champion, history, .. } => (Some(*champion), history.clone()),
    };
    // It came with this generation, or is the one there was.
    let flown = champion.and_then(|c| {
        let mut all = task.flown.iter().chain(&before.champion);
        all.find(|f| f.parameters.0 == c.point).cloned()
    });
    let standing = standing(&model.insect, champion, flown.clone(), &history, simulations);
    let next = match bearing {
        Bearing::Fly { bred, strokes } => {
            finite(strokes.iter().flatten().copied())?;
            let state = BreedState { champion: flown, simulations, ..message(bred.ga) };
            let strokes = strokes.into_iter().map(ParameterValues).collect();
            SearchNext::Fly { state: Box::new(SearchState::Breed(state)), strokes }
        }
        Bearing::Done { champion, stop, history } => {
            SearchNext::Found { optimum: Box::new(found(&champion, stop, &history, simulations)?) }
        }
    };
    Ok(SearchResult { next, standing, solver_version: SOLVER_VERSION.into() })
}

/// JSON has no infinity: what has no fitness has none.
fn number(fitness: f64) -> Option<f64> {
    Some(fitness).filter(|f| f.is_finite())
}

fn message(ga: GaSnapshot) -> BreedState {
    BreedState {
        genes: ga.units,
        elite: ga.elite.into_iter().map(number).collect(),
        history: ga.history.iter().map(|g| [number(g.best), number(g.mean)]).collect(),
        best: ga.best,
        champion: None,
        simulations: 0,
    }
}

fn standing(
    insect: &Insect,
    champion: Option<Champion>,
    best: Option<FlownMessage>,
    history: &[Generation],
    simulations: u32,
) -> Standing {
    let pair = |g: &Generation| Some([number(g.best)?, number(g.mean)?]);
    Standing {
        rounds: u32::try_from(history.len()).unwrap_or(u32::MAX),
        simulations,
        radius: None,
        predicted: None,
        power_per_lift_w_per_n: champion.and_then(|c| power_per_lift(insect, &c.score.outputs)),
        fitness: champion.map(|c| c.score.fitness),
        prices: None,
        trimmed_power: None,
        history: history.iter().filter_map(pair).collect(),
        best,
    }
}

/// The best stroke flown as the optimum of an optimisation.
fn found(
    champion: &Champion,
    stop: GaStop,
    history: &[Generation],
    simulations: u32,
) -> Result<OptimiseResult, ComputeError> {
    let score = &champion.score;
    finite(champion.point.iter().chain(&score.outputs).copied())?;
    finite([score.fitness, score.penalty, score.clearance_m])?;
    let generation = |(i, g): (usize, &Generation)| {
        let (best, mean) = number(g.best).zip(number(g.mean))?;
        Some(GenerationMessage { generation: u32::try_from(i).unwrap_or(u32::MAX), best, mean })
    };
    Ok(OptimiseResult {
        parameters: ParameterValues(champion.point),
        predicted: scaled(score.outputs),
        fitness: score.fitness,
        penalty: score.penalty,
        clearance_mm: score.clearance_m * 1e3,
        history: history.iter().enumerate().filter_map(generation).collect(),
        stopped: stopped(stop).into(),
        evaluations: simulations.into(),
        optimality: None,
        solver_version: SOLVER_VERSION.into(),
    })
}

/// Why a genetic algorithm ended, in words.
pub(in crate::compute) fn stopped(stop: GaStop) -> &'static str {
    match stop {
        GaStop::Stalled => "the best fitness no longer changed",
        GaStop::Generations => "all generations were made",
        GaStop::Interrupted => "interrupted",
    }
}
