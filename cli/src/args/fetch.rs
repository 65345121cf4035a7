//! Options of commands which fetch something to keep.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use clap_complete::Shell;

use super::Coordinator;

/// `manduca dataset`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  manduca dataset latest -o samples.parquet    typed columns with units, study and model inside
  manduca dataset latest --format ndjson | head -1")]
pub struct DatasetArgs {
    /// Id of the study, the end of its id, or `latest`.
    #[arg(value_name = "STUDY")]
    pub study: String,
    #[command(flatten)]
    pub coordinator: Coordinator,
    /// csv: one row per sample; ndjson: one object per line; json: one array of them; parquet: typed
    /// columns with units, for tables of pandas, Arrow, MATLAB [default: by the file's ending, else csv].
    #[arg(long, value_enum)]
    pub format: Option<DatasetFormat>,
    /// Write to this file instead of standard output; .csv, .ndjson, .json or .parquet says how.
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Add who computed each row: worker, token, the job that was computed, level and time.
    #[arg(long)]
    pub provenance: bool,
}

/// How a dataset is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs)]
pub enum DatasetFormat {
    Csv,
    Json,
    Ndjson,
    Parquet,
}

/// `manduca study model`.
#[derive(Debug, Args)]
#[command(after_help = "\
The ONNX model maps a table `parameters` of doubles (a row per stroke, ten columns in the order of
the dataset) to a table `means` of L+, D+, M+, P+; names and units are in its metadata. A gaussian
process has no such form.

Examples:
  manduca study model latest -o net.onnx
  manduca study model latest > net.json")]
pub struct SurrogateArgs {
    /// Id of the study, the end of its id, or `latest`.
    #[arg(value_name = "STUDY")]
    pub study: String,
    #[command(flatten)]
    pub coordinator: Coordinator,
    /// json: every number, as the REST interface has it; onnx [default: by the file's ending, else json].
    #[arg(long, value_enum)]
    pub format: Option<SurrogateFormat>,
    /// Write to this file instead of standard output; .json or .onnx says how.
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
}

/// How a surrogate is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs)]
pub enum SurrogateFormat {
    Json,
    Onnx,
}

/// `manduca figures`.
#[derive(Debug, Args)]
#[command(after_help = "\
Draws what there is, also of a study under way: training curve, prediction over simulation,
distributions of the samples, how optima were refined, and lift, drag, power, angles and tip path
over a stroke of each optimum, flown here with the study's model.

Example:
  manduca figures latest -o figures --population")]
pub struct FiguresArgs {
    /// Id of the study, the end of its id, or `latest`.
    #[arg(value_name = "STUDY")]
    pub study: String,
    #[command(flatten)]
    pub coordinator: Coordinator,
    /// Folder of the files.
    #[arg(short, long, value_name = "DIR", default_value = "figures")]
    pub output: PathBuf,
    /// Draw what the genetic algorithm finds by the size of its population, too (Fig. 7 of the
    /// paper): it is searched for here, which takes minutes.
    #[arg(long)]
    pub population: bool,
    /// Pixels of a PNG to each unit of its SVG.
    #[arg(long, value_name = "FACTOR", default_value_t = 2.0, value_parser = scale)]
    pub scale: f32,
    /// Print the files written as one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// A scale which gives pictures one can look at.
fn scale(text: &str) -> Result<f32, String> {
    let scale: f32 = text.parse().map_err(|e| format!("{e}"))?;
    if (0.25..=8.0).contains(&scale) { Ok(scale) } else { Err("is outside 0.25 to 8".into()) }
}

/// `manduca completions`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  manduca completions bash > ~/.local/share/bash-completion/completions/manduca
  manduca completions zsh > ~/.zfunc/_manduca                 with ~/.zfunc in fpath
  manduca completions fish > ~/.config/fish/completions/manduca.fish")]
pub struct CompletionsArgs {
    /// Which shell.
    pub shell: Shell,
}
