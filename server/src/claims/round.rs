//! Whether a round of a search goes on from what was flown, and asks for strokes that may be flown.

use std::collections::HashMap;

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
                (SearchState::Breed(_), SearchState::Breed(state)) => bred(asked, &met, state, strokes.len()),
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
    state.champion.as_ref().map_or(Ok(()), |champion| met.has("the best individual", champion))
}

/// What a trust region carries on is what it was given, and what was flown since.
fn refined(before: &RefineState, flown: &[FlownMessage], state: &RefineState) -> Result<(), Fault> {
    if !state.flown.iter().eq(before.flown.iter().chain(flown)) {
        return Err(Fault::False("the round carries on other strokes than were flown".into()));
    }
    let around = Met::new(before.around.iter());
    state.around.iter().try_for_each(|stroke| around.has("a stroke around the optimum", stroke))
}

/// The optimum of generations is a stroke that was flown.
fn found(asked: &Asked<'_>, met: &Met<'_>, optimum: &OptimiseResult) -> Result<(), Fault> {
    let unflown = || Fault::False("the optimum was not flown".into());
    let means = met.means(&optimum.parameters).ok_or_else(unflown)?;
    let flown = [means.lift.mean, means.drag.mean, means.pitch_moment.mean, means.power.mean];
    if four(&optimum.predicted) != flown {
        let why = format!("the optimum was flown with {flown:?}, not {:?} as claimed", optimum.predicted);
        return Err(Fault::False(why));
    }
    asked.judge(optimum)
}
