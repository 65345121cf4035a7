//! The command line.

mod analyse;
mod bench;
mod fetch;
mod model;
mod operate;
mod optimise;
mod record;
mod report;
mod solver;
mod token;
mod variables;

pub use analyse::{AnalyseCommand, FrontArgs, PopulationArgs, SobolArgs, SubjectArgs, SweepArgs, WeightChoice};
pub use bench::{
    BenchAccuracyArgs, BenchCommand, BenchQueueArgs, BenchSolverArgs, BenchSurrogateArgs, FeaturesChoice, MethodChoice,
};
pub use fetch::{CompletionsArgs, DatasetArgs, DatasetFormat, FiguresArgs, SurrogateArgs, SurrogateFormat};
pub use model::{Model, ModelArgs};
pub use operate::{
    BackupArgs, CheckArgs, DbCommand, DisownArgs, DoctorArgs, DrainArgs, ExplainArgs, PruneArgs, ReadmitArgs,
    WorkerListArgs, WorkersCommand,
};
pub use optimise::{Method, OptimiseArgs};
pub use record::RecordArgs;
pub use report::{FiveArgs, ReportArgs, ReportCommand, ReproductionArgs};
pub use solver::SolverOptions;
pub use token::{CreateTokenArgs, RevokeTokenArgs, TokenCommand, TokenListArgs};
pub use variables::parse;

use std::path::PathBuf;

use clap::{ArgAction, Args, Parser, Subcommand, ValueEnum};
use manduca_server::Host;
use manduca_worker::DRAIN_TIMEOUT;

const EXAMPLES: &str = "\
Examples:
  manduca run                      a whole small study in this process, then its optimum
  manduca run paper --slots 8      the paper's study; Ctrl-C stops, the same line goes on
  manduca simulate --case all      the paper's five strokes, flown, beside its numbers
  manduca serve                    a coordinator ...
  manduca worker --coordinator http://host:8080          ... machines which work for it
  manduca study submit my.toml     ... and a study for them

Exit codes: 0 done, 1 failed, 2 usage or refused input, 130 interrupted.
Log lines on standard error: -v, -vv, -q, or MANDUCA_LOG / RUST_LOG (such as `info,sqlx=warn`).";

/// Finds the wing strokes on which a hawkmoth, or any flapping insect or robot,
/// hovers at least power: strokes are sampled, flown with a vortex lattice on
/// any number of machines, learnt by a neural network, optimised on it, and the
/// optimum is flown again.
#[derive(Debug, Parser)]
#[command(name = "manduca", version, about, after_help = EXAMPLES, arg_required_else_help = true)]
pub struct Cli {
    /// Say more on standard error (-v, -vv, -vvv).
    #[arg(short, long, global = true, action = ArgAction::Count)]
    pub verbose: u8,
    /// How log lines are written.
    #[arg(long, global = true, value_enum, default_value_t = LogFormat::Text, env = "MANDUCA_LOG_FORMAT")]
    pub log_format: LogFormat,
    /// Say nothing on standard error but errors.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// How log lines are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    /// For people.
    Text,
    /// One JSON object per line.
    Json,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Do a whole study here: sample, train, optimise, fly the optimum again.
    Run(RunArgs),
    /// Be the coordinator: take studies, lease their jobs to workers, keep the results.
    Serve(ServeArgs),
    /// Compute jobs for a coordinator.
    Worker(WorkerArgs),
    /// Make, list and revoke the tokens a coordinator asks for.
    #[command(subcommand)]
    Token(TokenCommand),
    /// Copy, check and prune a coordinator's database.
    #[command(subcommand)]
    Db(DbCommand),
    /// List and drain the workers of a coordinator.
    #[command(subcommand)]
    Workers(WorkersCommand),
    /// Say why a job is where it is.
    Explain(ExplainArgs),
    /// Look for what could keep this machine from working.
    Doctor(DoctorArgs),
    /// Submit, watch and steer studies of a coordinator.
    #[command(subcommand)]
    Study(StudyCommand),
    /// Write the dataset of a study.
    Dataset(DatasetArgs),
    /// Draw every plot of a study, as SVG and PNG.
    Figures(FiguresArgs),
    /// Show the optima of a study beside the paper's.
    Optimum(TargetArgs),
    /// Ask a finished study for a further optimum on its network.
    Optimise(OptimiseArgs),
    /// Ask a study's surrogate what the optimum depends on: fronts, indices, sweeps.
    #[command(subcommand)]
    Analyse(AnalyseCommand),
    /// Fly one stroke and print its means.
    Simulate(SimulateArgs),
    /// List the insect presets, or print one as a table to copy.
    Insects(InsectsArgs),
    /// List the solver's settings with ranges and defaults.
    Settings(SettingsArgs),
    /// Print what makes a shell complete this command's words.
    Completions(CompletionsArgs),
    /// Measure this machine.
    #[command(subcommand)]
    Bench(BenchCommand),
    /// Compute what the numbers are worth and write it as a document.
    #[command(subcommand)]
    Report(ReportCommand),
    /// Ask a coordinator whether it is well; exit code 0 if so.
    #[command(hide = true)]
    Healthcheck(HealthcheckArgs),
    /// A compute slot; workers start it.
    #[command(hide = true)]
    Slot,
}

/// `manduca run`.
#[derive(Debug, Args)]
#[command(after_help = "\
The study runs as a service does, in one process: a coordinator on a loopback port, which shows
the dashboard, its database under --data, and a worker with child processes. Where a coordinator
has that folder already, the study is submitted there, and this process works for it. Interrupted by Ctrl-C (finish
the running jobs) or even by a power cut, the same command goes on where it was.

Examples:
  manduca run                            the built-in `quick`
  manduca run paper --data /big/paper    the full study of the paper
  manduca run my.toml --json > my.json   the answer as one JSON object")]
pub struct RunArgs {
    /// A study file (TOML or JSON), or a built-in study: quick, paper, five, five-direct, truth.
    #[arg(default_value = "quick")]
    pub study: String,
    /// Folder of the database.
    #[arg(long, value_name = "DIR", default_value = "manduca-data", env = "MANDUCA_DATA")]
    pub data: PathBuf,
    /// Jobs computed at the same time [default: one per core].
    #[arg(long, value_name = "N", env = "MANDUCA_SLOTS")]
    pub slots: Option<usize>,
    /// Print one JSON object instead of tables.
    #[arg(long)]
    pub json: bool,
}

/// `manduca serve`.
#[derive(Debug, Args)]
#[command(after_help = "\
On loopback whoever has an account here may submit studies and take jobs. At any other address
a token is asked for: one made by `manduca token create`, or the one given here, which allows
everything. Put a proxy in front for TLS (docs/operations.md). Where no tokens are asked for, only
requests for this machine's own names are answered, and none that a page of another site sends.

Examples:
  manduca serve
  manduca token create cluster --scope worker --out worker-token
  manduca serve --listen 0.0.0.0:8080 --data /var/lib/manduca
  MANDUCA_TOKEN=... manduca serve --listen 0.0.0.0:8080
  manduca serve --listen 10.0.0.5:8080 --insecure       no tokens: a network you trust")]
pub struct ServeArgs {
    /// Address to listen on.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8080", env = "MANDUCA_LISTEN")]
    pub listen: String,
    /// Folder of the database.
    #[arg(long, value_name = "DIR", default_value = "manduca-data", env = "MANDUCA_DATA")]
    pub data: PathBuf,
    /// File with a token which allows everything, beside those of the database. The variable
    /// MANDUCA_TOKEN may hold the token itself.
    #[arg(long, value_name = "FILE", env = "MANDUCA_TOKEN_FILE")]
    pub token_file: Option<PathBuf>,
    /// Ask for tokens on loopback too, such as behind a proxy.
    #[arg(long, conflicts_with = "insecure")]
    pub require_tokens: bool,
    /// Listen on an address others can reach, without asking for tokens.
    #[arg(long)]
    pub insecure: bool,
    /// A further host name or address under which requests are answered where no tokens are asked for, beside
    /// localhost, 127.0.0.0/8 and `[::1]`; may be given more than once. Every port is taken. The variable
    /// separates several by commas.
    #[arg(long, value_name = "NAME", value_delimiter = ',', env = "MANDUCA_ALLOW_HOST")]
    pub allow_host: Vec<Host>,
    /// Remove studies this many days after their end [default: never].
    #[arg(long, value_name = "N", value_parser = days, env = "MANDUCA_KEEP_DAYS")]
    pub keep_days: Option<f64>,
    /// Longest time one simulation may compute, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 600.0, value_parser = seconds)]
    pub run_limit: f64,
    /// How long a worker may be unheard of before its jobs are given to others, s. Workers are
    /// asked to renew three times as often.
    #[arg(long, value_name = "SECONDS", default_value_t = 15.0, value_parser = lease)]
    pub lease: f64,
    /// Failures after which a job is given up. Workers which are lost do not count: a job is given
    /// up with the tenth that dies of it.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub max_attempts: u32,
}

/// `manduca worker`.
#[derive(Debug, Args)]
#[command(after_help = "\
A worker may come and go at any time. On Ctrl-C or SIGTERM it finishes its jobs within
--drain-timeout, delivers them and leaves; a second signal makes it leave at once and its
jobs are computed elsewhere. It ends at most 15 s after that time, so a batch system's limit
should be --max-runtime, --drain-timeout and 15 s.

Exit codes: 0 it left as told; 1 it left without having been registered, or with results which
it could not deliver; 2 the coordinator refuses it: another version, no valid token.

Examples:
  manduca worker --coordinator http://10.0.0.5:8080 --token-file worker-token --slots 16
  manduca worker --idle-exit 300 --max-runtime 14300     in a batch job of four hours")]
pub struct WorkerArgs {
    #[command(flatten)]
    pub coordinator: Coordinator,
    /// Jobs computed at the same time [default: one per core].
    #[arg(long, value_name = "N", env = "MANDUCA_SLOTS")]
    pub slots: Option<usize>,
    /// Name for people [default: the host's].
    #[arg(long)]
    pub name: Option<String>,
    /// Leave after so many seconds without a job, whether the coordinator can be reached or not.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, env = "MANDUCA_IDLE_EXIT")]
    pub idle_exit: Option<f64>,
    /// After so many seconds finish what runs and leave, such as before a batch system's limit.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, env = "MANDUCA_MAX_RUNTIME")]
    pub max_runtime: Option<f64>,
    /// How long a worker which is to leave may still compute and deliver. What runs then is given
    /// back, a training with its last checkpoint, and computed elsewhere.
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = DRAIN_TIMEOUT.as_secs_f64(),
        value_parser = seconds,
        env = "MANDUCA_DRAIN_TIMEOUT"
    )]
    pub drain_timeout: f64,
}

/// A lease: short ones would be lost to a busy machine, long ones leave dead workers' jobs lying.
fn lease(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|e| format!("{e}"))?;
    if (1.0..=3600.0).contains(&seconds) { Ok(seconds) } else { Err("is outside 1 to 3600".into()) }
}

/// A number of days.
fn days(text: &str) -> Result<f64, String> {
    let days: f64 = text.parse().map_err(|e| format!("{e}"))?;
    if (0.0..=36_525.0).contains(&days) { Ok(days) } else { Err("is outside 0 to 36525".into()) }
}

/// A number of seconds, at least a tenth.
fn seconds(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|e| format!("{e}"))?;
    if (0.1..=1e9).contains(&seconds) { Ok(seconds) } else { Err("is outside 0.1 to 1e9".into()) }
}

/// Where the coordinator is.
#[derive(Debug, Clone, Args)]
pub struct Coordinator {
    /// Address of the coordinator.
    #[arg(
        long = "coordinator",
        value_name = "URL",
        default_value = "http://127.0.0.1:8080",
        env = "MANDUCA_COORDINATOR"
    )]
    pub url: String,
    /// File with the token the coordinator asks for. The variable MANDUCA_TOKEN may hold the
    /// token itself; the command line never does, for others can read it.
    #[arg(long, value_name = "FILE", env = "MANDUCA_TOKEN_FILE")]
    pub token_file: Option<PathBuf>,
}

/// `manduca study ...`.
#[derive(Debug, Subcommand)]
pub enum StudyCommand {
    /// Submit a study file (TOML or JSON) or a built-in study.
    Submit(SubmitArgs),
    /// List studies, the newest last.
    List(ListArgs),
    /// Show one study.
    Show(TargetArgs),
    /// Follow a study until it ends; Ctrl-C stops following, not the study.
    Watch(TargetArgs),
    /// Lease no more of its jobs for now.
    Pause(TargetArgs),
    /// Go on with a paused study.
    Resume(TargetArgs),
    /// Stop it for good; its results are kept.
    Cancel(TargetArgs),
    /// Try its dead jobs again.
    RetryFailed(TargetArgs),
    /// Write its surrogate: as JSON, or as an ONNX model which other programs run.
    Model(SurrogateArgs),
}

/// `manduca study submit`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  manduca study submit my.toml --dry-run    is it right, and how long would it take here?
  manduca study submit my.toml --wait       submit, follow, print the optimum")]
pub struct SubmitArgs {
    /// A study file, or a built-in study: quick, paper, five, five-direct, truth.
    pub study: String,
    #[command(flatten)]
    pub coordinator: Coordinator,
    /// Check it here by the coordinator's rules, show every setting, and time a few of its samples
    /// to say how long sampling would take on this machine. Asks no coordinator, stores nothing.
    #[arg(long, conflicts_with = "wait")]
    pub dry_run: bool,
    /// Follow it to its end and print its optimum.
    #[arg(long)]
    pub wait: bool,
    /// Submissions with the same key are one study.
    #[arg(long, value_name = "KEY")]
    pub idempotency_key: Option<String>,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// `manduca study list`.
#[derive(Debug, Args)]
pub struct ListArgs {
    #[command(flatten)]
    pub coordinator: Coordinator,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// A study to show or steer.
#[derive(Debug, Args)]
pub struct TargetArgs {
    /// Its id, the end of its id, or `latest`.
    #[arg(value_name = "STUDY")]
    pub study: String,
    #[command(flatten)]
    pub coordinator: Coordinator,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// `manduca simulate`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  manduca simulate                                 the hovering moth as measured
  manduca simulate --case all                      all five strokes of the paper
  manduca simulate --set frequency_hz=30 --set stroke_plane_deg=0
  manduca simulate --spanwise-panels 16 --steps-per-stroke 96 --strokes 12 --json
  manduca simulate --insect-set wing_mass_kg=0     a wing without inertia
  manduca simulate --history lift.csv              lift and power at every step
  manduca simulate --wake wake.json --wake-steps 7:0,last    the vortex rings of two steps
  manduca simulate --vtk flight                    the last stroke for ParaView: flight/flight.pvd")]
pub struct SimulateArgs {
    /// Stroke to start from: reference, optimum-1, optimum-2, five-direct, five-ann, or all of them.
    #[arg(long, default_value = "reference", value_parser = model::case_names())]
    pub case: String,
    /// Change one of the ten parameters, by its name or its symbol, such as f or beta.
    #[arg(long, value_name = "NAME=VALUE", value_parser = model::assignment)]
    pub set: Vec<(String, f64)>,
    #[command(flatten)]
    pub record: RecordArgs,
    #[command(flatten)]
    pub model: ModelArgs,
    /// Print one JSON object; an infeasible stroke is an answer, exit code 0.
    #[arg(long)]
    pub json: bool,
}

/// `manduca insects`.
#[derive(Debug, Args)]
pub struct InsectsArgs {
    /// A preset to print in full.
    pub name: Option<String>,
    /// Print one JSON object: every preset, or the one named, in full.
    #[arg(long)]
    pub json: bool,
}

/// `manduca settings`.
#[derive(Debug, Args)]
pub struct SettingsArgs {
    /// Model whose settings are listed.
    #[arg(long, value_enum, default_value_t = Model::Uvlm)]
    pub model: Model,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// `manduca healthcheck`.
#[derive(Debug, Args)]
pub struct HealthcheckArgs {
    /// What to ask.
    #[arg(long, default_value = "http://127.0.0.1:8080/healthz")]
    pub url: String,
}

#[cfg(test)]
mod page;
#[cfg(test)]
mod tests;
