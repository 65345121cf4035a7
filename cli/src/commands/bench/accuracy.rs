//! `manduca bench accuracy`: what features, methods, ensembles and samples are worth.

use std::ops::ControlFlow;
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, Result};
use manduca_numerics::insect::Insect;
use manduca_numerics::parameters::Bounds;
use manduca_numerics::surrogate::{
    Dataset, Features, Method, Sample, Surrogate, TrainSettings, errors, process, train,
};
use serde::Serialize;

use super::samples::{read, stand_in};
use crate::args::{BenchAccuracyArgs, FeaturesChoice, MethodChoice};
use crate::exit::refused;
use crate::output::Output;

/// Samples of the stand-in which only judge.
const STAND_IN_TEST: usize = 1000;

/// One training and its errors on the second dataset.
#[derive(Debug, Serialize)]
struct Row {
    features: &'static str,
    method: &'static str,
    samples: usize,
    ensemble: usize,
    /// Root mean square errors of L+, D+, M+, P+, percent of their scales.
    rmse_percent: [f64; 4],
    /// Iterations of its networks.
    iterations: usize,
    /// Wall time of its networks.
    seconds: f64,
}

/// Runs the comparison; a row is printed as soon as it is known.
pub fn accuracy(args: &BenchAccuracyArgs) -> Result<ExitCode> {
    let insect = Insect::preset(&args.insect).ok_or_else(|| refused(format!("no preset `{}`", args.insect)))?;
    let (known, unknown) = match (&args.train, &args.test) {
        (Some(train), Some(test)) => (read(train)?, read(test)?),
        _ => {
            let most = args.sizes.iter().copied().max().unwrap_or_default();
            let mut all = stand_in(most + STAND_IN_TEST)?;
            let test = all.split_off(most);
            (all, test)
        }
    };
    let mut out = Output::stdout();
    if !args.json {
        out.line(format_args!("10-{}-4, {} points to judge by; rmse in % of scale", args.neurons, unknown.len()))?;
        out.line(format_args!(
            "{:<9} {:<20} {:>7} {:>4} {:>6} {:>6} {:>6} {:>6} {:>5} {:>8}",
            "features", "method", "samples", "nets", "L", "D", "M", "P", "its", "s"
        ))?;
    }
    for &size in args.sizes.iter().filter(|size| **size <= known.len()) {
        for &features in &args.features {
            for &method in &args.methods {
                let known = &known[..size];
                let rows = match method {
                    MethodChoice::GaussianProcess => vec![process_row(&insect, known, &unknown, features)?],
                    _ => rows(args, &insect, known, &unknown, features, method)?,
                };
                for row in rows {
                    tell(&mut out, args.json, &row)?;
                }
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The box the samples fill: a dataset does not say which one it was drawn from.
fn hull(samples: &[Sample]) -> Bounds {
    let mut hull = Bounds { lower: [f64::INFINITY; 10], upper: [f64::NEG_INFINITY; 10] };
    for sample in samples {
        for (i, x) in sample.x.iter().enumerate() {
            (hull.lower[i], hull.upper[i]) = (hull.lower[i].min(*x), hull.upper[i].max(*x));
        }
    }
    hull
}

fn features_of(choice: FeaturesChoice) -> (Features, &'static str) {
    match choice {
        FeaturesChoice::Physical => (Features::Physical, "physical"),
        FeaturesChoice::Paper => (Features::Paper, "paper"),
    }
}

/// A gaussian process of all samples but the three which its trainer keeps to test with.
fn process_row(insect: &Insect, known: &[Sample], unknown: &[Sample], features: FeaturesChoice) -> Result<Row> {
    let (features, features_name) = features_of(features);
    let rest = 3.0 / known.len() as f64;
    let settings =
        TrainSettings { train_share: 0.9, validation_share: 0.1 - rest, features, ..TrainSettings::default() };
    let bounds = hull(known);
    let start = Instant::now();
    let data = Dataset { samples: known, bounds: &bounds, insect };
    let found = process::fit(&data, &settings, Vec::new(), &mut |_| ControlFlow::Continue(()))?;
    Ok(Row {
        features: features_name,
        method: "gaussian-process",
        samples: known.len(),
        ensemble: 1,
        rmse_percent: errors(&found.surrogate, unknown).rmse.map(|e| 100.0 * e),
        iterations: found.ascents.iter().map(|a| a.iterations).sum(),
        seconds: start.elapsed().as_secs_f64(),
    })
}

/// The largest ensemble is trained; its first networks are the smaller ones.
fn rows(
    args: &BenchAccuracyArgs,
    insect: &Insect,
    known: &[Sample],
    unknown: &[Sample],
    features: FeaturesChoice,
    method: MethodChoice,
) -> Result<Vec<Row>> {
    let (features, features_name) = features_of(features);
    let (method, method_name) = match method {
        MethodChoice::LevenbergMarquardt => (Method::LevenbergMarquardt, "levenberg-marquardt"),
        _ => (Method::VariableProjection, "variable-projection"),
    };
    let settings = TrainSettings {
        neurons: args.neurons,
        max_iterations: args.max_iterations,
        patience: args.patience,
        train_share: 0.9,
        validation_share: 0.1 - 3.0 / known.len() as f64,
        features,
        method,
        ensemble: args.ensembles.iter().copied().max().context("no size of an ensemble is given")?,
        ..TrainSettings::default()
    };
    let bounds = hull(known);
    let start = Instant::now();
    let mut ends = vec![0.0; settings.ensemble];
    let data = Dataset { samples: known, bounds: &bounds, insect };
    let training = train(&data, &settings, None, &mut |at| {
        ends[at.members.len()] = start.elapsed().as_secs_f64();
        ControlFlow::Continue(())
    })?;
    let of = |&ensemble: &usize| {
        let networks = training.surrogate.members()[..ensemble].to_vec();
        let surrogate = Surrogate::new(*training.surrogate.frame(), networks)?;
        Ok(Row {
            features: features_name,
            method: method_name,
            samples: known.len(),
            ensemble,
            rmse_percent: errors(&surrogate, unknown).rmse.map(|e| 100.0 * e),
            iterations: training.members[..ensemble].iter().map(|m| m.curve.len() - 1).sum(),
            seconds: ends[ensemble - 1],
        })
    };
    args.ensembles.iter().filter(|k| **k >= 1).map(of).collect()
}

fn tell(out: &mut Output, json: bool, row: &Row) -> Result<()> {
    if json {
        return Ok(out.json(row)?);
    }
    let [l, d, m, p] = row.rmse_percent;
    out.line(format_args!(
        "{:<9} {:<20} {:>7} {:>4} {l:>6.2} {d:>6.2} {m:>6.2} {p:>6.2} {:>5} {:>8.1}",
        row.features, row.method, row.samples, row.ensemble, row.iterations, row.seconds
    ))?;
    Ok(())
}
