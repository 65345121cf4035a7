//! Options of `manduca optimise`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use manduca_numerics::parameters;
use manduca_protocol::names::unknown_parameter;
use manduca_protocol::study::Range;

use super::Coordinator;

/// How an optimum is searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Method {
    /// Sequential quadratic programming: the constrained optimum itself.
    Sqp,
    /// Genetic algorithm and simplex.
    Paper,
    /// The genetic algorithm on simulations themselves; needs no network.
    Direct,
}

/// `manduca optimise`.
#[derive(Debug, Args)]
#[command(after_help = "\
Nothing is sampled or trained again: the study's network is searched, and the optimum flown.
`--method direct` asks no network: every individual of a genetic algorithm is flown, population x
generations simulations, by whatever workers there are.

Examples:
  manduca optimise latest --name steady --set stroke_plane_deg=15 --wait
  manduca optimise latest --name slow --set frequency_hz=15:22 --method paper
  manduca optimise latest --name flown --method direct --population 300 --generations 50
  manduca optimise latest case.toml      the fields of an [[optimisations]] table of a study")]
pub struct OptimiseArgs {
    /// Id of a finished study, the end of its id, or `latest`.
    #[arg(value_name = "STUDY")]
    pub study: String,
    /// The optimisation as TOML or JSON; options below change it.
    #[arg(value_name = "FILE", required_unless_present = "name")]
    pub file: Option<PathBuf>,
    /// Name, unique in the study.
    #[arg(long)]
    pub name: Option<String>,
    /// Hold a parameter at a value, or narrow its bounds: NAME=VALUE, NAME=LOW:HIGH. A name or a symbol, such
    /// as f or beta.
    #[arg(long, value_name = "NAME=RANGE", value_parser = range)]
    pub set: Vec<(String, Range)>,
    /// How to search [default: sqp].
    #[arg(long, value_enum)]
    pub method: Option<Method>,
    /// Descents of sqp.
    #[arg(long, value_name = "N")]
    pub starts: Option<u32>,
    /// Individuals of a generation [default: 100000 of paper, 300 of direct].
    #[arg(long, value_name = "N")]
    pub population: Option<u32>,
    /// Most generations [default: 300 of paper, 50 of direct].
    #[arg(long, value_name = "N")]
    pub generations: Option<u32>,
    #[command(flatten)]
    pub coordinator: Coordinator,
    /// Follow the study to its end and print its optima.
    #[arg(long)]
    pub wait: bool,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// `name=value` or `name=low:high`.
fn range(text: &str) -> Result<(String, Range), String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=VALUE or NAME=LOW:HIGH")?;
    let number = |text: &str| text.trim().parse::<f64>().map_err(|_| format!("`{text}` is not a number"));
    let range = match value.split_once(':') {
        Some((low, high)) => Range::Between([number(low)?, number(high)?]),
        None => Range::Held(number(value)?),
    };
    let place = parameters::find(name).ok_or_else(|| unknown_parameter(name))?;
    Ok((parameters::TABLE[place].name.to_owned(), range))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_values_or_bounds() {
        assert_eq!(range("frequency_hz=20.5"), Ok(("frequency_hz".into(), Range::Held(20.5))));
        assert_eq!(range("phi0 = -2:3"), Ok(("sweep_mean_deg".into(), Range::Between([-2.0, 3.0]))));
        assert!(range("f").is_err() && range("f=x").is_err() && range("f=1:").is_err());
        assert!(range("frequncy_hz=1").unwrap_err().contains("did you mean frequency_hz?"));
    }
}
