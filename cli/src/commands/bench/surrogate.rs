//! `manduca bench surrogate`: how fast the network is trained and used here.

use std::ops::ControlFlow;
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, Result};
use manduca_numerics::insect::Insect;
use manduca_numerics::parameters::Bounds;
use manduca_numerics::simulation::level;
use manduca_numerics::surrogate::{Dataset, Features, Method, Sample, Surrogate, TrainSettings, train};
use serde::Serialize;

use super::memory;
use super::samples::stand_in;
use super::search::{self, Search};
use crate::args::BenchSurrogateArgs;
use crate::output::Output;

/// What `bench surrogate` found. Training uses every core.
#[derive(Debug, Serialize)]
struct Report {
    level: &'static str,
    cores: usize,
    neurons: usize,
    /// Samples the weights are fitted to.
    train_samples: usize,
    #[serde(flatten)]
    training: Training,
    #[serde(flatten)]
    search: Search,
}

/// Times of one iteration of the paper's ten inputs; steps refused on the way count.
#[derive(Debug, Serialize)]
struct Training {
    /// Levenberg-Marquardt, s.
    lm_iteration_s: f64,
    /// Variable projection, s.
    vp_iteration_s: f64,
    /// Most memory of this process after training, MiB; none where the system does not tell.
    peak_rss_mib: Option<f64>,
}

/// Median wall time of an iteration, s, and the surrogate they made.
fn iteration_s(samples: &[Sample], settings: &TrainSettings) -> Result<(f64, Surrogate)> {
    let mut last = Instant::now();
    let mut times = Vec::new();
    let (bounds, insect) = (Bounds::default(), Insect::default());
    let trained = train(&Dataset { samples, bounds: &bounds, insect: &insect }, settings, None, &mut |at| {
        if at.curve.len() > 1 {
            times.push(last.elapsed().as_secs_f64());
        }
        last = Instant::now();
        ControlFlow::Continue(())
    })?;
    times.sort_by(f64::total_cmp);
    let median = times.get(times.len() / 2).copied().context("the training stopped before its first iteration")?;
    Ok((median, trained.surrogate))
}

fn training(samples: &[Sample], args: &BenchSurrogateArgs) -> Result<(Training, Surrogate)> {
    let settings = |method| TrainSettings {
        method,
        features: Features::Paper,
        neurons: args.neurons,
        max_iterations: args.iterations,
        patience: args.iterations,
        ..TrainSettings::default()
    };
    let (lm_iteration_s, _) = iteration_s(samples, &settings(Method::LevenbergMarquardt))?;
    let (vp_iteration_s, surrogate) = iteration_s(samples, &settings(Method::VariableProjection))?;
    let peak_rss_mib = memory::resident_peak_mb(std::process::id()).map(|mb| mb * 1e6 / f64::from(1 << 20));
    Ok((Training { lm_iteration_s, vp_iteration_s, peak_rss_mib }, surrogate))
}

/// Runs the benchmark.
pub fn surrogate(args: &BenchSurrogateArgs) -> Result<ExitCode> {
    let samples = stand_in(args.samples)?;
    let (training, surrogate) = training(&samples, args)?;
    let report = Report {
        level: level(),
        cores: std::thread::available_parallelism().map_or(1, usize::from),
        neurons: args.neurons,
        train_samples: (args.samples as f64 * TrainSettings::default().train_share).round() as usize,
        training,
        search: search::measure(&surrogate)?,
    };
    let mut out = Output::stdout();
    if args.json {
        out.json(&report)?;
    } else {
        print(&mut out, &report)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn print(out: &mut Output, r: &Report) -> std::io::Result<()> {
    out.line(format_args!("10-{}-4, {} samples, {} cores, {}, medians", r.neurons, r.train_samples, r.cores, r.level))?;
    let row = |what: &str, value: String| vec![what.to_owned(), value];
    let or_none = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.0}"));
    out.table(
        &["what".to_owned(), "value".to_owned()],
        &[
            row("Levenberg-Marquardt, one iteration, s", format!("{:.2}", r.training.lm_iteration_s)),
            row("variable projection, one iteration, s", format!("{:.2}", r.training.vp_iteration_s)),
            row("most memory while training, MiB", or_none(r.training.peak_rss_mib)),
            row("predictions on one core, 1e6/s", format!("{:.2}", r.search.inference_f64_evals_s * 1e-6)),
            row("genetic algorithm, 1e5 x 100 and simplex, s", format!("{:.2}", r.search.ga_1e5x100_s)),
            row("sequential quadratic programming, 1000 starts, s", format!("{:.2}", r.search.sqp_1000_starts_s)),
        ],
    )
}
