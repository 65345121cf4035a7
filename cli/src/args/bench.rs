//! `manduca bench ...`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

/// `manduca bench ...`.
#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// The vortex lattice: its kernel, whole cases, and what a study would take here.
    Solver(BenchSolverArgs),
    /// The network: an iteration of its training, its memory, its use.
    Surrogate(BenchSurrogateArgs),
    /// What features, methods, ensembles and samples are worth: errors on a second dataset.
    Accuracy(BenchAccuracyArgs),
    /// The coordinator: jobs leased and taken back per second, and what idle workers cost.
    Queue(BenchQueueArgs),
}

/// `manduca bench solver`.
#[derive(Debug, Args)]
#[command(after_help = "\
Times are of one core; a study uses all. The estimate is that of `study submit --dry-run` for
a study with the default settings: samples x seconds of a sample / cores.

Examples:
  manduca bench solver --samples 2000
  manduca bench solver --scaling        what panels, steps, strokes and wake cost")]
pub struct BenchSolverArgs {
    /// Samples of the study whose time is estimated.
    #[arg(long, value_name = "N", default_value_t = 5000)]
    pub samples: u32,
    /// Also show how time and work grow with panels, steps, strokes and rows of wake.
    #[arg(long)]
    pub scaling: bool,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// `manduca bench surrogate`.
#[derive(Debug, Args)]
#[command(after_help = "\
Trains on strokes flown by blade elements, four fifths of the samples given.

Example:
  manduca bench surrogate --json")]
pub struct BenchSurrogateArgs {
    /// Neurons of the hidden layer.
    #[arg(long, value_name = "N", default_value_t = 500)]
    pub neurons: usize,
    /// Samples; four fifths of them are fitted.
    #[arg(long, value_name = "N", default_value_t = 5000)]
    pub samples: usize,
    /// Iterations whose middle time is told.
    #[arg(long, value_name = "N", default_value_t = 5)]
    pub iterations: usize,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// What the networks learn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs)]
pub enum FeaturesChoice {
    Physical,
    Paper,
}

/// How the networks' weights are searched, or that there is no network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs)]
pub enum MethodChoice {
    VariableProjection,
    LevenbergMarquardt,
    GaussianProcess,
}

/// `manduca bench accuracy`.
#[derive(Debug, Args)]
#[command(after_help = "\
Datasets are what `manduca dataset` writes, CSV by the ending of the name, else NDJSON. The
second should be of long flights with small standard errors. Without them blade elements
stand in. Networks are fitted to nine tenths of the samples, one tenth says when to stop; a gaussian
process is fitted to all.

Examples:
  manduca bench accuracy --train samples.csv --test truth.csv
  manduca bench accuracy --sizes 500,1000 --methods variable-projection --neurons 100")]
pub struct BenchAccuracyArgs {
    /// Dataset to train on; its first samples are the smaller trainings.
    #[arg(long, value_name = "FILE", requires = "test")]
    pub train: Option<PathBuf>,
    /// Dataset to judge by.
    #[arg(long, value_name = "FILE", requires = "train")]
    pub test: Option<PathBuf>,
    /// Preset of the insect which flew.
    #[arg(long, default_value = "hawkmoth")]
    pub insect: String,
    /// How many samples; those beyond the dataset are left out.
    #[arg(long, value_delimiter = ',', default_values_t = [500, 1000, 2000, 5000])]
    pub sizes: Vec<usize>,
    /// Features.
    #[arg(long, value_delimiter = ',', default_values = ["paper", "physical"])]
    pub features: Vec<FeaturesChoice>,
    /// Methods.
    #[arg(long, value_delimiter = ',', default_values = ["levenberg-marquardt", "variable-projection", "gaussian-process"])]
    pub methods: Vec<MethodChoice>,
    /// Sizes of ensembles.
    #[arg(long, value_delimiter = ',', default_values_t = [1, 3])]
    pub ensembles: Vec<usize>,
    /// Neurons of each network.
    #[arg(long, default_value_t = 500)]
    pub neurons: usize,
    /// Most iterations of each network.
    #[arg(long, default_value_t = 200)]
    pub max_iterations: usize,
    /// Iterations without a better validation error before it stops.
    #[arg(long, default_value_t = 6)]
    pub patience: usize,
    /// Print one JSON object per row.
    #[arg(long)]
    pub json: bool,
}

/// `manduca bench queue`.
#[derive(Debug, Args)]
#[command(after_help = "\
Starts a coordinator as a process of its own and plays the workers: each exchange returns
results of 1 KB, on disk before they are acknowledged, and takes as many jobs. The clients
share this machine's cores with it. Each number is the best of --runs.

Examples:
  manduca bench queue --json
  manduca bench queue --jobs 1000000        with a million jobs in the store
  manduca bench queue --folder /data        on the disk which is to be used")]
pub struct BenchQueueArgs {
    /// Jobs in the store when a run begins.
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    pub jobs: u64,
    /// Runs per batch size.
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub runs: u32,
    /// Workers which wait for work; 0 leaves this out.
    #[arg(long, value_name = "N", default_value_t = 5000)]
    pub idle: usize,
    /// Folder of the databases, which are removed afterwards.
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub folder: PathBuf,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}
