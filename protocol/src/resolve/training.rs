//! The settings of a training, checked for as many samples as there will be.

use manduca_numerics::surrogate::process::MOST_POINTS;
use manduca_numerics::surrogate::{self, Part, TrainError, TrainSettings, check_sizes};

use super::{Faults, MAX_ENSEMBLE, MAX_NEURONS};
use crate::problem::FieldProblem;
use crate::study::{Features, SurrogateKind, SurrogateSpec, TrainMethod};

/// Checks the settings of a surrogate on their own, for `samples` samples.
///
/// # Errors
/// Every fault with its JSON pointer.
pub fn surrogate(spec: &SurrogateSpec, samples: u32, seed: u64) -> Result<TrainSettings, Vec<FieldProblem>> {
    let mut faults = Faults::default();
    let settings = surrogate_at(spec, samples, seed, &mut faults);
    faults.finish(settings)
}

/// The settings of a training on so many samples; none of a study without samples.
pub(super) fn surrogate_at(spec: &SurrogateSpec, samples: u32, seed: u64, faults: &mut Faults) -> TrainSettings {
    faults.within("/surrogate/neurons", spec.neurons.into(), 1.0, MAX_NEURONS.into());
    faults.within("/surrogate/ensemble", spec.ensemble.into(), 1.0, MAX_ENSEMBLE.into());
    faults.within("/surrogate/max_iterations", spec.max_iterations.into(), 1.0, 10_000.0);
    faults.within("/surrogate/patience", spec.patience.into(), 1.0, 1_000.0);
    let before = faults.count();
    faults.within("/surrogate/train_share", spec.train_share, 0.1, 0.98);
    faults.within("/surrogate/validation_share", spec.validation_share, 0.01, 0.5);
    let settings = TrainSettings {
        neurons: spec.neurons as usize,
        max_iterations: spec.max_iterations as usize,
        patience: spec.patience as usize,
        train_share: spec.train_share,
        validation_share: spec.validation_share,
        seed,
        method: match spec.method {
            TrainMethod::VariableProjection => surrogate::Method::VariableProjection,
            TrainMethod::LevenbergMarquardt => surrogate::Method::LevenbergMarquardt,
        },
        features: match spec.features {
            Features::Physical => surrogate::Features::Physical,
            Features::Paper => surrogate::Features::Paper,
        },
        ensemble: spec.ensemble as usize,
    };
    if samples > 0 && faults.count() == before {
        check_split(spec, &settings, samples, faults);
    }
    settings
}

/// Refuses a split with which the training would fail, by the training's own rules.
fn check_split(spec: &SurrogateSpec, settings: &TrainSettings, samples: u32, faults: &mut Faults) {
    let [train, validation, _] = match check_sizes(samples as usize, settings) {
        Ok(sizes) => sizes,
        Err(error) => {
            let validation = matches!(error, TrainError::TooFewSamples { part: Part::Validation, .. });
            let field = if validation { "validation_share" } else { "train_share" };
            return faults.add(format!("/surrogate/{field}"), error.to_string());
        }
    };
    let fitted = train + validation;
    if spec.kind == SurrogateKind::GaussianProcess && fitted > MOST_POINTS {
        let why = format!("a gaussian process takes at most {MOST_POINTS} samples; {fitted} would be fitted");
        faults.add("/surrogate/kind", why);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pointers(samples: u32, shares: (f64, f64), kind: SurrogateKind) -> Vec<String> {
        let (train_share, validation_share) = shares;
        let spec = SurrogateSpec { kind, train_share, validation_share, ..SurrogateSpec::default() };
        let faults = surrogate(&spec, samples, 1).err().unwrap_or_default();
        faults.into_iter().map(|fault| fault.pointer).collect()
    }

    #[test]
    fn a_split_which_training_refuses_is_a_fault_of_its_share() {
        let network = |samples, shares| pointers(samples, shares, SurrogateKind::Network);
        let (train, validation) = (["/surrogate/train_share"], ["/surrogate/validation_share"]);
        assert_eq!(network(20, (0.8, 0.1)), [""; 0]);
        assert_eq!(network(20, (0.94, 0.01)), validation);
        assert_eq!(network(20, (0.9, 0.06)), validation);
        assert_eq!(network(149, (0.9, 0.01)), validation);
        assert_eq!(network(150, (0.9, 0.01)), [""; 0]);
        // One sample would be left for testing, none, fewer than none.
        for shares in [(0.85, 0.1), (0.9, 0.1), (0.98, 0.5)] {
            assert_eq!(network(20, shares), train, "{shares:?}");
        }
        // A study without samples trains nothing.
        assert_eq!(network(0, (0.98, 0.5)), [""; 0]);
        assert_eq!(network(20, (1.0, 0.1)), train);
    }

    #[test]
    fn a_process_is_counted_as_it_is_fitted() {
        let process = |samples| pointers(samples, (0.8, 0.1), SurrogateKind::GaussianProcess);
        assert_eq!((process(5555).len(), process(5556)), (0, vec!["/surrogate/kind".to_owned()]));
        assert_eq!(pointers(20, (0.94, 0.01), SurrogateKind::GaussianProcess), ["/surrogate/validation_share"]);
    }
}
