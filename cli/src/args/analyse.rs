//! Options of `manduca analyse`.

use clap::{Args, Subcommand, ValueEnum};
use manduca_numerics::parameters;
use manduca_protocol::names::unknown_parameter;

use super::Coordinator;

/// `manduca analyse ...`.
#[derive(Debug, Subcommand)]
#[command(after_help = "\
The study's surrogate is fetched and searched on this machine: no job is queued, nothing is
flown, nothing is stored. What these say of an optimum is worth what the surrogate is worth there.")]
pub enum AnalyseCommand {
    /// Least power against a bound of one parameter (epsilon-constraint front).
    Front(FrontArgs),
    /// Each parameter's share in the variance of lift, drag, moment and power.
    Sobol(SobolArgs),
    /// What the genetic algorithm finds with other weights of the penalty (paper Table 3).
    Sweep(SweepArgs),
    /// What the genetic algorithm finds with other populations (paper Fig. 7).
    Population(PopulationArgs),
}

/// What is analysed, and how the answer is written.
#[derive(Debug, Args)]
pub struct SubjectArgs {
    /// Id of a study with a surrogate, the end of its id, or `latest`.
    #[arg(value_name = "STUDY")]
    pub study: String,
    /// Search as this optimisation of the study does, within its bounds [default: the study's bounds].
    #[arg(long, value_name = "NAME")]
    pub optimisation: Option<String>,
    /// Seed of what is random [default: the study's].
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    #[command(flatten)]
    pub coordinator: Coordinator,
    /// Print comma-separated values, all digits.
    #[arg(long, conflicts_with = "json")]
    pub csv: bool,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// `manduca analyse front`.
#[derive(Debug, Args)]
#[command(after_help = "\
Below the optimum's own value a limit is a most, above it a least: every limit costs power.
`price` is by how much P+ rises per unit by which the limit is raised.

Examples:
  manduca analyse front latest --quantity frequency_hz
  manduca analyse front latest --quantity stroke_plane_deg --limits 0,5,10,15,20 --csv > front.csv")]
pub struct FrontArgs {
    #[command(flatten)]
    pub subject: SubjectArgs,
    /// Parameter whose bound is moved, by name or symbol.
    #[arg(long, value_name = "NAME", value_parser = quantity)]
    pub quantity: usize,
    /// Values of the bound [default: --points of them, evenly over the box].
    #[arg(long, value_name = "LIST", value_delimiter = ',', allow_hyphen_values = true, conflicts_with = "points")]
    pub limits: Vec<f64>,
    /// How many values.
    #[arg(long, value_name = "N", default_value_t = 11, value_parser = clap::value_parser!(u32).range(2..=1000))]
    pub points: u32,
}

/// `manduca analyse sobol`.
#[derive(Debug, Args)]
#[command(after_help = "\
S is the share of an output's variance over the box which a parameter has alone, T the share in
which it takes part at all (Saltelli et al. 2010, Jansen 1999). Held parameters have none.

Example:
  manduca analyse sobol latest --base 65536")]
pub struct SobolArgs {
    #[command(flatten)]
    pub subject: SubjectArgs,
    /// Predictions are base x (free parameters + 2).
    #[arg(long, value_name = "N", default_value_t = 8192, value_parser = clap::value_parser!(u32).range(2..=10_000_000))]
    pub base: u32,
}

/// Which weight of the fitness is swept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum WeightChoice {
    /// Of violated trim.
    R,
    /// Of leaving the bounds.
    S,
}

/// `manduca analyse sweep`.
#[derive(Debug, Args)]
#[command(after_help = "\
The penalty is exact for every r above the largest price of trim, so what lies above the exact
optimum is what the search left.

Example:
  manduca analyse sweep latest --weight s --weights 1,5,25 --population 10000")]
pub struct SweepArgs {
    #[command(flatten)]
    pub subject: SubjectArgs,
    /// Which weight of the fitness.
    #[arg(long, value_enum, default_value_t = WeightChoice::R)]
    pub weight: WeightChoice,
    /// Its values.
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values_t = [2.0, 10.0, 20.0, 50.0, 100.0])]
    pub weights: Vec<f64>,
    /// Individuals of a generation.
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    pub population: usize,
    /// Most generations.
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub generations: usize,
}

/// `manduca analyse population`.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  manduca analyse population latest --populations 1000,10000 --runs 3")]
pub struct PopulationArgs {
    #[command(flatten)]
    pub subject: SubjectArgs,
    /// Populations.
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values_t = [1_000, 10_000, 100_000, 500_000])]
    pub populations: Vec<usize>,
    /// Runs of each, from seeds one after the other.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub runs: u64,
    /// Most generations.
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub generations: usize,
}

fn quantity(text: &str) -> Result<usize, String> {
    parameters::find(text).ok_or_else(|| unknown_parameter(text))
}
