//! What a result must be by itself, whatever study it is for: lengths, signs, finite numbers. What
//! its study must bear out is checked elsewhere: of simulations by the writer (`store/limits.rs`),
//! of everything larger on a thread of its own (`claims.rs`).

use manduca_protocol::network;
use manduca_protocol::resolve::{MAX_ENSEMBLE, MAX_FLOWN_GENERATIONS, MAX_FLOWN_POPULATION, MAX_NEURONS, MAX_REFINING};
use manduca_protocol::search::{BreedState, FlownMessage, SearchNext, SearchResult, SearchState, Standing};
use manduca_protocol::task::{
    Checkpoint, Estimate, FitCheckpoint, JointPowers, MeansMessage, NetworkMessage, OptimiseResult, Progress,
    Provenance, ScaledEstimates, TrainCheckpoint, TrainResult,
};
use manduca_protocol::text::acts;

use crate::store::STROKES;

/// Longest text a worker may send, characters.
pub(crate) const LONGEST_TEXT: usize = 2000;
/// Longest name of an instruction level, characters.
const LONGEST_LEVEL: usize = 200;
/// Longest time a job may claim to have computed, s: a month.
const LONGEST_WALL_S: f64 = 31.0 * 86_400.0;
/// Most iterations of one network, the start included.
const MOST_ITERATIONS: usize = 10_001;
/// Most generations of a genetic algorithm on a network.
const MOST_GENERATIONS: usize = 10_001;
/// Most optima of one search.
const MOST_OPTIMA: usize = 50;
/// Most ascents of a fit, and most numbers of each.
const MOST_ASCENTS: usize = 64;
/// Relative error of quantities that follow from each other by a product or a sum.
const ROUNDING: f64 = 1e-9;

/// The beginning of a text a worker sends, without what a terminal would obey.
pub(crate) fn cut(text: &str, most: usize) -> String {
    text.chars().take(most).map(|c| if acts(c) { ' ' } else { c }).collect()
}

/// A text as it may be stored.
fn text(what: &str, text: &str) -> Result<(), String> {
    if text.chars().nth(LONGEST_TEXT).is_some() {
        return Err(format!("{what} has more than {LONGEST_TEXT} characters"));
    }
    if text.chars().any(acts) {
        return Err(format!("{what} has control characters"));
    }
    Ok(())
}

fn at_most(what: &str, length: usize, most: usize) -> Result<(), String> {
    if length > most { Err(format!("{what} has {length} entries; {most} are possible")) } else { Ok(()) }
}

fn finite(what: &str, values: impl IntoIterator<Item = f64>) -> Result<(), String> {
    if values.into_iter().all(f64::is_finite) { Ok(()) } else { Err(format!("{what} has a number that is not finite")) }
}

/// Where and how long a job was computed, cut to what is stored, and what is wrong with it.
pub(crate) fn provenance(given: Provenance) -> (Provenance, Result<(), String>) {
    let Provenance { wall_s, level } = given;
    let sound = if !(0.0..=LONGEST_WALL_S).contains(&wall_s) {
        Err(format!("it claims to have computed for {wall_s} s; 0 to {LONGEST_WALL_S} are possible"))
    } else if level.is_empty() || level.chars().nth(LONGEST_LEVEL).is_some() {
        Err(format!("the instruction level has no or more than {LONGEST_LEVEL} characters"))
    } else {
        Ok(())
    };
    let wall_s = if wall_s.is_finite() { wall_s.clamp(0.0, LONGEST_WALL_S) } else { 0.0 };
    (Provenance { wall_s, level: cut(&level, LONGEST_LEVEL) }, sound)
}

/// A note of progress, cut to what is stored.
pub(crate) fn progress(at: Progress) -> Progress {
    Progress { note: cut(&at.note, LONGEST_TEXT), ..at }
}

/// Whether a reason for an infeasible stroke may be stored.
pub(crate) fn reason(why: &str) -> Result<(), String> {
    if why.trim().is_empty() {
        return Err("no reason is told".into());
    }
    text("the reason", why)
}

fn pairs(estimates: [Estimate; 4]) -> [[f64; 2]; 4] {
    estimates.map(|e| [e.mean, e.se])
}

/// Means of a flight in SI units and scaled, each with its standard error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Flown {
    pub(crate) si: [[f64; 2]; 4],
    pub(crate) scaled: [[f64; 2]; 4],
    pub(crate) strokes: u32,
}

/// Checks the means of a flight against each other.
pub(crate) fn flown(
    means: &MeansMessage,
    scaled: &ScaledEstimates,
    joints: &JointPowers,
    per_lift: Option<f64>,
    strokes: u32,
) -> Result<Flown, String> {
    let si = pairs([means.lift_n, means.drag_n, means.pitch_moment_nm, means.power_w]);
    let scaled = pairs([scaled.lift, scaled.drag, scaled.pitch_moment, scaled.power]);
    let each = [joints.sweep, joints.elevation, joints.rotation];
    finite("the means", si.iter().chain(&scaled).flatten().copied())?;
    finite("the power of the joints", each.iter().flat_map(|j| [j.aerodynamic_w, j.inertial_w, j.required_w]))?;
    if si.iter().chain(&scaled).any(|[_, se]| *se < 0.0) {
        return Err("a standard error is negative".into());
    }
    if each.iter().any(|j| j.required_w < 0.0) {
        return Err("a joint requires negative power, and none is stored".into());
    }
    if strokes == 0 {
        return Err("no stroke is in the means".into());
    }
    let power = si[3][0];
    let (sum, size) = each.iter().fold((0.0, 0.0), |(s, a), j| (s + j.required_w, a + j.required_w.abs()));
    if (power - sum).abs() > ROUNDING * size.max(power.abs()) {
        return Err(format!("a power of {power} W is not the sum of its joints', {sum} W"));
    }
    let expected = Some(power / si[0][0]).filter(|p| p.is_finite() && si[0][0] > 0.0);
    match (per_lift, expected) {
        (None, None) => {}
        (Some(told), Some(p)) if (told - p).abs() <= ROUNDING * p.abs() => {}
        _ => return Err(format!("a power per lift of {per_lift:?} W/N does not follow from the means")),
    }
    Ok(Flown { si, scaled, strokes })
}

/// Checks the size of a training.
pub(crate) fn training(r: &TrainResult) -> Result<(), String> {
    at_most("the training curve", r.curve.len(), MAX_ENSEMBLE as usize * MOST_ITERATIONS)?;
    at_most("the best iterations", r.best_iterations.len(), MAX_ENSEMBLE as usize)?;
    at_most("the reasons to stop", r.stops.len(), MAX_ENSEMBLE as usize)?;
    r.stops.iter().try_for_each(|stop| text("a reason to stop", stop))?;
    finite("the curve", r.curve.iter().flat_map(|e| [e.train_mse, e.validation_mse, e.test_mse, e.damping]))?;
    at_most("the ensemble", r.surrogate.networks.len(), MAX_ENSEMBLE as usize)?;
    network::surrogate(&r.surrogate).map(drop).map_err(|why| format!("not a surrogate: {why}"))
}

/// Checks the size of an optimum.
pub(crate) fn optimum(r: &OptimiseResult) -> Result<(), String> {
    at_most("the history", r.history.len(), MOST_GENERATIONS)?;
    text("the reason to stop", &r.stopped)?;
    if let Some(known) = &r.optimality {
        at_most("the optima", known.optima.len(), MOST_OPTIMA)?;
    }
    Ok(())
}

/// Checks the size of a round of a search.
pub(crate) fn round(r: &SearchResult) -> Result<(), String> {
    standing(&r.standing)?;
    match &r.next {
        SearchNext::Fly { strokes, .. } if strokes.is_empty() || strokes.len() > STROKES as usize => {
            Err(format!("asks for {} strokes; 1 to {STROKES} are possible", strokes.len()))
        }
        SearchNext::Fly { state, .. } => match &**state {
            SearchState::Breed(state) => breed(state),
            SearchState::Refine(state) => list("the strokes flown", &state.flown)
                .and_then(|()| at_most("the strokes around", state.around.len(), MOST_INDIVIDUALS)),
        },
        SearchNext::Found { optimum: found } => optimum(found),
        SearchNext::Done { reason, .. } => text("the reason to end", reason),
    }
}

/// Most strokes which generations may have flown.
const MOST_INDIVIDUALS: usize = (MAX_FLOWN_POPULATION * MAX_FLOWN_GENERATIONS) as usize;

fn list(what: &str, flown: &[FlownMessage]) -> Result<(), String> {
    at_most(what, flown.len(), MAX_REFINING as usize + STROKES as usize)
}

fn breed(state: &BreedState) -> Result<(), String> {
    at_most("the genes", state.genes.len(), MAX_FLOWN_POPULATION as usize)?;
    at_most("the elite", state.elite.len(), MAX_FLOWN_POPULATION as usize)?;
    at_most("the history", state.history.len(), MAX_FLOWN_GENERATIONS as usize + 1)
}

fn standing(standing: &Standing) -> Result<(), String> {
    at_most("the history", standing.history.len(), MAX_REFINING as usize + STROKES as usize)
}

/// Whether a checkpoint may be stored. One which may not is left out: it is a help, and no more.
pub(crate) fn checkpoint(at: &Checkpoint) -> bool {
    match at {
        Checkpoint::Train(at) => trained_so_far(at),
        Checkpoint::Fit(FitCheckpoint { ascents }) => {
            ascents.len() <= MOST_ASCENTS
                && ascents.iter().all(|a| a.at.len() <= MOST_ASCENTS && text("a reason", &a.stopped).is_ok())
        }
    }
}

fn trained_so_far(at: &TrainCheckpoint) -> bool {
    let fits = |n: &NetworkMessage| n.hidden_biases.len() <= MAX_NEURONS as usize && network::network(n).is_ok();
    at.members.len() <= MAX_ENSEMBLE as usize
        && fits(&at.network)
        && fits(&at.best)
        && at.curve.len() <= MOST_ITERATIONS
        && at.members.iter().all(|m| {
            fits(&m.network) && m.curve.len() <= MOST_ITERATIONS && text("a reason to stop", &m.stopped).is_ok()
        })
}
