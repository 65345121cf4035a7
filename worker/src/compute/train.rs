//! The surrogate, trained.

use std::ops::ControlFlow;

use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_numerics::surrogate::process::{self, FitProgress};
use manduca_numerics::surrogate::{self, Checkpoint, Dataset, Errors, Sample, TrainError, TrainSettings, Training};
use manduca_protocol::study::SurrogateKind;
use manduca_protocol::task::{self, ErrorsMessage, FitCheckpoint, Progress, TrainResult, TrainTask};
use manduca_protocol::{network, resolve};

use super::{ComputeError, Listener, bounds, finite, scaled};

/// Trains the surrogate of a task on its dataset, from where an earlier attempt stood.
pub(super) fn train(task: &TrainTask, listener: &mut dyn Listener) -> Result<TrainResult, ComputeError> {
    let count = u32::try_from(task.dataset.len()).unwrap_or(u32::MAX);
    let settings = resolve::surrogate(&task.surrogate, count, task.seed).map_err(ComputeError::Refused)?;
    let insect = resolve::model(&task.model, "/model").map_err(ComputeError::Refused)?.insect;
    let samples: Vec<Sample> = task.dataset.iter().map(|s| Sample { x: s.x, y: s.y, se: s.se }).collect();
    let bounds = bounds(&task.bounds);
    let data = Dataset { samples: &samples, bounds: &bounds, insect: &insect };
    if task.surrogate.kind == SurrogateKind::GaussianProcess {
        return fit(&data, &settings, task.fit.as_deref(), listener);
    }
    let start = task.checkpoint.as_ref().and_then(|at| network::checkpoint(at).ok());
    let training = match run(&data, &settings, start, listener) {
        // What an earlier attempt left is a help, never a condition.
        Err(TrainError::Checkpoint(_)) => run(&data, &settings, None, listener),
        done => done,
    };
    result(&training.map_err(|e| ComputeError::Failed(e.to_string()))?)
}

/// The likeliest gaussian process, after the ascents which an earlier attempt has ended.
fn fit(
    data: &Dataset<'_>,
    settings: &TrainSettings,
    start: Option<&FitCheckpoint>,
    listener: &mut dyn Listener,
) -> Result<TrainResult, ComputeError> {
    let mut hear = |at: &FitProgress<'_>| {
        let (done, total) = (at.ascent as u64, at.ascents as u64);
        let note = format!("iteration {}, log likelihood {:.1}", at.iteration, at.likelihood);
        listener.progress(Progress { done, total, note });
        if !at.ended.is_empty() {
            listener.checkpoint(&|| task::Checkpoint::Fit(network::fit_message(at.ended)));
        }
        ControlFlow::Continue(())
    };
    let start = start.map(network::fit).unwrap_or_default();
    let found = process::fit(data, settings, start, &mut hear).map_err(|e| ComputeError::Failed(e.to_string()))?;
    Ok(TrainResult {
        surrogate: (&found.surrogate).into(),
        curve: Vec::new(),
        best_iterations: found.ascents.iter().map(|a| count_of(a.iterations)).collect(),
        stops: found.ascents.iter().map(|a| network::climbed(a.stop).into()).collect(),
        train: errors(&found.train)?,
        validation: errors(&found.validation)?,
        test: errors(&found.test)?,
        solver_version: SOLVER_VERSION.into(),
    })
}

fn run(
    data: &Dataset<'_>,
    settings: &TrainSettings,
    start: Option<Checkpoint>,
    listener: &mut dyn Listener,
) -> Result<Training, TrainError> {
    let most = settings.max_iterations as u64;
    let total = most * settings.ensemble as u64;
    let mut hear = |at: &Checkpoint| {
        if let Some(epoch) = at.curve.last() {
            let of = match settings.ensemble {
                1 => String::new(),
                n => format!("network {} of {n}, ", at.members.len() + 1),
            };
            let note = format!("{of}iteration {}, validation error {:.1e}", epoch.iteration, epoch.validation_mse);
            let done = most * at.members.len() as u64 + epoch.iteration as u64;
            listener.progress(Progress { done, total, note });
        }
        listener.checkpoint(&|| task::Checkpoint::Train(Box::new(network::checkpoint_message(at))));
        ControlFlow::Continue(())
    };
    surrogate::train(data, settings, start, &mut hear)
}

fn result(training: &Training) -> Result<TrainResult, ComputeError> {
    let members = training.members.iter().enumerate();
    let curve: Vec<_> = members.flat_map(|(of, m)| network::curve(of, &m.curve)).collect();
    finite(curve.iter().flat_map(|e| [e.train_mse, e.validation_mse, e.test_mse, e.damping]))?;
    for n in training.surrogate.members() {
        let all = [&n.hidden_weights[..], &n.hidden_biases, &n.output_weights, &n.output_biases];
        finite(all.into_iter().flatten().copied())?;
    }
    Ok(TrainResult {
        surrogate: (&training.surrogate).into(),
        curve,
        best_iterations: training.members.iter().map(|m| count_of(m.best_iteration)).collect(),
        stops: training.members.iter().map(|m| network::stopped(m.stopped).into()).collect(),
        train: errors(&training.train)?,
        validation: errors(&training.validation)?,
        test: errors(&training.test)?,
        solver_version: SOLVER_VERSION.into(),
    })
}

fn count_of(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

/// An output which never varies correlates with nothing: that is zero, not an error.
fn errors(e: &Errors) -> Result<ErrorsMessage, ComputeError> {
    finite(e.rmse)?;
    let correlation = e.correlation.map(|r| if r.is_finite() { r } else { 0.0 });
    Ok(ErrorsMessage { rmse: scaled(e.rmse), correlation: scaled(correlation), count: count_of(e.count) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use manduca_numerics::parameters::Bounds;
    use manduca_numerics::sampling;
    use manduca_protocol::study::{Features, ModelSpec, SurrogateSpec};
    use manduca_protocol::task::{BoundsMessage, TrainCheckpoint, TrainSample};

    /// Hears everything.
    #[derive(Default)]
    struct All {
        progress: Vec<Progress>,
        checkpoints: Vec<TrainCheckpoint>,
        fits: Vec<FitCheckpoint>,
    }

    impl Listener for All {
        fn progress(&mut self, at: Progress) {
            self.progress.push(at);
        }

        fn checkpoint(&mut self, make: &dyn Fn() -> task::Checkpoint) {
            match make() {
                task::Checkpoint::Train(at) => self.checkpoints.push(*at),
                task::Checkpoint::Fit(at) => self.fits.push(at),
            }
        }
    }

    fn task(samples: u64) -> TrainTask {
        let bounds = Bounds::default();
        let sample = |i| {
            let x = sampling::sample(&bounds, 3, i, &|_| true).unwrap();
            let u = bounds.to_unit(&x);
            TrainSample { x, y: [u[0], u[1] - u[2], u[3] * u[4], 1.0 + u[5]], se: [0.0; 4] }
        };
        TrainTask {
            surrogate: SurrogateSpec {
                neurons: 6,
                max_iterations: 20,
                features: Features::Paper,
                ..SurrogateSpec::default()
            },
            seed: 5,
            bounds: BoundsMessage { lower: bounds.lower, upper: bounds.upper },
            dataset: (0..samples).map(sample).collect(),
            model: ModelSpec::default(),
            checkpoint: None,
            fit: None,
        }
    }

    #[test]
    fn a_training_learns_reports_and_keeps_its_shape() {
        let mut heard = All::default();
        let result = train(&task(120), &mut heard).unwrap();
        let [network] = &result.surrogate.networks[..] else { panic!("one network") };
        assert_eq!((network.hidden_weights.len(), network.output_weights.len()), (60, 24));
        assert_eq!(result.train.count + result.validation.count + result.test.count, 120);
        assert!(result.test.rmse.lift < 0.05, "{:?}", result.test);
        assert!(!heard.progress.is_empty() && heard.progress.iter().all(|at| at.total == 20));
        assert_eq!(heard.checkpoints.last().unwrap().curve, result.curve);
    }

    #[test]
    fn an_attempt_goes_on_from_a_checkpoint_and_past_a_bad_one() {
        let mut heard = All::default();
        let whole = train(&task(120), &mut heard).unwrap();
        let mut second = task(120);
        second.checkpoint = Some(Box::new(heard.checkpoints[3].clone()));
        let mut after = All::default();
        assert_eq!(train(&second, &mut after).unwrap(), whole);
        assert_eq!(after.checkpoints[..], heard.checkpoints[3..]);
        let at = second.checkpoint.as_mut().unwrap();
        at.curve.clear();
        assert_eq!(train(&second, &mut All::default()).unwrap(), whole);
        second.checkpoint.as_mut().unwrap().best.hidden_biases.pop();
        assert_eq!(train(&second, &mut All::default()).unwrap(), whole);
    }

    #[test]
    fn a_gaussian_process_is_fitted_in_place_of_networks() {
        let mut task = task(120);
        task.surrogate.kind = SurrogateKind::GaussianProcess;
        let mut heard = All::default();
        let result = train(&task, &mut heard).unwrap();
        assert!(result.surrogate.networks.is_empty() && result.curve.is_empty());
        assert_eq!(result.surrogate.process.as_ref().unwrap().points.len(), 108);
        assert_eq!((result.best_iterations.len(), result.test.count), (4, 12));
        assert!(result.test.rmse.lift < 0.01 && result.test.rmse.pitch_moment < 0.02, "{:?}", result.test);
        assert!(!heard.progress.is_empty() && heard.checkpoints.is_empty());

        let left = heard.fits.iter().find(|at| at.ascents.len() == 3).unwrap();
        task.fit = Some(Box::new(left.clone()));
        let mut after = All::default();
        assert_eq!(train(&task, &mut after).unwrap(), result);
        assert_eq!(after.progress[0].done, 3);
        task.fit.as_mut().unwrap().ascents[1].stopped = "for a reason not known here".into();
        assert_eq!(train(&task, &mut All::default()).unwrap(), result);
    }

    #[test]
    fn what_makes_no_sense_is_refused_by_field() {
        let mut bad = task(120);
        bad.surrogate.neurons = 0;
        let error = train(&bad, &mut All::default()).unwrap_err().to_string();
        assert!(error.contains("/surrogate/neurons"), "{error}");
    }
}
