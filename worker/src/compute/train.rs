//! The network, trained.

use std::ops::ControlFlow;

use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_numerics::surrogate::{self, Epoch, Errors, Network, Sample, Stop};
use manduca_protocol::resolve;
use manduca_protocol::task::{
    BoundsMessage, EpochMessage, ErrorsMessage, NetworkMessage, Progress, TrainResult, TrainTask,
};

use super::{ComputeError, bounds, finite, scaled};

/// Trains the network of a task on its dataset.
pub(super) fn train(task: &TrainTask, report: &mut dyn FnMut(Progress)) -> Result<TrainResult, ComputeError> {
    let count = u32::try_from(task.dataset.len()).unwrap_or(u32::MAX);
    let settings = resolve::surrogate(&task.surrogate, count, task.seed).map_err(ComputeError::Refused)?;
    let samples: Vec<Sample> = task.dataset.iter().map(|s| Sample { x: s.x, y: s.y }).collect();
    let total = settings.max_iterations as u64;
    let mut hear = |epoch: &Epoch| {
        let note = format!("iteration {}, validation error {:.1e}", epoch.iteration, epoch.validation_mse);
        report(Progress { done: epoch.iteration as u64, total, note });
        ControlFlow::Continue(())
    };
    let training = surrogate::train(&samples, &bounds(&task.bounds), &settings, &mut hear)
        .map_err(|e| ComputeError::Failed(e.to_string()))?;
    let curve: Vec<_> = training.curve.iter().map(epoch).collect();
    finite(curve.iter().flat_map(|e| [e.train_mse, e.validation_mse, e.test_mse]))?;
    Ok(TrainResult {
        network: network(&training.network)?,
        curve,
        best_iteration: count_of(training.best_iteration),
        stopped: match training.stopped {
            Stop::Validation => "the validation error no longer fell".into(),
            Stop::MaxIterations => "all iterations were made".into(),
            Stop::Gradient => "the gradient vanished".into(),
            Stop::Damping => "no step made the error smaller".into(),
            Stop::Interrupted => "interrupted".into(),
        },
        train: errors(&training.train)?,
        validation: errors(&training.validation)?,
        test: errors(&training.test)?,
        solver_version: SOLVER_VERSION.into(),
    })
}

fn count_of(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

fn epoch(e: &Epoch) -> EpochMessage {
    EpochMessage {
        iteration: count_of(e.iteration),
        train_mse: e.train_mse,
        validation_mse: e.validation_mse,
        test_mse: e.test_mse,
    }
}

/// An output which never varies correlates with nothing: that is zero, not an error.
fn errors(e: &Errors) -> Result<ErrorsMessage, ComputeError> {
    finite(e.rmse)?;
    let correlation = e.correlation.map(|r| if r.is_finite() { r } else { 0.0 });
    Ok(ErrorsMessage { rmse: scaled(e.rmse), correlation: scaled(correlation), count: count_of(e.count) })
}

fn network(n: &Network) -> Result<NetworkMessage, ComputeError> {
    let all = [&n.hidden_weights[..], &n.hidden_biases, &n.output_weights, &n.output_biases];
    finite(all.into_iter().flatten().copied())?;
    Ok(NetworkMessage {
        bounds: BoundsMessage { lower: n.bounds.lower, upper: n.bounds.upper },
        hidden_weights: n.hidden_weights.clone(),
        hidden_biases: n.hidden_biases.clone(),
        output_weights: n.output_weights.clone(),
        output_biases: n.output_biases,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use manduca_numerics::parameters::Bounds;
    use manduca_numerics::sampling;
    use manduca_protocol::study::SurrogateSpec;
    use manduca_protocol::task::TrainSample;

    fn task(samples: u64) -> TrainTask {
        let bounds = Bounds::default();
        let sample = |i| {
            let x = sampling::sample(&bounds, 3, i, &|_| true).unwrap();
            let u = bounds.to_unit(&x);
            TrainSample { x, y: [u[0], u[1] - u[2], u[3] * u[4], 1.0 + u[5]] }
        };
        TrainTask {
            surrogate: SurrogateSpec { neurons: 6, max_iterations: 20, ..SurrogateSpec::default() },
            seed: 5,
            bounds: BoundsMessage { lower: bounds.lower, upper: bounds.upper },
            dataset: (0..samples).map(sample).collect(),
        }
    }

    #[test]
    fn a_training_learns_reports_and_keeps_its_shape() {
        let mut heard = Vec::new();
        let result = train(&task(120), &mut |at| heard.push(at)).unwrap();
        assert_eq!((result.network.hidden_weights.len(), result.network.output_weights.len()), (60, 24));
        assert_eq!(result.train.count + result.validation.count + result.test.count, 120);
        assert!(result.test.rmse.lift < 0.05, "{:?}", result.test);
        assert!(!heard.is_empty() && heard.iter().all(|at| at.total == 20));
        assert!(!result.curve.is_empty());
    }

    #[test]
    fn what_makes_no_sense_is_refused_by_field() {
        let mut bad = task(120);
        bad.surrogate.neurons = 0;
        let error = train(&bad, &mut |_| {}).unwrap_err().to_string();
        assert!(error.contains("/surrogate/neurons"), "{error}");
    }
}
