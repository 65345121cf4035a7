//! How to train, and what cannot be trained on.

use super::initial::{self, Split};
use super::network::bad_bounds;
use super::{Checkpoint, Features, Sample};
use crate::parameters::Bounds;

/// Most neurons accepted: 2000 already need 6 GiB of memory.
const MOST_NEURONS: usize = 2000;

/// Most networks of an ensemble.
const MOST_NETWORKS: usize = 64;

/// Fewest samples in each part of the split.
pub(super) const FEWEST: usize = 2;

/// How the weights are searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Levenberg-Marquardt on the hidden weights, the output weights always at their best
    /// (Golub & Pereyra 1973, Kaufman 1975).
    #[default]
    VariableProjection,
    /// Levenberg-Marquardt on all weights, as in the paper.
    LevenbergMarquardt,
}

/// How to train.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainSettings {
    /// Hidden neurons.
    pub neurons: usize,
    /// Most iterations.
    pub max_iterations: usize,
    /// Iterations in a row without a better validation error before stopping.
    pub patience: usize,
    /// Share of the samples the weights are fitted to, 0 to 1.
    pub train_share: f64,
    /// Share of the samples which say when to stop, 0 to 1; the rest is for testing.
    pub validation_share: f64,
    /// Seed of the split and of the first weights.
    pub seed: u64,
    /// How the weights are searched.
    pub method: Method,
    /// What the networks learn.
    pub features: Features,
    /// Networks of different first weights whose mean is the prediction.
    pub ensemble: usize,
}

impl Default for TrainSettings {
    /// 10-500-4 and 80/10/10 as in the paper; patience as MATLAB's `max_fail`.
    fn default() -> Self {
        Self {
            neurons: 500,
            max_iterations: 200,
            patience: 6,
            train_share: 0.8,
            validation_share: 0.1,
            seed: 0,
            method: Method::default(),
            features: Features::default(),
            ensemble: 1,
        }
    }
}

/// A part of the split.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// The weights are fitted to it.
    Training,
    /// It says when to stop.
    Validation,
    /// It judges the result.
    Testing,
}

impl std::fmt::Display for Part {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Training => "training",
            Self::Validation => "validation",
            Self::Testing => "testing",
        })
    }
}

/// Why there is nothing to train.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrainError {
    /// A part of the split would hold too few samples.
    #[error("{samples} samples leave only {found} for {part}; at least {FEWEST} are needed")]
    TooFewSamples {
        /// How many samples were given.
        samples: usize,
        /// Which part is too small.
        part: Part,
        /// How many it would hold.
        found: usize,
    },
    /// More samples than a gaussian process can hold.
    #[error("{samples} samples to fit; a gaussian process takes at most {}", super::process::MOST_POINTS)]
    TooManySamples {
        /// How many there are.
        samples: usize,
    },
    /// The covariances of the samples are no matrix which can be factorised.
    #[error("output {output} has samples whose covariances are singular")]
    NotPositive {
        /// Name of the output.
        output: &'static str,
    },
    /// A sample holds NaN, infinity or a number too large to square.
    #[error("sample {index} holds a number which is not finite")]
    NotFinite {
        /// Place of the sample.
        index: usize,
    },
    /// The shares are not fractions which leave something for testing.
    #[error("shares must be above 0 and below 1 together; got {train} and {validation}")]
    Shares {
        /// Share for training.
        train: f64,
        /// Share for validation.
        validation: f64,
    },
    /// The number of neurons is out of range.
    #[error("{neurons} neurons; 1 to {MOST_NEURONS} are possible")]
    Neurons {
        /// How many were asked for.
        neurons: usize,
    },
    /// The bounds are not finite and in order.
    #[error("bounds of parameter {index} are not finite and in order")]
    Bounds {
        /// Place in the parameter table.
        index: usize,
    },
    /// The number of networks is out of range.
    #[error("{ensemble} networks; 1 to {MOST_NETWORKS} are possible")]
    Ensemble {
        /// How many were asked for.
        ensemble: usize,
    },
    /// A checkpoint is of other settings or other samples.
    #[error("the checkpoint does not fit: {0}")]
    Checkpoint(&'static str),
}

/// Checks how many of `samples` samples each part of the split would hold: known before any is flown.
///
/// # Errors
/// When the shares make no split, or one with a part of fewer than two samples.
pub fn check_sizes(samples: usize, settings: &TrainSettings) -> Result<[usize; 3], TrainError> {
    checked(samples, settings, initial::sizes)
}

/// [`check_sizes`] of parts which something has cut.
fn checked(
    samples: usize,
    settings: &TrainSettings,
    cut: impl Fn(usize, f64, f64) -> [usize; 3],
) -> Result<[usize; 3], TrainError> {
    let (train, validation) = (settings.train_share, settings.validation_share);
    if !(train > 0.0 && validation > 0.0 && train + validation < 1.0) {
        return Err(TrainError::Shares { train, validation });
    }
    let sizes = cut(samples, train, validation);
    for (part, found) in [Part::Training, Part::Validation, Part::Testing].into_iter().zip(sizes) {
        if found < FEWEST {
            return Err(TrainError::TooFewSamples { samples, part, found });
        }
    }
    Ok(sizes)
}

/// Checks everything training relies on and splits the samples.
pub(crate) fn checked_split(
    samples: &[Sample],
    bounds: &Bounds,
    settings: &TrainSettings,
) -> Result<Split, TrainError> {
    if let Some(index) = bad_bounds(bounds) {
        return Err(TrainError::Bounds { index });
    }
    if !(1..=MOST_NEURONS).contains(&settings.neurons) {
        return Err(TrainError::Neurons { neurons: settings.neurons });
    }
    if !(1..=MOST_NETWORKS).contains(&settings.ensemble) {
        return Err(TrainError::Ensemble { ensemble: settings.ensemble });
    }
    let sound = |v: &f64| v.is_finite() && v.abs() < 1e100;
    if let Some(index) = samples.iter().position(|s| !s.x.iter().chain(&s.y).chain(&s.se).all(sound)) {
        return Err(TrainError::NotFinite { index });
    }
    checked(samples.len(), settings, |count, train, validation| initial::filled(count, train, validation, FEWEST))?;
    Ok(initial::split(samples.len(), settings.train_share, settings.validation_share, settings.seed))
}

/// Refuses a checkpoint which is not one of such a training.
pub(crate) fn check_checkpoint(at: &Checkpoint, inside: &Bounds, settings: &TrainSettings) -> Result<(), TrainError> {
    let fits = |net: &super::Network| net.neurons() == settings.neurons && net.bounds == *inside;
    let refused = |why| Err(TrainError::Checkpoint(why));
    if at.members.len() >= settings.ensemble {
        return refused("it has more networks than are asked for");
    }
    let members = at.members.iter().all(|m| fits(&m.network) && m.best_iteration < m.curve.len());
    if !(members && fits(&at.network) && fits(&at.best)) {
        return refused("its networks have another shape");
    }
    let numbers = [at.objective, at.damping, at.growth];
    let iterations = at.members.iter().map(|m| m.curve.len()).chain([at.curve.len()]);
    if iterations.max().unwrap_or_default() > settings.max_iterations + 1 {
        return refused("it has more iterations than are asked for");
    }
    if at.curve.is_empty() || !numbers.iter().all(|v| v.is_finite() && *v >= 0.0) {
        return refused("its numbers are none");
    }
    Ok(())
}
