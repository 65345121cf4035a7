//! Results are checked, serialised and compressed before they queue for the
//! writer, whose time all workers share.

use std::collections::HashMap;

use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::search::{SearchNext, SearchResult};
use manduca_protocol::study::SurrogateKind;
use manduca_protocol::task::{EpochMessage, JobKind, JobResult, SimulateOutcome, TrainCheckpoint, TrainResult};
use manduca_protocol::view::{SearchView, SurrogateView};
use manduca_protocol::worker::Completion;

use crate::error::ApiError;
use crate::store::{Outcome, Packed, Prepared, pack, pack_large};
use crate::validity::{self, Flown};

/// A result as it goes into the store.
///
/// # Errors
/// When it cannot be serialised or compressed, which is a fault of the coordinator.
pub(crate) fn prepare(completion: Completion) -> Result<Prepared, ApiError> {
    let Completion { job, attempt, result, provenance } = completion;
    let (provenance, sound) = validity::provenance(provenance);
    let (outcome, flown) = match sound.and_then(|()| judge(&result)) {
        Ok(judged) => judged,
        Err(why) => (Outcome::Unusable(why), None),
    };
    let (kind, packed, summary) = match result {
        JobResult::Simulate(result) => (JobKind::Simulate, pack(&*result), None),
        JobResult::Optimise(result) => (JobKind::Optimise, pack(&*result), None),
        JobResult::Search(result) => (JobKind::Search, pack_large(&*result), Some(to_text(&standing(*result))?)),
        JobResult::Train(result) => (JobKind::Train, pack_large(&*result), Some(to_text(&summary(*result))?)),
    };
    let Packed { body, digest } = packed.map_err(internal)?;
    Ok(Prepared { job, attempt, kind, outcome, flown, digest, body, summary, provenance })
}

fn to_text(value: &impl serde::Serialize) -> Result<String, ApiError> {
    serde_json::to_string(value).map_err(internal)
}

fn internal(error: impl std::error::Error + Send + Sync + 'static) -> ApiError {
    ApiError::Internal(Box::new(error))
}

/// What a result makes of its job, by itself, and the means of a flight. Registration has compared the
/// versions, but the result is what counts.
fn judge(result: &JobResult) -> Result<(Outcome, Option<Flown>), String> {
    let version = match result {
        JobResult::Simulate(r) => &r.solver_version,
        JobResult::Train(r) => &r.solver_version,
        JobResult::Optimise(r) => &r.solver_version,
        JobResult::Search(r) => &r.solver_version,
    };
    if version != SOLVER_VERSION {
        let theirs = validity::cut(version, 20);
        return Err(format!("computed by solver version `{theirs}`, not `{SOLVER_VERSION}`"));
    }
    match result {
        JobResult::Simulate(r) => match &r.outcome {
            SimulateOutcome::Ok { means, scaled, joints, power_per_lift_w_per_n, strokes_averaged } => {
                let flown = validity::flown(means, scaled, joints, *power_per_lift_w_per_n, *strokes_averaged)?;
                return Ok((Outcome::Succeeded, Some(flown)));
            }
            SimulateOutcome::Infeasible { reason } => {
                validity::reason(reason)?;
                return Ok((Outcome::Infeasible(reason.clone()), None));
            }
        },
        JobResult::Train(r) => validity::training(r)?,
        JobResult::Optimise(r) => validity::optimum(r)?,
        JobResult::Search(r) => validity::round(r)?,
    }
    Ok((Outcome::Succeeded, None))
}

/// A round of a search without the strokes it asks for.
fn standing(result: SearchResult) -> SearchView {
    let standing = result.standing;
    match result.next {
        SearchNext::Done { reason, converged } => SearchView { standing, ended: Some(reason), converged },
        SearchNext::Found { optimum } => SearchView { standing, ended: Some(optimum.stopped), converged: true },
        SearchNext::Fly { .. } => SearchView { standing, ended: None, converged: false },
    }
}

/// Iterations of each network which a view shows, about.
const SHOWN: usize = 1000;

/// A training curve as it is shown. Of a network with many more than [`SHOWN`] iterations it has every n-th, the
/// best and the last.
fn thinned(curve: Vec<EpochMessage>, best_iterations: &[u32]) -> Vec<EpochMessage> {
    let mut lasts: HashMap<u32, u32> = HashMap::new();
    for at in &curve {
        let last = lasts.entry(at.network).or_default();
        *last = (*last).max(at.iteration);
    }
    let is_shown = |at: &EpochMessage| {
        let last = lasts.get(&at.network).copied().unwrap_or_default();
        let step = (last / SHOWN as u32).max(1);
        let best = best_iterations.get(at.network as usize);
        at.iteration.is_multiple_of(step) || at.iteration == last || best == Some(&at.iteration)
    };
    curve.into_iter().filter(is_shown).collect()
}

/// A training without its weights.
fn summary(result: TrainResult) -> SurrogateView {
    let neurons = result.surrogate.networks.first().map_or(0, |n| n.hidden_biases.len());
    let process = result.surrogate.process.is_some();
    SurrogateView {
        kind: if process { SurrogateKind::GaussianProcess } else { SurrogateKind::Network },
        neurons: u32::try_from(neurons).unwrap_or(u32::MAX),
        curve: thinned(result.curve, &result.best_iterations),
        best_iterations: result.best_iterations,
        stops: result.stops,
        train: Some(result.train),
        validation: Some(result.validation),
        test: Some(result.test),
        disowned_results: 0,
    }
}

/// A training which is under way, without its weights.
pub(crate) fn running(at: TrainCheckpoint) -> SurrogateView {
    let neurons = u32::try_from(at.network.hidden_biases.len()).unwrap_or(u32::MAX);
    let best_iterations: Vec<_> = at.members.iter().map(|m| m.best_iteration).collect();
    let stops = at.members.iter().map(|m| m.stopped.clone()).collect();
    let curve = at.members.into_iter().flat_map(|m| m.curve).chain(at.curve).collect();
    let curve = thinned(curve, &best_iterations);
    let kind = SurrogateKind::Network;
    SurrogateView {
        kind,
        neurons,
        curve,
        best_iterations,
        stops,
        train: None,
        validation: None,
        test: None,
        disowned_results: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_curve_is_shown_with_its_ends_and_its_best() {
        let of = |network: u32, length: u32| {
            let at = move |iteration| {
                let [train_mse, validation_mse, test_mse, damping] = [1.0; 4];
                EpochMessage { network, iteration, train_mse, validation_mse, test_mse, damping }
            };
            (0..length).map(at)
        };
        let short: Vec<_> = of(0, 1500).chain(of(1, 40)).collect();
        assert_eq!(thinned(short.clone(), &[7, 3]), short);
        let long: Vec<_> = of(0, 10_000).chain(of(1, 40)).collect();
        let shown = thinned(long, &[1234, 3]);
        let of_first: Vec<_> = shown.iter().filter(|at| at.network == 0).map(|at| at.iteration).collect();
        assert!((SHOWN..SHOWN + SHOWN / 5).contains(&of_first.len()), "{}", of_first.len());
        assert!([0, 1234, 9999].iter().all(|at| of_first.contains(at)));
        assert_eq!(shown.len() - of_first.len(), 40);
    }
}
