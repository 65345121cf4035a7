//! Training with early stopping.

use super::errors::{Errors, errors};
use super::features::{Frame, Part};
use super::initial::{self, Split};
use super::kernel::scaled;
use super::levenberg::{Change, Levenberg, Model, Outcome};
use super::normal::Normal;
use super::products::Data;
use super::projection::Projection;
use super::settings::{Method, TrainError, TrainSettings, check_checkpoint, checked_split};
use super::{Network, Sample, Surrogate};
use crate::insect::Insect;
use crate::parameters::{Bounds, COUNT, Point};
use std::ops::ControlFlow;

/// Stop when the gradient of the mean squared error is below (`trainlm`: min_grad).
const LEAST_GRADIENT: f64 = 1e-7;

/// Where training stood after an iteration; errors are means over samples and outputs
/// of the squared residual of what the network learns (scaled outputs; with physical
/// features, at the reference frequency).
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

/// One network of an ensemble, trained.
#[derive(Debug, Clone, PartialEq)]
pub struct Member {
    /// The network with the smallest validation error met.
    pub network: Network,
    /// One entry per iteration, the start first.
    pub curve: Vec<Epoch>,
    /// The iteration `network` is from.
    pub best_iteration: usize,
    /// Why training ended.
    pub stopped: Stop,
}

/// A training after some iteration: with samples and settings, all there is to know of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    /// Networks which are done.
    pub members: Vec<Member>,
    /// Where the present one stands.
    pub network: Network,
    /// What the method makes small, there.
    pub objective: f64,
    /// Damping mu which the next step will try first.
    pub damping: f64,
    /// What the damping is multiplied by when that step is refused.
    pub growth: f64,
    /// The iterations of the present network so far, the start first.
    pub curve: Vec<Epoch>,
    /// The present network's best state.
    pub best: Network,
}

/// A trained surrogate and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Training {
    /// What predicts.
    pub surrogate: Surrogate,
    /// Its networks.
    pub members: Vec<Member>,
    /// Errors on the training samples.
    pub train: Errors,
    /// Errors on the validation samples.
    pub validation: Errors,
    /// Errors on the test samples.
    pub test: Errors,
    /// Which sample served for what.
    pub split: Split,
}

/// What is trained on: samples and where they are from.
#[derive(Debug, Clone, Copy)]
pub struct Dataset<'a> {
    /// The samples.
    pub samples: &'a [Sample],
    /// The box they were drawn from.
    pub bounds: &'a Bounds,
    /// Whose strokes they are.
    pub insect: &'a Insect,
}

/// Trains a surrogate on samples with early stopping, from the start or from a checkpoint.
///
/// The weights fit the training part; after every iteration the validation part
/// judges, and the network with its smallest error is what comes back. The
/// observer sees each iteration, the start included (or the checkpoint's), and may
/// stop the training. The result depends on the samples and the settings alone, not
/// on threads, and not on how often it was interrupted.
///
/// # Errors
/// When there is nothing sound to train on; see [`TrainError`].
pub fn train(
    data: &Dataset<'_>,
    settings: &TrainSettings,
    start: Option<Checkpoint>,
    observe: &mut dyn FnMut(&Checkpoint) -> ControlFlow<()>,
) -> Result<Training, TrainError> {
    let split = checked_split(data.samples, data.bounds, settings)?;
    let frame = Frame::new(settings.features, data.insect, data.bounds);
    let inside = frame.bounds(data.bounds);
    let parts = [&split.train, &split.validation, &split.test].map(|p| frame.part(data.samples, p));
    let constants = constants(&parts[0], &inside);
    let parts = parts.map(|part| part.without(&constants));
    let mut model = model(&parts[0], &inside, settings, &constants);
    let means = parts[0].means();
    let means = std::array::from_fn(|k| if constants[k].is_some() { 0.0 } else { means[k] });
    let first = |seed| initial::nguyen_widrow(&inside, settings.neurons, means, seed);
    let mut at = match start {
        Some(checkpoint) => {
            check_checkpoint(&checkpoint, &inside, settings)?;
            checkpoint
        }
        None => begin(first(settings.seed), model.as_mut(), &parts, Vec::new()),
    };
    loop {
        let stopped = descend(&mut at, model.as_mut(), &parts, settings, observe);
        let best_iteration = best(&at.curve);
        at.members.push(Member { network: at.best, curve: at.curve, best_iteration, stopped });
        let done = at.members.len();
        if done == settings.ensemble || stopped == Stop::Interrupted {
            break;
        }
        at = begin(first(initial::member_seed(settings.seed, done)), model.as_mut(), &parts, at.members);
    }
    for member in &mut at.members {
        for (bias, constant) in member.network.output_biases.iter_mut().zip(constants) {
            // What was taken away from the labels is all there is of a constant output.
            *bias = constant.unwrap_or(*bias);
        }
    }
    finish(at.members, frame, split, data.samples)
}

/// The outputs which depend on nothing that is free, with their values: those which are the same in every sample,
/// and all where only what the frame's laws know is free; then noise is averaged.
fn constants(part: &Part, inside: &Bounds) -> [Option<f64>; 4] {
    let known = part.constants();
    if (0..COUNT).any(|i| !inside.is_held(i)) {
        return known;
    }
    let means = part.means();
    std::array::from_fn(|k| known[k].or(Some(means[k])))
}

fn finish(members: Vec<Member>, frame: Frame, split: Split, samples: &[Sample]) -> Result<Training, TrainError> {
    let networks = members.iter().map(|m| m.network.clone()).collect();
    let surrogate = Surrogate::new(frame, networks).map_err(|_| TrainError::Checkpoint("its networks do not fit"))?;
    let of = |indices: &[usize]| {
        let samples: Vec<Sample> = indices.iter().map(|&i| samples[i]).collect();
        errors(&surrogate, &samples)
    };
    let (train, validation, test) = (of(&split.train), of(&split.validation), of(&split.test));
    Ok(Training { surrogate, members, train, validation, test, split })
}

/// The least-squares problem of a training part.
fn model(part: &Part, inside: &Bounds, settings: &TrainSettings, constants: &[Option<f64>; 4]) -> Box<dyn Model> {
    if constants.iter().all(Option::is_some) {
        return Box::new(Solved);
    }
    let free: Vec<usize> = (0..COUNT).filter(|&i| !inside.is_held(i)).collect();
    let rows: Vec<Point> = part.xs.iter().map(|x| scaled(inside, x)).collect();
    let inputs = free.iter().map(|&i| rows.iter().map(|z| z[i]).collect()).collect();
    // The rest of a constant output is rounding, which is not to be learnt.
    let target = |y: &[f64; 4]| std::array::from_fn(|k| if constants[k].is_some() { 0.0 } else { y[k] });
    let targets = part.ys.iter().map(target).collect();
    let data = Data { free, inputs, points: part.xs.clone(), targets, weights: part.weights.clone() };
    match settings.method {
        Method::VariableProjection => Box::new(Projection::new(data, settings.neurons)),
        Method::LevenbergMarquardt => Box::new(Normal::new(data, settings.neurons)),
    }
}

/// The problem of constants: the first network is the best one.
struct Solved;

impl Model for Solved {
    fn objective(&mut self, _: &mut Network) -> Option<f64> {
        Some(0.0)
    }
    fn linearise(&mut self, _: &Network) -> f64 {
        0.0
    }
    fn step(&mut self, _: f64) -> Option<Change> {
        None
    }
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

/// Iteration 0 of a network.
fn begin(network: Network, model: &mut dyn Model, parts: &[Part; 3], members: Vec<Member>) -> Checkpoint {
    let Levenberg { network, objective, damping, growth } = Levenberg::new(network, model);
    let best = network.clone();
    let mut at = Checkpoint { members, network, objective, damping, growth, curve: Vec::new(), best };
    judge(&mut at, parts);
    at
}

/// Notes the errors where the training stands.
fn judge(at: &mut Checkpoint, parts: &[Part; 3]) {
    let [train_mse, validation_mse, test_mse] = parts.each_ref().map(|p| p.mse(&at.network));
    let before = at.curve.get(best(&at.curve)).map_or(f64::INFINITY, |e| e.validation_mse);
    at.curve.push(Epoch { iteration: at.curve.len(), train_mse, validation_mse, test_mse, damping: at.damping });
    if validation_mse < before {
        at.best.clone_from(&at.network);
    }
}

/// Iterates until a reason to stop.
fn descend(
    at: &mut Checkpoint,
    model: &mut dyn Model,
    parts: &[Part; 3],
    settings: &TrainSettings,
    observe: &mut dyn FnMut(&Checkpoint) -> ControlFlow<()>,
) -> Stop {
    // The gradient of the mean is 2 / (4 N) times that of half the sum.
    let least = LEAST_GRADIENT * (4 * parts[0].ys.len()) as f64 / 2.0;
    loop {
        if observe(at).is_break() {
            return Stop::Interrupted;
        }
        let iteration = at.curve.len() - 1;
        let failures = iteration - best(&at.curve);
        if failures > 0 && failures >= settings.patience {
            return Stop::Validation;
        }
        if iteration >= settings.max_iterations {
            return Stop::MaxIterations;
        }
        let (network, objective) = (at.network.clone(), at.objective);
        let mut state = Levenberg { network, objective, damping: at.damping, growth: at.growth };
        let outcome = state.iterate(model, least);
        Levenberg { network: at.network, objective: at.objective, damping: at.damping, growth: at.growth } = state;
        match outcome {
            Outcome::Moved => judge(at, parts),
            Outcome::Flat => return Stop::Gradient,
            Outcome::Stuck => return Stop::Damping,
        }
    }
}
