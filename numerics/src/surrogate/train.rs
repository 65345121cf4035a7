//! Training with early stopping.

use super::initial::{self, Split};
use super::kernel::scaled;
use super::levenberg::{Levenberg, Outcome};
use super::network::bad_bounds;
use super::normal::{Data, Normal};
use super::{Network, Sample};
use crate::parameters::{Bounds, COUNT, OUTPUTS, Point};
use std::ops::ControlFlow;

/// Most neurons accepted: 2000 already need 5 GiB of memory.
const MOST_NEURONS: usize = 2000;

/// Fewest samples in each part of the split.
const FEWEST: usize = 2;

/// Stop when the gradient of the mean squared error is below (`trainlm`: min_grad).
const LEAST_GRADIENT: f64 = 1e-7;

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
}

impl Default for TrainSettings {
    /// 10-500-4 and 80/10/10 as in the paper; patience as MATLAB's `max_fail`.
    fn default() -> Self {
        Self { neurons: 500, max_iterations: 200, patience: 6, train_share: 0.8, validation_share: 0.1, seed: 0 }
    }
}

/// Where training stood after an iteration; errors are means over samples and
/// outputs of the squared residual of the scaled values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Epoch {
    /// Iterations done; 0 is the start.
    pub iteration: usize,
    /// Mean squared error of the training samples.
    pub train_mse: f64,
    /// Mean squared error of the validation samples.
    pub validation_mse: f64,
    /// Mean squared error of the test samples.
    pub test_mse: f64,
    /// Damping mu which the next step will try first.
    pub damping: f64,
}

/// How a network errs on some samples, per output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Errors {
    /// Root of the mean squared error, scaled units.
    pub rmse: [f64; 4],
    /// Pearson correlation of prediction and target; 0 where either is constant.
    pub correlation: [f64; 4],
    /// How many samples.
    pub count: usize,
}

/// Why training ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// The validation error did not improve for `patience` iterations.
    Validation,
    /// The most iterations were done.
    MaxIterations,
    /// The gradient vanished: a minimum.
    Gradient,
    /// No damping gave a better step.
    Damping,
    /// The observer asked to stop.
    Interrupted,
}

/// A trained network and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Training {
    /// The network with the smallest validation error met.
    pub network: Network,
    /// One entry per iteration, the start first.
    pub curve: Vec<Epoch>,
    /// The iteration `network` is from.
    pub best_iteration: usize,
    /// Why training ended.
    pub stopped: Stop,
    /// Errors of `network` on the training samples.
    pub train: Errors,
    /// Errors of `network` on the validation samples.
    pub validation: Errors,
    /// Errors of `network` on the test samples.
    pub test: Errors,
    /// Which sample served for what.
    pub split: Split,
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
        part: &'static str,
        /// How many it would hold.
        found: usize,
    },
    /// A sample holds NaN, infinity or a number too large to square.
    #[error("sample {index} holds a number which is not finite")]
    NotFinite {
        /// Place of the sample.
        index: usize,
    },
    /// An output is the same in every training sample, so there is nothing to learn.
    #[error("output {output} is the same in every training sample")]
    ConstantOutput {
        /// Name of the output.
        output: &'static str,
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
    /// Every parameter is held, so there is nothing to vary.
    #[error("every parameter is held")]
    NothingFree,
}

/// Trains a network on samples by Levenberg-Marquardt with early stopping.
///
/// The weights fit the training part; after every iteration the validation part
/// judges, and the network with its smallest error is what comes back. The
/// observer sees each iteration, the start included, and may stop the training.
/// The result depends on the samples and the settings alone, not on threads.
///
/// # Errors
/// When there is nothing sound to train on; see [`TrainError`].
pub fn train(
    samples: &[Sample],
    bounds: &Bounds,
    settings: &TrainSettings,
    observe: &mut dyn FnMut(&Epoch) -> ControlFlow<()>,
) -> Result<Training, TrainError> {
    let split = checked_split(samples, bounds, settings)?;
    let means = means(samples, &split.train)?;
    let parts = [&split.train, &split.validation, &split.test].map(|p| Part::new(samples, p));
    let free: Vec<usize> = (0..COUNT).filter(|&i| !bounds.is_held(i)).collect();
    let rows: Vec<Point> = parts[0].xs.iter().map(|x| scaled(bounds, x)).collect();
    let inputs = free.iter().map(|&i| rows.iter().map(|z| z[i]).collect()).collect();
    let mut model = Normal::new(Data { free, inputs, targets: parts[0].ys.clone() }, settings.neurons);

    let start = initial::nguyen_widrow(bounds, settings.neurons, means, settings.seed);
    let (curve, network, stopped) = descend(start, &mut model, &parts, settings, observe);
    let best_iteration = best(&curve);
    let [train, validation, test] = parts.map(|p| errors_of(&p.predict(&network), &p.ys));
    Ok(Training { network, curve, best_iteration, stopped, train, validation, test, split })
}

/// The iteration with the smallest validation error, the first of equals.
fn best(curve: &[Epoch]) -> usize {
    let mut best = 0;
    for (i, epoch) in curve.iter().enumerate() {
        if epoch.validation_mse < curve[best].validation_mse {
            best = i;
        }
    }
    best
}

/// Iterates until a reason to stop; returns the curve and the best network.
fn descend(
    start: Network,
    model: &mut Normal,
    parts: &[Part; 3],
    settings: &TrainSettings,
    observe: &mut dyn FnMut(&Epoch) -> ControlFlow<()>,
) -> (Vec<Epoch>, Network, Stop) {
    let scale = (4 * parts[0].ys.len()) as f64;
    let mut best_network = start.clone();
    let squares = parts[0].squares(&start);
    let mut state = Levenberg::new(start, squares);
    let mut curve: Vec<Epoch> = Vec::new();
    let (mut best, mut failures) = (f64::INFINITY, 0);
    loop {
        let epoch = Epoch {
            iteration: curve.len(),
            train_mse: state.squares / scale,
            validation_mse: parts[1].mse(&state.network),
            test_mse: parts[2].mse(&state.network),
            damping: state.damping,
        };
        curve.push(epoch);
        if epoch.validation_mse < best {
            (best, failures) = (epoch.validation_mse, 0);
            best_network.clone_from(&state.network);
        } else {
            failures += 1;
        }
        let stop = if observe(&epoch).is_break() {
            Some(Stop::Interrupted)
        } else if failures > 0 && failures >= settings.patience {
            Some(Stop::Validation)
        } else if epoch.iteration >= settings.max_iterations {
            Some(Stop::MaxIterations)
        } else {
            // The gradient of the mean is 2 / (4 N) times that of half the sum.
            let least = LEAST_GRADIENT * scale / 2.0;
            match state.iterate(model, least, &mut |net| parts[0].squares(net)) {
                Outcome::Moved => None,
                Outcome::Flat => Some(Stop::Gradient),
                Outcome::Stuck => Some(Stop::Damping),
            }
        };
        if let Some(stop) = stop {
            return (curve, best_network, stop);
        }
    }
}

/// One part of the split, copied together.
struct Part {
    xs: Vec<Point>,
    ys: Vec<[f64; 4]>,
}

impl Part {
    fn new(samples: &[Sample], indices: &[usize]) -> Self {
        Self {
            xs: indices.iter().map(|&i| samples[i].x).collect(),
            ys: indices.iter().map(|&i| samples[i].y).collect(),
        }
    }

    fn predict(&self, net: &Network) -> Vec<[f64; 4]> {
        let mut out = vec![[0.0; 4]; self.xs.len()];
        net.predict_into(&self.xs, &mut out);
        out
    }

    /// Sum over samples and outputs of the squared residual, in sample order.
    fn squares(&self, net: &Network) -> f64 {
        let found = self.predict(net);
        let residuals = found.iter().flatten().zip(self.ys.iter().flatten());
        residuals.map(|(f, y)| (f - y) * (f - y)).sum()
    }

    fn mse(&self, net: &Network) -> f64 {
        self.squares(net) / (4 * self.ys.len()) as f64
    }
}

/// Checks everything training relies on and splits the samples.
fn checked_split(samples: &[Sample], bounds: &Bounds, settings: &TrainSettings) -> Result<Split, TrainError> {
    if let Some(index) = bad_bounds(bounds) {
        return Err(TrainError::Bounds { index });
    }
    if (0..COUNT).all(|i| bounds.is_held(i)) {
        return Err(TrainError::NothingFree);
    }
    if !(1..=MOST_NEURONS).contains(&settings.neurons) {
        return Err(TrainError::Neurons { neurons: settings.neurons });
    }
    let (train, validation) = (settings.train_share, settings.validation_share);
    if !(train > 0.0 && validation > 0.0 && train + validation < 1.0) {
        return Err(TrainError::Shares { train, validation });
    }
    let sound = |v: &f64| v.is_finite() && v.abs() < 1e100;
    if let Some(index) = samples.iter().position(|s| !s.x.iter().chain(&s.y).all(sound)) {
        return Err(TrainError::NotFinite { index });
    }
    let split = initial::split(samples.len(), train, validation, settings.seed);
    let parts = [("training", &split.train), ("validation", &split.validation), ("testing", &split.test)];
    for (part, indices) in parts {
        if indices.len() < FEWEST {
            let found = indices.len();
            return Err(TrainError::TooFewSamples { samples: samples.len(), part, found });
        }
    }
    Ok(split)
}

/// Mean of each output over the training samples, refusing constant ones.
fn means(samples: &[Sample], train: &[usize]) -> Result<[f64; 4], TrainError> {
    let mut means = [0.0; 4];
    for (k, mean) in means.iter_mut().enumerate() {
        let first = samples[train[0]].y[k];
        if train.iter().all(|&i| samples[i].y[k] == first) {
            return Err(TrainError::ConstantOutput { output: OUTPUTS[k].0 });
        }
        *mean = train.iter().map(|&i| samples[i].y[k]).sum::<f64>() / train.len() as f64;
    }
    Ok(means)
}

/// Errors of a network on samples it may never have seen.
pub fn errors(network: &Network, samples: &[Sample]) -> Errors {
    let all: Vec<usize> = (0..samples.len()).collect();
    let part = Part::new(samples, &all);
    errors_of(&part.predict(network), &part.ys)
}

fn errors_of(found: &[[f64; 4]], targets: &[[f64; 4]]) -> Errors {
    let n = found.len().max(1) as f64;
    let mut errors = Errors { rmse: [0.0; 4], correlation: [0.0; 4], count: found.len() };
    for k in 0..4 {
        let (mut f_mean, mut t_mean) = (0.0, 0.0);
        for (f, t) in found.iter().zip(targets) {
            f_mean += f[k] / n;
            t_mean += t[k] / n;
        }
        let [mut squares, mut ff, mut tt, mut ft] = [0.0; 4];
        for (f, t) in found.iter().zip(targets) {
            let (a, b) = (f[k] - f_mean, t[k] - t_mean);
            squares += (f[k] - t[k]) * (f[k] - t[k]);
            (ff, tt, ft) = (a.mul_add(a, ff), b.mul_add(b, tt), a.mul_add(b, ft));
        }
        errors.rmse[k] = (squares / n).sqrt();
        let spread = ff.sqrt() * tt.sqrt();
        errors.correlation[k] = if spread > 0.0 { (ft / spread).clamp(-1.0, 1.0) } else { 0.0 };
    }
    errors
}
