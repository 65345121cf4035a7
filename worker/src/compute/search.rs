//! A round of a search which asks for simulations.

use std::ops::ControlFlow;

use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::Clearance;
use manduca_numerics::optimise::sqp::{self, Differentiable, Flight, SqpSettings};
use manduca_numerics::parameters::{Bounds, Point};
use manduca_numerics::refine::{self, Flown, Next, RefineSettings, RefineStop, Region, Tools, merit, off_trim};
use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_numerics::surrogate::Surrogate;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::search::{FlownMessage, RefineState, SearchNext, SearchResult, SearchTask, Standing};
use manduca_protocol::{network, resolve};

use super::{ComputeError, bounds, finite, scaled};

/// Descents begun in each trust region: from its centre, and a few points of it.
const STARTS: usize = 24;

/// Proposes the next strokes of a search, or ends it.
pub(super) fn search(task: &SearchTask) -> Result<SearchResult, ComputeError> {
    let model = resolve::model(&task.model, "/model").map_err(ComputeError::Refused)?;
    let surrogate = network::surrogate(&task.surrogate)
        .map_err(|why| ComputeError::Refused(vec![FieldProblem::new("/surrogate", why)]))?;
    let (known, region) = gathered(task);
    let flown: Vec<Flown> = known.iter().map(flown).collect();
    let settings = RefineSettings {
        simulations: task.optimisation.refine_simulations as usize,
        seed: task.seed,
        ..RefineSettings::default()
    };
    let clearance = Clearance::new(&model.insect, model.elevation_phase);
    let margin_m = task.optimisation.clearance_margin_mm * 1e-3;
    let next = propose(&surrogate, &clearance, margin_m, &bounds(&task.bounds), &settings, &flown, &region);
    let standing = standing(&model.insect, &known, &flown, &next, &region);
    let next = match next {
        Next::Fly { region, batch } => {
            finite(batch.iter().flatten().copied())?;
            SearchNext::Fly { state: state(&region, known), strokes: batch.into_iter().map(ParameterValues).collect() }
        }
        Next::Done { stop, .. } => {
            SearchNext::Done { reason: reason(stop).into(), converged: stop == RefineStop::Agreed }
        }
    };
    Ok(SearchResult { next, standing, solver_version: SOLVER_VERSION.into() })
}

/// All strokes flown, and the trust region the last ones were for.
fn gathered(task: &SearchTask) -> (Vec<FlownMessage>, Region) {
    let start = Region { round: 0, radius: RefineSettings::default().radius, candidate: None };
    let (mut known, region) = match &task.state {
        Some(state) => {
            let candidate = state.candidate.map(|c| c as usize).zip(state.predicted);
            (state.flown.clone(), Region { round: state.round as usize, radius: state.radius, candidate })
        }
        None => (Vec::new(), start),
    };
    known.extend(task.flown.iter().cloned());
    // A state whose candidate is not among the strokes cannot be judged.
    let candidate = region.candidate.filter(|(index, _)| *index < known.len());
    (known, Region { candidate, ..region })
}

fn flown(message: &FlownMessage) -> Flown {
    let means = message.scaled.as_ref().map(|s| {
        let all = [&s.lift, &s.drag, &s.pitch_moment, &s.power];
        (all.map(|e| e.mean), all.map(|e| e.se))
    });
    Flown { x: message.parameters.0, means }
}

fn propose(
    surrogate: &Surrogate,
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
        let found = sqp::minimise(&flight, &how, &mut |_| ControlFlow::Continue(()));
        found.ok().map(|found| found.best().point)
    };
    let tools = Tools { surrogate, minimise: &minimise, clear: &|x| clearance.of(x) >= margin_m };
    refine::step(&tools, bounds, settings, flown, region)
}

fn state(region: &Region, flown: Vec<FlownMessage>) -> RefineState {
    RefineState {
        round: count(region.round),
        radius: region.radius,
        candidate: region.candidate.map(|(index, _)| count(index)),
        predicted: region.candidate.map(|(_, predicted)| predicted),
        flown,
    }
}

/// The best stroke so far, and the merit's two parts as the strokes came in.
fn standing(insect: &Insect, known: &[FlownMessage], flown: &[Flown], next: &Next, region: &Region) -> Standing {
    let mut history = Vec::with_capacity(flown.len());
    let mut best: Option<(usize, [f64; 4])> = None;
    for (i, stroke) in flown.iter().enumerate() {
        if let Some((y, _)) = stroke.means
            && best.is_none_or(|(_, known)| merit(&y) < merit(&known))
        {
            best = Some((i, y));
        }
        history.extend(best.map(|(_, y)| [off_trim(&y), y[3]]));
    }
    let predicted = match next {
        Next::Done { predicted, .. } => Some(*predicted),
        Next::Fly { .. } => region.candidate.filter(|(c, _)| best.is_some_and(|b| b.0 == *c)).map(|c| c.1),
    };
    let scales = insect.scales();
    Standing {
        rounds: count(region.round),
        simulations: count(flown.len()),
        radius: Some(region.radius),
        best: best.map(|(i, _)| known[i].clone()),
        predicted: predicted.filter(|p| p.iter().all(|v| v.is_finite())).map(scaled),
        power_per_lift_w_per_n: best.map(|(_, y)| y[3] * scales[3] / (y[0] * scales[0])).filter(|p| p.is_finite()),
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
