//! The likeliest process of samples.

use super::ascent::{AscentStop, Top};
use super::climbs::{Climbed, Climbs, FitProgress};
use super::kernel::Inputs;
use super::likelihood::Labels;
use super::{Process, ProcessOutput};
use crate::math::{exp, ln};
use crate::parameters::{COUNT, OUTPUTS, Point};
use crate::surrogate::features::{Frame, MIRROR_SIGNS, constant};
use crate::surrogate::random::{Streams, shuffle, uniform};
use crate::surrogate::settings::checked_split;
use crate::surrogate::{Dataset, Errors, Sample, Split, Surrogate, TrainError, TrainSettings, errors};
use std::ops::ControlFlow;

/// Most samples a process is fitted to: its matrix of their covariances has 200 MB then.
pub const MOST_POINTS: usize = 5000;
/// Most samples by which lengths, amplitude and noise are chosen; the weights are of all.
const JUDGES: usize = 1000;
/// Samples by which the first ascents are made.
const FEW: usize = 250;
/// First ascents of each output.
const STARTS: u64 = 4;
/// Ascents of each output: the first ones, and one from the best end.
const PER_OUTPUT: usize = STARTS as usize + 1;
/// Streams of the seed: which samples judge, and where ascents start.
const JUDGE_STREAM: u64 = 3;
const START_STREAM: u64 = 16;
/// Lengths looked at, of a box from -1 to 1: beyond the last a parameter has a slope at most.
const LENGTHS: (f64, f64) = (0.05, 50.0);
/// Amplitudes looked at, over the labels' spread.
const AMPLITUDES: (f64, f64) = (0.05, 50.0);
/// Noises looked at, over the labels' spread: below the first the matrix is singular to working precision.
const NOISES: (f64, f64) = (1e-4, 1.0);

/// How the numbers of one output were found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ascent {
    /// Iterations of the last ascent.
    pub iterations: usize,
    /// Logarithm of the likelihood at its end, but for a constant.
    pub likelihood: f64,
    /// Why it ended.
    pub stop: AscentStop,
}

/// A process of samples and how good it is.
#[derive(Debug, Clone, PartialEq)]
pub struct ProcessFit {
    /// What predicts.
    pub surrogate: Surrogate,
    /// One per output.
    pub ascents: [Ascent; 4],
    /// Errors on the training share.
    pub train: Errors,
    /// Errors on the validation share, to which it is fitted too.
    pub validation: Errors,
    /// Errors on the test share, which it has not seen.
    pub test: Errors,
    /// Which sample served for what.
    pub split: Split,
}

/// Fits a process to samples: all but the test share, for it needs none to say when to stop.
/// Ascents which an earlier fit of the same samples and settings has told as ended are not
/// made again; the result is the same.
///
/// Lengths, amplitude and noise of each output are the likeliest, searched from several
/// random points by a few of the samples and then, from the best end, by at most 1000.
/// Of the settings seed, features and shares count. The observer sees each iteration and
/// may stop an ascent; what was likeliest by then comes back. The result depends on the
/// samples and the settings alone, not on threads.
///
/// # Errors
/// When there is nothing sound to fit to, or more than [`MOST_POINTS`] samples.
pub fn fit(
    data: &Dataset<'_>,
    settings: &TrainSettings,
    ended: Vec<Climbed>,
    observe: &mut dyn FnMut(&FitProgress<'_>) -> ControlFlow<()>,
) -> Result<ProcessFit, TrainError> {
    let split = checked_split(data.samples, data.bounds, settings)?;
    let mut known: Vec<usize> = split.train.iter().chain(&split.validation).copied().collect();
    known.sort_unstable();
    if known.len() > MOST_POINTS {
        return Err(TrainError::TooManySamples { samples: known.len() });
    }
    let frame = Frame::new(settings.features, data.insect, data.bounds);
    let samples: Vec<Sample> = known.iter().map(|&i| data.samples[i]).collect();
    let mut order: Vec<usize> = (0..known.len()).collect();
    shuffle(&mut order, &mut Streams::new(settings.seed).stream(JUDGE_STREAM));
    let bounds = frame.bounds(data.bounds);
    let inputs = Inputs::new(&bounds, frame.is_mirrored());
    let mut climbs = Climbs { ascents: OUTPUTS.len() * PER_OUTPUT, ended, observe };
    let (mut outputs, mut ascents) = (Vec::new(), Vec::new());
    for (k, (output, ..)) in OUTPUTS.iter().enumerate() {
        let labels = labels(&frame, &inputs, &bounds, &samples, k);
        if let Some(mean) = constant_of(&labels, &inputs) {
            outputs.push(ProcessOutput::constant(mean, samples.len()));
            ascents.push(Ascent { iterations: 0, likelihood: 0.0, stop: AscentStop::Constant });
            continue;
        }
        let top = likeliest(&labels, &order, settings.seed, k, &mut climbs)?;
        let solved = labels.solve(&top.at).ok_or(TrainError::NotPositive { output })?;
        let mut lengths: Point = [1.0; COUNT];
        for (&i, l) in inputs.order.iter().zip(&top.at) {
            lengths[i] = exp(*l);
        }
        let width = inputs.order.len();
        let (amplitude, noise) = (exp(top.at[width]), exp(top.at[width + 1]));
        outputs.push(ProcessOutput { lengths, amplitude, noise, mean: solved.mean, weights: solved.weights });
        ascents.push(Ascent { iterations: top.iterations, likelihood: top.solved.likelihood, stop: top.stop });
    }
    let (Ok(outputs), Ok(ascents)) = (outputs.try_into(), ascents.try_into()) else {
        return Err(TrainError::Checkpoint("a process has four outputs"));
    };
    let process = Process { bounds, points: samples.iter().map(|s| frame.inputs(&s.x)).collect(), outputs };
    let surrogate = Surrogate::of_process(frame, process).map_err(|_| TrainError::NotPositive { output: "weights" })?;
    let of = |indices: &[usize]| {
        let samples: Vec<Sample> = indices.iter().map(|&i| data.samples[i]).collect();
        errors(&surrogate, &samples)
    };
    let (train, validation, test) = (of(&split.train), of(&split.validation), of(&split.test));
    Ok(ProcessFit { surrogate, ascents, train, validation, test, split })
}

/// The value of an output which depends on nothing that is free: the same in every sample, or all that can be said
/// where only what the frame's laws know is free.
fn constant_of(labels: &Labels, inputs: &Inputs) -> Option<f64> {
    let images = labels.values.iter().map(|y| labels.sign.unwrap_or(1.0) * y);
    // Every sample is two where the mirror law holds.
    let all = labels.values.iter().copied().chain(images);
    let mean = || all.clone().sum::<f64>() / (2 * labels.len()) as f64;
    let known = constant(all.clone());
    if inputs.order.is_empty() { known.or_else(|| Some(mean())) } else { known }
}

/// One output of samples as the frame has it.
fn labels(frame: &Frame, inputs: &Inputs, bounds: &crate::parameters::Bounds, samples: &[Sample], k: usize) -> Labels {
    let given: Vec<Point> = samples.iter().map(|s| frame.inputs(&s.x)).collect();
    Labels {
        inputs: given.iter().flat_map(|x| inputs.of(bounds, x)).collect(),
        width: inputs.order.len(),
        even: inputs.even,
        sign: frame.is_mirrored().then_some(MIRROR_SIGNS[k]),
        values: samples.iter().map(|s| frame.inward(&s.x, &s.y)[k]).collect(),
        variances: samples.iter().map(|s| frame.variances(s)[k]).collect(),
    }
}

/// The likeliest numbers of one output.
fn likeliest(
    labels: &Labels,
    order: &[usize],
    seed: u64,
    output: usize,
    climbs: &mut Climbs<'_>,
) -> Result<Top, TrainError> {
    let spread = labels.spread();
    let scaled = |(low, high): (f64, f64), by: f64| (ln(low * by), ln(high * by));
    let mut bounds = vec![scaled(LENGTHS, 1.0); labels.width];
    bounds.extend([scaled(AMPLITUDES, spread), scaled(NOISES, spread)]);
    let streams = Streams::new(seed);
    let few = labels.some(&order[..FEW.min(order.len())]);
    let mut best: Option<Top> = None;
    for start in 0..STARTS {
        let mut rng = streams.stream(START_STREAM + STARTS * output as u64 + start);
        // Lengths between half the box and four of it; an amplitude and a noise as labels may have.
        let mut at: Vec<f64> = (0..labels.width).map(|_| ln(8.0) * uniform(&mut rng)).collect();
        at.extend([ln(spread * (1.0 + 2.0 * uniform(&mut rng))), ln(spread * 0.02)]);
        let found = climbs.climb(PER_OUTPUT * output + start as usize, &few, at, &bounds);
        let better = |top: &Top| best.as_ref().is_none_or(|b| top.solved.likelihood > b.solved.likelihood);
        best = found.filter(better).or(best);
    }
    let not_positive = TrainError::NotPositive { output: OUTPUTS[output].0 };
    let first = best.ok_or(not_positive.clone())?;
    if order.len() <= FEW {
        return Ok(first);
    }
    let judges = labels.some(&order[..JUDGES.min(order.len())]);
    climbs.climb(PER_OUTPUT * output + STARTS as usize, &judges, first.at, &bounds).ok_or(not_positive)
}
