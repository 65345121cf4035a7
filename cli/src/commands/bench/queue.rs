//! `manduca bench queue`: how many jobs a coordinator on this machine hands out
//! and takes back, everything on disk before it is answered.
//!
//! The coordinator is a process of its own, started as users start it. This
//! process plays the workers and shares the machine's cores with it.

mod disk;
mod exchange;
mod idle;
mod load;
mod process;

pub use disk::syncs_per_s;

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Result, bail};
use serde::Serialize;

use crate::args::BenchQueueArgs;
use crate::exit::refused;
use crate::output::{Output, note};
use load::Run;
use process::Coordinator;

/// Jobs in an exchange, and clients which exchange at the same time.
const CASES: [(u32, usize); 3] = [(1, 64), (16, 64), (100, 8)];
/// Most jobs of one run.
const MOST: u64 = 20_000;

/// What `bench queue` found. The keys of the first five fields are stable.
#[derive(Debug, Serialize)]
struct Report {
    batch_1_jobs_s: f64,
    batch_16_jobs_s: f64,
    batch_100_jobs_s: f64,
    /// At batch 16.
    claim_p99_ms: f64,
    /// At batch 16; none where the system does not tell.
    cpu_us_per_job: Option<f64>,
    /// Of the folder, 4 KiB each.
    fdatasync_per_s: f64,
    /// Jobs per second taken by the submission of one large study.
    submission_jobs_s: f64,
    /// Studies of 20 samples per second, eight clients.
    submission_studies_s: f64,
    /// Jobs in the store when a run begins, at least.
    stored_jobs: u64,
    result_bytes: usize,
    cores: usize,
    /// One-minute load average before the first run.
    load_average: Option<f64>,
    /// The best run of each batch.
    runs: Vec<Run>,
    #[serde(skip_serializing_if = "Option::is_none")]
    idle: Option<idle::Idle>,
}

/// Measures and prints.
pub async fn queue(args: &BenchQueueArgs) -> Result<ExitCode> {
    if args.jobs < 1000 {
        return Err(refused("--jobs: fewer than 1000 jobs end before they can be timed"));
    }
    std::fs::create_dir_all(&args.folder)?;
    let load_average = process::load_average();
    let fdatasync_per_s = syncs_per_s(&args.folder)?;
    note(format_args!("{fdatasync_per_s:.0} fdatasync/s in {}", args.folder.display()));
    let mut bench = Bench { args, running: None, submission_jobs_s: 0.0, seed: 0 };
    let mut runs = Vec::new();
    for (batch, clients) in CASES {
        runs.push(bench.best(batch, clients).await?);
    }
    let (coordinator, _) = bench.with_ready(0).await?;
    let submission_studies_s = load::small_studies(coordinator.url()).await?;
    let submission_jobs_s = bench.submission_jobs_s;
    drop(bench);
    let idle = if args.idle > 0 { Some(idle::measure(&args.folder, args.idle).await?) } else { None };
    let of = |batch: u32| runs.iter().find(|r| r.batch == batch).map_or(0.0, |r| r.jobs_s);
    let report = Report {
        batch_1_jobs_s: of(1),
        batch_16_jobs_s: of(16),
        batch_100_jobs_s: of(100),
        claim_p99_ms: runs[1].claim_p99_ms,
        cpu_us_per_job: runs[1].cpu_us_per_job,
        fdatasync_per_s,
        submission_jobs_s,
        submission_studies_s,
        stored_jobs: args.jobs,
        result_bytes: exchange::result_bytes(),
        cores: std::thread::available_parallelism().map_or(1, usize::from),
        load_average,
        runs,
        idle,
    };
    let mut out = Output::stdout();
    if args.json {
        out.json(&report)?
    } else {
        print(&mut out, &report)?
    }
    Ok(ExitCode::SUCCESS)
}

/// Coordinators one after the other, each with a backlog of the size asked for.
struct Bench<'a> {
    args: &'a BenchQueueArgs,
    /// With the number of its jobs still ready.
    running: Option<(Coordinator, u64)>,
    submission_jobs_s: f64,
    seed: u64,
}

impl Bench<'_> {
    /// The fastest of several runs: others share the machine.
    async fn best(&mut self, batch: u32, clients: usize) -> Result<Run> {
        // A tenth stays, or the study would go on to its training.
        let jobs = (self.args.jobs * 9 / 10).min(MOST);
        let mut best: Option<Run> = None;
        for _ in 0..self.args.runs.max(1) {
            let (coordinator, ready) = self.with_ready(jobs + jobs / 10).await?;
            let run = load::run(coordinator, batch, clients, jobs).await?;
            *ready = ready.saturating_sub(jobs + u64::from(batch) * clients as u64);
            note(format_args!(
                "batch {batch}, {clients} clients: {:.0} jobs/s, claim p50 {:.1} ms, p99 {:.1} ms, {:.0} us of CPU per job",
                run.jobs_s,
                run.claim_p50_ms,
                run.claim_p99_ms,
                run.cpu_us_per_job.unwrap_or(f64::NAN)
            ));
            if best.as_ref().is_none_or(|b| run.jobs_s > b.jobs_s) {
                best = Some(run);
            }
        }
        let Some(best) = best else { bail!("nothing was run") };
        Ok(best)
    }

    /// A coordinator with at least so many ready jobs: the present one, or a fresh one.
    async fn with_ready(&mut self, least: u64) -> Result<(&mut Coordinator, &mut u64)> {
        if self.running.as_ref().is_none_or(|(_, ready)| *ready < least) {
            self.running = None;
            let coordinator = Coordinator::start(&self.args.folder)?;
            let filled = load::fill(coordinator.url(), self.args.jobs, &mut self.seed).await?;
            self.submission_jobs_s = self.submission_jobs_s.max(filled);
            self.running = Some((coordinator, self.args.jobs));
        }
        match &mut self.running {
            Some((coordinator, ready)) => Ok((coordinator, ready)),
            None => bail!("no coordinator runs"),
        }
    }
}

fn print(out: &mut Output, r: &Report) -> std::io::Result<()> {
    out.line(format_args!(
        "{} cores shared with the clients, load average {} before, {} B results, {} jobs stored, synchronous = full",
        r.cores,
        r.load_average.map_or_else(|| "-".into(), |l| format!("{l:.2}")),
        r.result_bytes,
        r.stored_jobs
    ))?;
    let head = ["batch", "clients", "jobs/s", "claim p50, ms", "claim p99, ms", "CPU, us/job"].map(str::to_owned);
    let rows: Vec<Vec<String>> = r.runs.iter().map(Run::row).collect();
    out.table(&head, &rows)?;
    let row = |what: &str, value: String| vec![what.to_owned(), value];
    let mut rows = vec![
        row("fdatasync of the disk, /s", format!("{:.0}", r.fdatasync_per_s)),
        row("submission of one study, jobs/s", format!("{:.0}", r.submission_jobs_s)),
        row("submission of small studies, studies/s", format!("{:.0}", r.submission_studies_s)),
    ];
    if let Some(idle) = &r.idle {
        rows.extend(idle.rows());
    }
    out.line("")?;
    out.table(&["what".to_owned(), "value".to_owned()], &rows)
}

/// A folder for one coordinator, gone with it.
fn temporary(below: &Path) -> Result<tempfile::TempDir> {
    Ok(tempfile::Builder::new().prefix("manduca-bench-").tempdir_in(below)?)
}
