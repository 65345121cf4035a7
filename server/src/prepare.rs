//! Results are checked, serialised and compressed before they queue for the
//! writer, whose time all workers share.

use manduca_numerics::parameters::Bounds;
use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_numerics::surrogate::Network;
use manduca_protocol::search::SearchNext;
use manduca_protocol::task::{JobKind, JobResult, NetworkMessage, SimulateOutcome, TrainResult};
use manduca_protocol::view::SurrogateView;
use manduca_protocol::worker::Completion;

use crate::error::ApiError;
use crate::store::{Outcome, Prepared, STROKES, pack};

/// A result as it goes into the store.
///
/// # Errors
/// When it cannot be serialised or compressed, which is a fault of the coordinator.
pub(crate) fn prepare(completion: Completion) -> Result<Prepared, ApiError> {
    let Completion { job, attempt, result, provenance } = completion;
    let outcome = outcome(&result);
    let (kind, json, summary) = match result {
        JobResult::Simulate(result) => (JobKind::Simulate, to_json(&*result)?, None),
        JobResult::Optimise(result) => (JobKind::Optimise, to_json(&*result)?, None),
        JobResult::Search(result) => (JobKind::Search, to_json(&*result)?, None),
        JobResult::Train(result) => {
            let json = to_json(&*result)?;
            let summary = String::from_utf8(to_json(&summary(*result))?).map_err(internal)?;
            (JobKind::Train, json, Some(summary))
        }
    };
    let digest = *blake3::hash(&json).as_bytes();
    let body = pack(json).map_err(internal)?;
    Ok(Prepared { job, attempt, kind, outcome, digest, body, summary, provenance })
}

fn to_json(value: &impl serde::Serialize) -> Result<Vec<u8>, ApiError> {
    serde_json::to_vec(value).map_err(internal)
}

fn internal(error: impl std::error::Error + Send + Sync + 'static) -> ApiError {
    ApiError::Internal(Box::new(error))
}

/// What a result makes of its job. Registration has compared the versions, but
/// the result is what counts.
fn outcome(result: &JobResult) -> Outcome {
    let version = match result {
        JobResult::Simulate(r) => &r.solver_version,
        JobResult::Train(r) => &r.solver_version,
        JobResult::Optimise(r) => &r.solver_version,
        JobResult::Search(r) => &r.solver_version,
    };
    if version != SOLVER_VERSION {
        return Outcome::Unusable(format!("computed by solver version `{version}`, not `{SOLVER_VERSION}`"));
    }
    match result {
        JobResult::Simulate(r) => match &r.outcome {
            SimulateOutcome::Ok { .. } => Outcome::Succeeded,
            SimulateOutcome::Infeasible { reason } => Outcome::Infeasible(reason.clone()),
        },
        JobResult::Train(r) => match network(&r.network) {
            Ok(_) => Outcome::Succeeded,
            Err(why) => Outcome::Unusable(format!("not a network: {why}")),
        },
        JobResult::Optimise(_) => Outcome::Succeeded,
        JobResult::Search(r) => match &r.next {
            SearchNext::Fly { strokes, .. } if strokes.is_empty() || strokes.len() > STROKES as usize => {
                Outcome::Unusable(format!("asks for {} strokes; 1 to {STROKES} are possible", strokes.len()))
            }
            _ => Outcome::Succeeded,
        },
    }
}

/// The network of a message.
///
/// # Errors
/// A sentence, when its arrays do not fit together.
pub(crate) fn network(message: &NetworkMessage) -> Result<Network, String> {
    Network::new_checked(
        Bounds { lower: message.bounds.lower, upper: message.bounds.upper },
        message.hidden_weights.clone(),
        message.hidden_biases.clone(),
        message.output_weights.clone(),
        message.output_biases,
    )
    .map_err(|e| e.to_string())
}

/// A training without its weights.
fn summary(result: TrainResult) -> SurrogateView {
    SurrogateView {
        neurons: u32::try_from(result.network.hidden_biases.len()).unwrap_or(u32::MAX),
        curve: result.curve,
        best_iteration: result.best_iteration,
        stopped: result.stopped,
        train: result.train,
        validation: result.validation,
        test: result.test,
    }
}
