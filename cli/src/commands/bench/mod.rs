//! `manduca bench`: how fast this machine is at what takes the time.

mod accuracy;
mod memory;
mod queue;
pub(super) mod samples;
mod scaling;
mod search;
mod surrogate;

pub use queue::syncs_per_s;

use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, Result};
use manduca_numerics::cases::CASES;
use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::ElevationPhase;
use manduca_numerics::parameters::Bounds;
use manduca_numerics::simulation::{BodyVelocity, Model, SOLVER_VERSION, Simulation, level, simulate};
use manduca_numerics::uvlm::kernel::{Points, induce, interactions, segments};
use manduca_numerics::uvlm::probe::{Workload, induce_plainly, multiply_adds};
use manduca_numerics::uvlm::{Settings, SingleWake};
use manduca_protocol::resolve;
use manduca_protocol::study::ModelSpec;
use serde::Serialize;

use crate::args::{BenchCommand, BenchSolverArgs};
use crate::cost::{self, Cost};
use crate::exit::refused;
use crate::output::Output;
use crate::progress::span;

/// Floating point operations of one segment on one target (a multiply-add counts
/// two), with its half of a node's distance and of the common division.
const OPERATIONS: f64 = 40.0;

/// Runs a benchmark.
pub async fn bench(command: &BenchCommand) -> Result<ExitCode> {
    match command {
        BenchCommand::Solver(args) => solver(args),
        BenchCommand::Accuracy(args) => accuracy::accuracy(args),
        BenchCommand::Surrogate(args) => surrogate::surrogate(args),
        BenchCommand::Queue(args) => queue::queue(args).await,
    }
}

/// What `bench solver` found. Rates and times are of one core.
#[derive(Debug, Serialize)]
struct SolverReport {
    level: &'static str,
    solver_version: &'static str,
    kernel_f64_ginteractions_s: f64,
    /// Of the wake on itself in single precision, with the copies to and fro.
    kernel_f32_ginteractions_s: f64,
    plain_f64_ginteractions_s: f64,
    kernel_over_plain: f64,
    fma_peak_f64_gflops: f64,
    kernel_share_of_peak: f64,
    case_6x12_s: f64,
    case_8x16_s: f64,
    /// A sample of a study at the default settings, and the whole study.
    #[serde(flatten)]
    study: Cost,
    /// Most memory of a compute slot, MB; none where the system does not tell.
    slot_peak_rss_mb: Memory,
    #[serde(skip_serializing_if = "Option::is_none")]
    scaling: Option<Vec<scaling::Row>>,
}

/// Most memory a slot has had after one flight, MB.
#[derive(Debug, Serialize)]
struct Memory {
    case_8x16: Option<f64>,
    production_sample: Option<f64>,
}

/// The middle of three timings, s.
fn median(mut run: impl FnMut()) -> f64 {
    let mut times = [0.0; 3].map(|_: f64| {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64()
    });
    times.sort_by(f64::total_cmp);
    times[1]
}

/// Interactions of a sheet on its nodes, 1e9/s.
fn rate(mut induced: impl FnMut(&Workload, &mut Points)) -> f64 {
    let work = Workload::new(97, 11);
    let mut velocity = Points::zeros(work.targets.len());
    let repeats = 40;
    let time = median(|| (0..repeats).for_each(|_| induced(&work, &mut velocity)));
    std::hint::black_box(&velocity);
    interactions(&work.sheet(), &work.targets) as f64 * f64::from(repeats) / time * 1e-9
}

fn kernel_rate() -> f64 {
    rate(|work, velocity| induce(&work.sheet(), &work.targets, velocity))
}

fn single_rate() -> f64 {
    let mut wake = SingleWake::default();
    rate(|work, velocity| wake.induce(&work.sheet(), &work.targets, velocity))
}

fn plain_rate() -> f64 {
    let work = Workload::new(97, 11);
    let sheet = work.sheet();
    let targets = 400;
    let time = median(|| {
        for i in 0..targets {
            std::hint::black_box(induce_plainly(&sheet, work.targets.get(i)));
        }
    });
    (segments(&sheet) * targets) as f64 / time * 1e-9
}

fn peak() -> f64 {
    let rounds = 20_000_000;
    let mut operations = 0;
    let time = median(|| {
        let (count, sum) = multiply_adds(rounds);
        operations = count;
        std::hint::black_box(sum);
    });
    operations as f64 / time * 1e-9
}

/// A published stroke.
fn flight(settings: Settings) -> Simulation {
    Simulation {
        model: Model::Uvlm(settings),
        insect: Insect::default(),
        parameters: CASES[0].parameters,
        elevation_phase: ElevationPhase::Plus,
        elastic_storage: 0.0,
        body_velocity: BodyVelocity::default(),
    }
}

/// Wall time of one flight, s.
fn case(settings: Settings) -> f64 {
    median(|| {
        std::hint::black_box(simulate(&flight(settings)).is_ok());
    })
}

/// A study with the default settings and the paper's box.
fn default_study(samples: u32) -> Result<Cost> {
    let model = resolve::model(&ModelSpec::default(), "").map_err(|faults| refused(format!("{faults:?}")))?;
    cost::measure(&model, &Bounds::default(), 0.0, (samples, 0)).context("no stroke of the paper's box is feasible")
}

/// A lattice of the comparison with public codes: the whole wake is kept, in double precision.
fn untruncated(chordwise_panels: usize, spanwise_panels: usize, steps_per_stroke: usize, strokes: usize) -> Settings {
    let wake_strokes = strokes as f64;
    Settings {
        chordwise_panels,
        spanwise_panels,
        steps_per_stroke,
        strokes,
        strokes_dropped: strokes.saturating_sub(2),
        strokes_most: strokes,
        wake_strokes,
        wake_joined_after: wake_strokes,
        wake_tail: 0.0,
        single_precision_wake: 0,
        ..Settings::default()
    }
}

fn solver(args: &BenchSolverArgs) -> Result<ExitCode> {
    let (kernel, plain, peak) = (kernel_rate(), plain_rate(), peak());
    let (small, large) = (untruncated(6, 12, 40, 3), untruncated(8, 16, 60, 4));
    let report = SolverReport {
        level: level(),
        solver_version: SOLVER_VERSION,
        kernel_f64_ginteractions_s: kernel,
        kernel_f32_ginteractions_s: single_rate(),
        plain_f64_ginteractions_s: plain,
        kernel_over_plain: kernel / plain,
        fma_peak_f64_gflops: peak,
        kernel_share_of_peak: kernel * OPERATIONS / peak,
        case_6x12_s: case(small),
        case_8x16_s: case(large),
        study: default_study(args.samples)?,
        slot_peak_rss_mb: Memory {
            case_8x16: memory::peak_mb(&large)?,
            production_sample: memory::peak_mb(&Settings::default())?,
        },
        scaling: args.scaling.then(|| scaling::measure(&flight(small))),
    };
    let mut out = Output::stdout();
    if args.json {
        out.json(&report)?;
    } else {
        print(&mut out, &report)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn print(out: &mut Output, r: &SolverReport) -> std::io::Result<()> {
    out.line(format_args!("one core, {}, median of three runs", r.level))?;
    let row = |what: &str, value: String| vec![what.to_owned(), value];
    let megabytes = |peak: Option<f64>| peak.map_or_else(|| "-".to_owned(), |mb| format!("{mb:.1}"));
    out.table(
        &["what".to_owned(), "value".to_owned()],
        &[
            row("kernel, 1e9 segment interactions/s", format!("{:.3}", r.kernel_f64_ginteractions_s)),
            row("the same in single precision (wake on wake)", format!("{:.3}", r.kernel_f32_ginteractions_s)),
            row("the same segment by segment, scalar", format!("{:.3}", r.plain_f64_ginteractions_s)),
            row("ratio", format!("{:.1}", r.kernel_over_plain)),
            row("multiply-add peak, 1e9 operations/s", format!("{:.1}", r.fma_peak_f64_gflops)),
            row("kernel's share of it", format!("{:.2}", r.kernel_share_of_peak)),
            row("6 x 12 panels, 40 steps, 3 strokes, whole wake, s", format!("{:.3}", r.case_6x12_s)),
            row("8 x 16 panels, 60 steps, 4 strokes, whole wake, s", format!("{:.2}", r.case_8x16_s)),
            row(
                &format!("one sample at the default settings, mean of {} strokes, s", cost::STROKES),
                format!("{:.3}", r.study.production_sample_s),
            ),
            row(
                &format!("{} samples on {} cores", r.study.study_samples, r.study.cores),
                span(r.study.study_estimate_s),
            ),
            row("memory of a slot after 8 x 16, MB", megabytes(r.slot_peak_rss_mb.case_8x16)),
            row("memory of a slot after a sample, MB", megabytes(r.slot_peak_rss_mb.production_sample)),
        ],
    )?;
    r.scaling.as_deref().map_or(Ok(()), |rows| scaling::print(out, rows))
}
