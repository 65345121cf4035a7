//! Results are checked, serialised and compressed before they queue for the
//! writer, whose time all workers share.

use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::search::{SearchNext, SearchResult};
use manduca_protocol::study::SurrogateKind;
use manduca_protocol::task::{JobKind, JobResult, SimulateOutcome, TrainCheckpoint, TrainResult};
use manduca_protocol::view::{SearchView, SurrogateView};
use manduca_protocol::worker::Completion;

use crate::error::ApiError;
use crate::store::{Outcome, Prepared, pack};
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
    let (kind, json, summary) = match result {
        JobResult::Simulate(result) => (JobKind::Simulate, to_json(&*result)?, None),
        JobResult::Optimise(result) => (JobKind::Optimise, to_json(&*result)?, None),
        JobResult::Search(result) => {
            let json = to_json(&*result)?;
            (JobKind::Search, json, Some(to_text(&standing(*result))?))
        }
        JobResult::Train(result) => {
            let json = to_json(&*result)?;
            (JobKind::Train, json, Some(to_text(&summary(*result))?))
        }
    };
    let digest = *blake3::hash(&json).as_bytes();
    let body = pack(json).map_err(internal)?;
    Ok(Prepared { job, attempt, kind, outcome, flown, digest, body, summary, provenance })
}

fn to_json(value: &impl serde::Serialize) -> Result<Vec<u8>, ApiError> {
    serde_json::to_vec(value).map_err(internal)
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

/// A training without its weights.
fn summary(result: TrainResult) -> SurrogateView {
    let neurons = result.surrogate.networks.first().map_or(0, |n| n.hidden_biases.len());
    let process = result.surrogate.process.is_some();
    SurrogateView {
        kind: if process { SurrogateKind::GaussianProcess } else { SurrogateKind::Network },
        neurons: u32::try_from(neurons).unwrap_or(u32::MAX),
        curve: result.curve,
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
    let best_iterations = at.members.iter().map(|m| m.best_iteration).collect();
    let stops = at.members.iter().map(|m| m.stopped.clone()).collect();
    let curve = at.members.into_iter().flat_map(|m| m.curve).chain(at.curve).collect();
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
