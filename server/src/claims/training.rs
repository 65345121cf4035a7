//! Whether a surrogate is what its study asked for, and errs as it claims.

use manduca_numerics::surrogate::{Errors, Frame, Sample, Split, Surrogate, errors};
use manduca_protocol::network;
use manduca_protocol::resolve::ResolvedStudy;
use manduca_protocol::study::{StudySpec, SurrogateKind};
use manduca_protocol::task::{ErrorsMessage, Scaled, TrainResult, TrainSample};

use super::{Fault, agrees, differs};

/// Relative error of errors computed on another processor.
const TOLERANCE: f64 = 1e-6;
/// Their error over the size of what is predicted: errors of an exact surrogate are rounding.
const LEAST: f64 = 1e-7;
/// Error of a correlation.
const CORRELATED: f64 = 1e-4;

/// What was trained on.
pub(super) struct Trained<'s> {
    pub(super) spec: &'s StudySpec,
    pub(super) study: &'s ResolvedStudy,
    /// The samples in the order of their index.
    pub(super) samples: &'s [TrainSample],
}

/// Checks a training against its samples.
pub(super) fn check(trained: &Trained<'_>, claimed: &TrainResult) -> Result<(), Fault> {
    let surrogate = network::surrogate(&claimed.surrogate)?;
    shape(trained, &surrogate, claimed)?;
    let spec = &trained.spec.surrogate;
    let split = Split::new(trained.samples.len(), spec.train_share, spec.validation_share, trained.spec.seed);
    let mut known = Vec::new();
    for (name, places, claim) in [
        ("training", &split.train, &claimed.train),
        ("validation", &split.validation, &claimed.validation),
        ("test", &split.test, &claimed.test),
    ] {
        let share: Vec<Sample> = places.iter().map(|&i| sample(&trained.samples[i])).collect();
        let found = errors(&surrogate, &share);
        same_errors(name, claim, &found, &share)?;
        if name != "test" {
            known.push((found, share));
        }
    }
    skill(&known).map_err(Fault::Poor)
}

fn sample(s: &TrainSample) -> Sample {
    Sample { x: s.x, y: s.y, se: s.se }
}

/// Whether it has the form that was asked for.
fn shape(trained: &Trained<'_>, surrogate: &Surrogate, claimed: &TrainResult) -> Result<(), String> {
    let (spec, study) = (&trained.spec.surrogate, trained.study);
    let frame = Frame::new(study.surrogate.features, &study.model.insect, &study.bounds);
    if !same_frame(surrogate.frame(), &frame) {
        return Err("the surrogate is not in the frame of the study".into());
    }
    let inside = frame.bounds(&study.bounds);
    let process = surrogate.process();
    let bounds = surrogate.members().iter().map(|n| n.bounds).chain(process.map(|p| p.bounds));
    for bounds in bounds {
        let pairs = bounds.lower.iter().zip(&inside.lower).chain(bounds.upper.iter().zip(&inside.upper));
        if !pairs.into_iter().all(|(a, b)| agrees(*a, *b, TOLERANCE, TOLERANCE)) {
            return Err("the surrogate has other bounds than the study".into());
        }
    }
    let told = match (spec.kind, process) {
        (SurrogateKind::GaussianProcess, Some(_)) => 4,
        (SurrogateKind::Network, None) => spec.ensemble as usize,
        _ => return Err("the surrogate is of another kind than the study asks for".into()),
    };
    let neurons = surrogate.members().iter().map(|n| n.neurons());
    if process.is_none() && (neurons.len() != told || neurons.into_iter().any(|n| n != spec.neurons as usize)) {
        return Err(format!("the surrogate is not of {told} networks with {} neurons each", spec.neurons));
    }
    if claimed.stops.len() != told || claimed.best_iterations.len() != told {
        return Err(format!("the training does not tell of {told} ends"));
    }
    let most = if process.is_some() { 0 } else { told * (spec.max_iterations as usize + 1) };
    if claimed.curve.len() > most {
        return Err(format!("the training curve has {} iterations; {most} are possible", claimed.curve.len()));
    }
    Ok(())
}

/// Two frames but for rounding.
fn same_frame(a: &Frame, b: &Frame) -> bool {
    match (a, b) {
        (Frame::Paper, Frame::Paper) => true,
        (
            Frame::Physical { reference_hz, arm, mirror, sharpness },
            Frame::Physical { reference_hz: hz, arm: expected, mirror: mirrored, sharpness: sharp },
        ) => {
            (mirror, sharpness) == (mirrored, sharp)
                && agrees(*reference_hz, *hz, TOLERANCE, 0.0)
                && arm.iter().zip(expected).all(|(a, b)| agrees(*a, *b, TOLERANCE, TOLERANCE))
        }
        _ => false,
    }
}

fn four(s: &Scaled) -> [f64; 4] {
    [s.lift, s.drag, s.pitch_moment, s.power]
}

/// Mean square of an output, and its variance.
fn moments(share: &[Sample], output: usize) -> [f64; 2] {
    let n = share.len().max(1) as f64;
    let mean = share.iter().map(|s| s.y[output]).sum::<f64>() / n;
    let square = share.iter().map(|s| s.y[output] * s.y[output]).sum::<f64>() / n;
    [square, share.iter().map(|s| (s.y[output] - mean).powi(2)).sum::<f64>() / n]
}

fn same_errors(of: &str, claim: &ErrorsMessage, found: &Errors, share: &[Sample]) -> Result<(), Fault> {
    if claim.count as usize != found.count {
        return Err(Fault::Useless(format!("it counts {} {of} samples, and there are {}", claim.count, found.count)));
    }
    let (rmse, correlation) = (four(&claim.rmse), four(&claim.correlation));
    for (k, (name, ..)) in manduca_numerics::parameters::OUTPUTS.iter().enumerate() {
        let [square, variance] = moments(share, k);
        if !agrees(rmse[k], found.rmse[k], TOLERANCE, LEAST * square.sqrt()) {
            let why = format!("{of} samples have an error of {name} of {}, not {} as claimed", found.rmse[k], rmse[k]);
            return Err(differs(rmse[k], found.rmse[k], why));
        }
        // What hardly varies, or is predicted no better than by its mean, correlates by rounding.
        let varies = variance > TOLERANCE * TOLERANCE * square && found.rmse[k].powi(2) < 0.99 * variance;
        if varies && (correlation[k] - found.correlation[k]).abs() > CORRELATED {
            let told = (found.correlation[k], correlation[k]);
            let why = format!("{of} samples have a correlation of {name} of {}, not {} as claimed", told.0, told.1);
            return Err(Fault::Useless(why));
        }
    }
    Ok(())
}

/// Whether it predicts what it was trained on better than the mean does.
fn skill(known: &[(Errors, Vec<Sample>)]) -> Result<(), String> {
    let all: Vec<Sample> = known.iter().flat_map(|(_, share)| share.iter().copied()).collect();
    let n = all.len().max(1) as f64;
    let (mut unexplained, mut outputs) = (0.0, 0.0);
    for k in 0..4 {
        let [square, variance] = moments(&all, k);
        if variance > TOLERANCE * TOLERANCE * square {
            let squares: f64 = known.iter().map(|(e, share)| e.rmse[k].powi(2) * share.len() as f64).sum();
            unexplained += squares / n / variance;
            outputs += 1.0;
        }
    }
    if unexplained >= outputs && outputs > 0.0 {
        return Err(
            "the surrogate is no better than the mean of the samples it was trained on: it needs more of them".into()
        );
    }
    Ok(())
}
