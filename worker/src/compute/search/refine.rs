//! A round of the trust region around an optimum.

use std::ops::ControlFlow;

use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::Clearance;
use manduca_numerics::optimise::sqp::{self, Differentiable, Flight, SqpSettings};
use manduca_numerics::parameters::{Bounds, Point};
use manduca_numerics::refine::{
    self, Flown, Local, Minimum, Next, RefineSettings, RefineStop, Region, Tools, merit, off_trim, trimmed_power,
};
use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::network;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::resolve::ResolvedModel;
use manduca_protocol::search::{
    FlownMessage, RefineState, SearchNext, SearchResult, SearchState, SearchTask, Standing, TrimPrices,
};

use super::{means, power_per_lift};
use crate::compute::{ComputeError, bounds, finite, scaled};

/// Descents begun in each trust region: from its centre, and a few points of it.
const STARTS: usize = 24;

/// Proposes the next strokes around an optimum, or ends the search.
pub(super) fn refine(
    task: &SearchTask,
    model: &ResolvedModel,
    state: &RefineState,
) -> Result<SearchResult, ComputeError> {
    let within = bounds(&task.bounds);
    let (known, region) = gathered(task, state);
    let flown: Vec<Flown> = known.iter().map(flown).collect();
    let (base, around) = base(task, state, &within, &flown)?;
    let settings = RefineSettings {
        simulations: task.optimisation.refine_simulations as usize,
        seed: task.seed,
        ..RefineSettings::default()
    };
    let clearance = Clearance::new(&model.insect, model.elevation_phase);
    let margin_m = task.optimisation.margin_m();
    let next = propose(&*base, &clearance, margin_m, &within, &settings, &flown, &region);
    let standing = standing(&model.insect, &known, &flown, &next, &region);
    let next = match next {
        Next::Fly { region, batch } => {
            finite(batch.iter().flatten().copied())?;
            let state = RefineState { around, ..message(&region, known) };
            let strokes = batch.into_iter().map(ParameterValues).collect();
            SearchNext::Fly { state: Box::new(SearchState::Refine(state)), strokes }
        }
        Next::Done { stop, .. } => {
            SearchNext::Done { reason: reason(stop).into(), converged: stop == RefineStop::Agreed }
        }
    };
    Ok(SearchResult { next, standing, solver_version: SOLVER_VERSION.into() })
}

/// What is refined: the surrogate, or where there is none what the strokes flown around the
/// optimum say; and those of them which later rounds need.
fn base(
    task: &SearchTask,
    state: &RefineState,
    within: &Bounds,
    flown: &[Flown],
) -> Result<(Box<dyn Differentiable>, Vec<FlownMessage>), ComputeError> {
    if let Some(surrogate) = &task.surrogate {
        let refused = |why| ComputeError::Refused(vec![FieldProblem::new("/surrogate", why)]);
        return Ok((Box::new(network::surrogate(surrogate).map_err(refused)?), Vec::new()));
    }
    let centre = flown.first().ok_or_else(|| ComputeError::Failed("no optimum was flown".into()))?.x;
    let around: Vec<Flown> = state.around.iter().map(self::flown).collect();
    let model = Local::fit(within, &centre, &around)
        .ok_or_else(|| ComputeError::Failed("no stroke was flown around the optimum".into()))?;
    let near = Local::nearest(within, &centre, &around);
    Ok((Box::new(model), near.into_iter().map(|i| state.around[i].clone()).collect()))
}

/// All strokes flown, and the trust region the last ones were for.
fn gathered(task: &SearchTask, state: &RefineState) -> (Vec<FlownMessage>, Region) {
    let known: Vec<FlownMessage> = state.flown.iter().chain(&task.flown).cloned().collect();
    let candidate = state.candidate.map(|c| c as usize).zip(state.predicted);
    let region = Region {
        round: state.round as usize,
        radius: state.radius,
        // A state whose candidate is not among the strokes cannot be judged.
        candidate: candidate.filter(|(index, _)| *index < known.len()),
        weight: state.weight,
        prices: state.prices.map(|p| [p.lift, p.drag, p.pitch_moment]),
    };
    (known, region)
}

fn flown(message: &FlownMessage) -> Flown {
    Flown { x: message.parameters.0, means: message.scaled.as_ref().map(means) }
}

fn propose(
    surrogate: &dyn Differentiable,
    clearance: &Clearance,
    margin_m: f64,
    bounds: &Bounds,
    settings: &RefineSettings,
    flown: &[Flown],
    region: &Region,
) -> Next {
    let minimise = |model: &dyn Differentiable, within: &Bounds, _: &Point| {
        let flight = Flight { surrogate: model, clearance: Some(clearance), margin_m, bounds: *within };
        let how = SqpSettings { starts: STARTS, seed: settings.seed, ..SqpSettings::default() };
        let found = sqp::minimise(&flight, &how, &mut |_| ControlFlow::Continue(())).ok()?;
        Some(Minimum { point: found.best().point, prices: found.best().multipliers })
    };
    let tools = Tools { surrogate, minimise: &minimise, clear: &|x| clearance.of(x) >= margin_m };
    refine::step(&tools, bounds, settings, flown, region)
}

fn message(region: &Region, flown: Vec<FlownMessage>) -> RefineState {
    RefineState {
        round: count(region.round),
        radius: region.radius,
        candidate: region.candidate.map(|(index, _)| count(index)),
        predicted: region.candidate.map(|(_, predicted)| predicted),
        weight: region.weight,
        prices: region.prices.map(prices),
        flown,
        around: Vec::new(),
    }
}

fn prices([lift, drag, pitch_moment]: [f64; 3]) -> TrimPrices {
    TrimPrices { lift, drag, pitch_moment }
}

/// The best stroke so far, and the merit's two parts as the strokes came in.
fn standing(insect: &Insect, known: &[FlownMessage], flown: &[Flown], next: &Next, before: &Region) -> Standing {
    let (Next::Done { region, .. } | Next::Fly { region, .. }) = next;
    let mut history = Vec::with_capacity(flown.len());
    let mut best: Option<(usize, [f64; 4])> = None;
    for (i, stroke) in flown.iter().enumerate() {
        if let Some((y, _)) = stroke.means
            && best.is_none_or(|(_, known)| merit(&y, region.weight) < merit(&known, region.weight))
        {
            best = Some((i, y));
        }
        history.extend(best.map(|(_, y)| [off_trim(&y), y[3]]));
    }
    let predicted = match next {
        Next::Done { predicted, .. } => Some(*predicted),
        Next::Fly { .. } => before.candidate.filter(|(c, _)| best.is_some_and(|b| b.0 == *c)).map(|c| c.1),
    };
    let known_prices = region.prices.filter(|p| p.iter().all(|v| v.is_finite()));
    Standing {
        rounds: count(before.round),
        simulations: count(flown.len()),
        radius: Some(before.radius),
        best: best.map(|(i, _)| known[i].clone()),
        predicted: predicted.filter(|p| p.iter().all(|v| v.is_finite())).map(scaled),
        power_per_lift_w_per_n: best.and_then(|(_, y)| power_per_lift(insect, &y)),
        fitness: None,
        prices: known_prices.map(prices),
        trimmed_power: best.zip(known_prices).map(|((_, y), prices)| trimmed_power(&y, &prices)),
        history,
    }
}

fn reason(stop: RefineStop) -> &'static str {
    match stop {
        RefineStop::Agreed => "prediction and simulation agree",
        RefineStop::Budget => "no simulations are left",
        RefineStop::Radius => "the trust region has shrunk to nothing",
        RefineStop::Nothing => "no stroke in trim is foreseen near the optimum",
    }
}

fn count(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}
