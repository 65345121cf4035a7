//! Options of `manduca report`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::Coordinator;

/// `manduca report ...`.
#[derive(Debug, Subcommand)]
pub enum ReportCommand {
    /// Canonical checks, the published strokes and what they are sensitive to.
    Verification(ReportArgs),
    /// What the means owe to panels, steps, cores and wake; standard errors; smoothness.
    Convergence(ConvergenceArgs),
    /// A finished study beside the paper: surrogate, optima, penalty, population.
    Reproduction(ReproductionArgs),
    /// Five parameters by direct search and on a surrogate, beside the paper's Table 4.
    Five(FiveArgs),
}

/// `manduca report reproduction`.
#[derive(Debug, Args)]
#[command(after_help = "\
Fetches the study from a coordinator and searches on its surrogate here; the searches of the
default numbers keep two cores busy for some minutes.

Example:
  manduca run paper --data paper && manduca serve --data paper &
  manduca report reproduction latest
  manduca report reproduction latest --truth truth.csv         with errors on strokes flown long")]
pub struct ReproductionArgs {
    /// A study: its id, the end of its id, or `latest`.
    pub study: String,
    /// Dataset of strokes flown long (`studies/truth.toml`), CSV or NDJSON: the surrogate is judged by them.
    #[arg(long, value_name = "FILE")]
    pub truth: Option<PathBuf>,
    #[command(flatten)]
    pub coordinator: Coordinator,
    #[command(flatten)]
    pub report: ReportArgs,
    /// Population of the sweep of the penalty.
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    pub population: usize,
    /// Populations of Fig. 7.
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values_t = [1_000, 10_000, 100_000, 500_000])]
    pub populations: Vec<usize>,
    /// Runs of each population.
    #[arg(long, value_name = "N", default_value_t = 5)]
    pub runs: u64,
}

/// `manduca report five`.
#[derive(Debug, Args)]
#[command(after_help = "\
Fetches two finished studies from a coordinator; nothing is computed again.

Example:
  manduca run five-direct --data five && manduca run five --data five && manduca serve --data five &
  manduca report five 7c31 9f04")]
pub struct FiveArgs {
    /// A finished `five-direct`, or any study with a direct optimisation: its id, or the end of it.
    pub direct: String,
    /// A finished `five`, or any study with an optimum of its surrogate: its id, or the end of it.
    pub surrogate: String,
    #[command(flatten)]
    pub coordinator: Coordinator,
    #[command(flatten)]
    pub report: ReportArgs,
}

/// `manduca report convergence`.
#[derive(Debug, Args)]
#[command(after_help = "\
The document in docs/ is of the default numbers, which keep two cores busy for about an hour.")]
pub struct ConvergenceArgs {
    #[command(flatten)]
    pub report: ReportArgs,
    /// Random strokes beside the published ones.
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub strokes: u64,
    /// Random strokes whose standard errors are tried.
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub errors: u64,
    /// Random lines along which smoothness is tried.
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub lines: u64,
}

/// `manduca report verification`.
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// Folder of the document and of its `figures`.
    #[arg(short, long, value_name = "DIR", default_value = "docs")]
    pub output: PathBuf,
    /// Print one JSON object: the files written.
    #[arg(long)]
    pub json: bool,
}
