//! Whether a round of a search goes on from what was flown, and asks for strokes that may be flown.

use std::collections::HashMap;

use manduca_numerics::optimise::{Ga, GaSnapshot, Generation, OptimiseError, clamped};
use manduca_numerics::parameters::COUNT;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::search::{BreedState, FlownMessage, RefineState, SearchNext, SearchResult, SearchState};
use manduca_protocol::task::{OptimiseResult, ScaledEstimates};

use super::optimum::{Asked, TOLERANCE, four};
use super::{Fault, agrees, differs, inside};

/// Strokes that were flown, by the bits of their parameters.
struct Met<'f>(HashMap<[u64; COUNT], &'f FlownMessage>);

fn bits(parameters: &ParameterValues) -> [u64; COUNT] {
    parameters.0.map(f64::to_bits)
}

impl<'f> Met<'f> {
    fn new(flown: impl Iterator<Item = &'f FlownMessage>) -> Self {
        // The first of equal ones, as the search itself does.
        let mut met = HashMap::new();
        for stroke in flown {
            met.entry(bits(&stroke.parameters)).or_insert(stroke);
        }
        Self(met)
    }

    /// The means of a stroke, if it was flown and has some.
    fn means(&self, parameters: &ParameterValues) -> Option<&ScaledEstimates> {
        self.0.get(&bits(parameters)).and_then(|stroke| stroke.scaled.as_ref())
    }

    /// Checks that a stroke was flown with this result.
    fn has(&self, what: &str, claimed: &FlownMessage) -> Result<(), Fault> {
        match self.0.get(&bits(&claimed.parameters)) {
            Some(stroke) if *stroke == claimed => Ok(()),
            _ => Err(Fault::False(format!("{what} was not flown, or with another result"))),
        }
    }
}

/// Checks a round against the one before and the strokes flown since.
pub(super) fn check(
    asked: &Asked<'_>,
    before: &SearchState,
    flown: &[FlownMessage],
    claimed: &SearchResult,
) -> Result<(), Fault> {
    let earlier: Vec<&FlownMessage> = match before {
        SearchState::Breed(state) => state.champion.iter().collect(),
        SearchState::Refine(state) => state.flown.iter().collect(),
    };
    let met = Met::new(earlier.into_iter().chain(flown));
    if let Some(best) = &claimed.standing.best {
        met.has("the best stroke", best)?;
        power_per_lift(asked, best, claimed.standing.power_per_lift_w_per_n)?;
    } else if claimed.standing.power_per_lift_w_per_n.is_some() {
        return Err(Fault::Useless("a power per lift is claimed of no stroke".into()));
    }
    match &claimed.next {
        SearchNext::Fly { state, strokes } => {
            strokes.iter().try_for_each(|stroke| inside(&asked.bounds, &stroke.0))?;
            match (before, &**state) {
                (SearchState::Breed(before), SearchState::Breed(state)) => {
                    bred(asked, &met, state, strokes.len())?;
                    continued(before, flown.len(), state)?;
                    fitnesses(asked, before, flown, state)
                }
                (SearchState::Refine(before), SearchState::Refine(state)) => refined(before, flown, state),
                _ => Err(Fault::Useless("the round goes on with another kind of search".into())),
            }
        }
        SearchNext::Found { optimum } if matches!(before, SearchState::Breed(_)) => found(asked, &met, optimum),
        SearchNext::Found { .. } => Err(Fault::Useless("refining finds no optimum of generations".into())),
        SearchNext::Done { .. } => Ok(()),
    }
}

/// Power per lift of a stroke that was flown.
fn power_per_lift(asked: &Asked<'_>, best: &FlownMessage, claimed: Option<f64>) -> Result<(), Fault> {
    let (Some(scaled), Some(claimed)) = (&best.scaled, claimed) else { return Ok(()) };
    let scales = asked.model.insect.scales();
    let found = scaled.power.mean * scales[3] / (scaled.lift.mean * scales[0]);
    if agrees(claimed, found, TOLERANCE, 0.0) {
        return Ok(());
    }
    Err(differs(claimed, found, format!("the power per lift is {found} W/N, not {claimed} as claimed")))
}

fn bred(asked: &Asked<'_>, met: &Met<'_>, state: &BreedState, strokes: usize) -> Result<(), Fault> {
    let population = asked.spec.population() as usize;
    if strokes > population || state.genes.len() > population {
        let why = format!("a generation has {population} individuals, and {strokes} strokes are asked for");
        return Err(Fault::Useless(why));
    }
    resumable(asked, state)?;
    let Some(champion) = &state.champion else { return Ok(()) };
    met.has("the best individual", champion)?;
    if champion.scaled.is_none() { Err(unfit("its best individual could not be flown")) } else { Ok(()) }
}

fn unfit(why: &str) -> Fault {
    Fault::Useless(format!("the round's state does not fit its search: {why}"))
}

/// Checks that the next round can take up the state, as a worker does it.
fn resumable(asked: &Asked<'_>, state: &BreedState) -> Result<(), Fault> {
    let number = |fitness: Option<f64>| fitness.unwrap_or(f64::INFINITY);
    let snapshot = GaSnapshot {
        units: state.genes.clone(),
        elite: state.elite.iter().copied().map(number).collect(),
        history: state.history.iter().map(|[b, m]| Generation { best: number(*b), mean: number(*m) }).collect(),
        best: state.best,
    };
    match Ga::restore(asked.bounds, asked.ga, snapshot) {
        Ok(_) => Ok(()),
        Err(OptimiseError::Snapshot(why)) => Err(unfit(why)),
        Err(why) => Err(unfit(&why.to_string())),
    }
}

/// Checks that a generation carries on what the one before left.
fn continued(before: &BreedState, flown: usize, state: &BreedState) -> Result<(), Fault> {
    if !state.history.starts_with(&before.history) {
        return Err(Fault::False("the round carries on another history than it was given".into()));
    }
    // More than one is added where generations have nothing to fly; none before anything was flown.
    let begun = !before.genes.is_empty();
    if begun != (state.history.len() > before.history.len()) {
        return Err(unfit("its history does not follow from the round before"));
    }
    if before.champion.is_some() && state.champion.is_none() {
        return Err(unfit("it has lost the best individual"));
    }
    let most = before.simulations.saturating_add(u32::try_from(flown).unwrap_or(u32::MAX));
    if !(before.simulations..=most).contains(&state.simulations) {
        let (least, claimed) = (before.simulations, state.simulations);
        return Err(Fault::Useless(format!("{claimed} strokes are claimed to be flown, not {least} to {most}")));
    }
    Ok(())
}

/// Checks that every fitness carried on is that of an individual which survived or was flown.
fn fitnesses(asked: &Asked<'_>, before: &BreedState, flown: &[FlownMessage], state: &BreedState) -> Result<(), Fault> {
    let means: HashMap<[u64; COUNT], [f64; 4]> =
        flown.iter().filter_map(|f| Some((bits(&f.parameters), f.scaled?.means()))).collect();
    let judged = before.genes.iter().skip(before.elite.len()).filter_map(|genes| {
        let individual = asked.bounds.from_unit(genes);
        let inside = ParameterValues(clamped(&asked.bounds, &individual));
        means.get(&bits(&inside)).map(|means| asked.fitness_of(&individual, *means))
    });
    let survived = before.elite.iter().copied().flatten().chain(before.best.map(|(_, fitness)| fitness));
    let known: Vec<f64> = survived.chain(judged).filter(|fitness| fitness.is_finite()).collect();
    // The clearance is computed again, and a lack of it counts so many times.
    let least = TOLERANCE * (1.0 + asked.spec.penalty_s);
    let has = |claim: f64| claim.is_finite() && known.iter().any(|found| agrees(claim, *found, TOLERANCE, least));
    let told = state.history.iter().skip(before.history.len()).filter_map(|[best, _]| *best);
    let best = state.best.map(|(_, fitness)| fitness);
    if state.elite.iter().copied().flatten().chain(told).chain(best).all(has) {
        return Ok(());
    }
    Err(Fault::False("the round claims a fitness that no flown stroke has".into()))
}

/// What a trust region carries on is what it was given, and what was flown since.
fn refined(before: &RefineState, flown: &[FlownMessage], state: &RefineState) -> Result<(), Fault> {
    if !state.flown.iter().eq(before.flown.iter().chain(flown)) {
        return Err(Fault::False("the round carries on other strokes than were flown".into()));
    }
    let sound = |x: f64| x.is_finite() && x > 0.0;
    let next = before.round.checked_add(1) == Some(state.round);
    if !next || !sound(state.radius) || !sound(state.weight) {
        return Err(unfit("it has another round, or a radius or weight that is no positive number"));
    }
    let around = Met::new(before.around.iter());
    state.around.iter().try_for_each(|stroke| around.has("a stroke around the optimum", stroke))
}

/// The optimum of generations is a stroke that was flown.
fn found(asked: &Asked<'_>, met: &Met<'_>, optimum: &OptimiseResult) -> Result<(), Fault> {
    let unflown = || Fault::False("the optimum was not flown".into());
    let means = met.means(&optimum.parameters).ok_or_else(unflown)?;
    let flown = means.means();
    if four(&optimum.predicted) != flown {
        let why = format!("the optimum was flown with {flown:?}, not {:?} as claimed", optimum.predicted);
        return Err(Fault::False(why));
    }
    asked.judge(optimum)
}
