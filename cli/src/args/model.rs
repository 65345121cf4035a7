//! Options which describe an insect and its aerodynamics.

use std::collections::BTreeMap;

use clap::builder::PossibleValuesParser;
use clap::{Args, ValueEnum};
use manduca_numerics::cases::CASES;
use manduca_protocol::study::{ElevationPhase, ModelKind, ModelSpec};

use super::SolverOptions;

/// Aerodynamic model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Model {
    /// Extended unsteady vortex lattice.
    Uvlm,
    /// Blade elements.
    QuasiSteady,
}

/// Sign of the elevation's second harmonic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Phase {
    /// U-shaped tip path.
    Plus,
    /// Inverted U.
    Minus,
}

/// An insect and its aerodynamics.
#[derive(Debug, Args)]
pub struct ModelArgs {
    /// Preset of the insect (`manduca insects` lists them).
    #[arg(long, default_value = "hawkmoth")]
    pub insect: String,
    /// Change a value of the insect, SI units (`manduca insects hawkmoth` lists them).
    #[arg(long, value_name = "NAME=VALUE", value_parser = assignment)]
    pub insect_set: Vec<(String, f64)>,
    /// Aerodynamic model.
    #[arg(long, value_enum, default_value_t = Model::Uvlm)]
    pub model: Model,
    /// Sign of the elevation's second harmonic.
    #[arg(long, value_enum, default_value_t = Phase::Plus)]
    pub elevation_phase: Phase,
    /// Share of a joint's negative power that a spring returns, 0 to 1.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    pub elastic_storage: f64,
    #[command(flatten)]
    pub solver: SolverOptions,
}

impl ModelArgs {
    /// As a study file would say it.
    pub fn spec(&self) -> ModelSpec {
        ModelSpec {
            kind: match self.model {
                Model::Uvlm => ModelKind::Uvlm,
                Model::QuasiSteady => ModelKind::QuasiSteady,
            },
            insect: self.insect.clone(),
            insect_changes: self.insect_set.iter().cloned().collect::<BTreeMap<_, _>>(),
            solver: self.solver.0.clone(),
            elevation_phase: match self.elevation_phase {
                Phase::Plus => ElevationPhase::Plus,
                Phase::Minus => ElevationPhase::Minus,
            },
            elastic_storage: self.elastic_storage,
        }
    }
}

/// Names `--case` takes.
pub fn case_names() -> PossibleValuesParser {
    CASES.iter().map(|case| case.name).chain(["all"]).collect::<Vec<_>>().into()
}

/// Reads `NAME=VALUE`.
pub fn assignment(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=VALUE")?;
    let value = value.trim().parse::<f64>().map_err(|_| format!("`{value}` is not a number"))?;
    Ok((name.trim().replace('-', "_"), value))
}
