//! `manduca study submit --dry-run`: a study checked and timed, nowhere stored.

use std::collections::BTreeMap;
use std::io;
use std::process::ExitCode;

use anyhow::{Context, Result};
use manduca_numerics::parameters::TABLE;
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::resolve::ResolvedStudy;
use manduca_protocol::study::{Method, StudySpec, SurrogateKind};
use manduca_server::RunLimits;
use serde::Serialize;

use crate::args::SubmitArgs;
use crate::cost::{self, Cost};
use crate::exit::refused;
use crate::output::{Output, note};
use crate::progress::span;
use crate::render::simulation::Settings as ModelSettings;
use crate::study_file;

/// What is known of a study before it starts.
#[derive(Debug, Serialize)]
struct Report<'a> {
    /// Simulations it would queue: samples, each optimum once more, and individuals at most.
    simulations: u64,
    /// The study with every default of its fields.
    study: &'a StudySpec,
    settings: Settings,
    #[serde(flatten)]
    cost: Cost,
    /// Always empty: faults are told as errors. The coordinator's answer has the same field.
    errors: [FieldProblem; 0],
}

/// Every value a simulation of the study reads.
#[derive(Debug, Serialize)]
struct Settings {
    parameters: BTreeMap<&'static str, [f64; 2]>,
    #[serde(flatten)]
    model: ModelSettings,
}

impl Settings {
    fn of(study: &ResolvedStudy) -> Self {
        let range = |(i, name): (usize, &'static str)| (name, [study.bounds.lower[i], study.bounds.upper[i]]);
        Self {
            parameters: TABLE.iter().map(|p| p.name).enumerate().map(range).collect(),
            model: ModelSettings::of(&study.model),
        }
    }
}

/// Checks a study by the coordinator's rules and times its samples.
pub fn dry_run(args: &SubmitArgs, spec: &StudySpec) -> Result<ExitCode> {
    let limits = RunLimits::default();
    let checked =
        manduca_server::check(spec, &limits).map_err(|faults| refused(study_file::listed(&args.study, &faults)))?;
    note("timing a few samples ...");
    let study = &checked.resolved;
    let flown = (spec.sampling.samples, checked.individuals());
    let cost = cost::measure(&study.model, &study.bounds, spec.sampling.clearance_margin_mm, flown)
        .context("no stroke within these bounds is feasible")?;
    let report =
        Report { simulations: checked.simulations(), study: spec, settings: Settings::of(study), cost, errors: [] };
    let mut out = Output::stdout();
    if args.json {
        out.json(&report)?;
    } else {
        print(&mut out, &args.study, &report)?;
    }
    let limit_s = limits.simulate.as_secs_f64();
    if report.cost.production_sample_s > limit_s {
        note(format_args!(
            "warning: a flight takes longer here than the {limit_s} s which a coordinator gives it (`serve --run-limit`)"
        ));
    }
    Ok(ExitCode::SUCCESS)
}

fn print(out: &mut Output, name: &str, report: &Report<'_>) -> io::Result<()> {
    let (spec, settings, cost) = (report.study, &report.settings, &report.cost);
    out.heading(format_args!("{name} would be accepted"))?;
    out.table(&["parameter", "low", "high"].map(String::from), &parameters(settings))?;
    out.line("")?;
    let numbers = |values: &BTreeMap<&'static str, f64>| {
        values.iter().map(|(name, value)| vec![(*name).to_owned(), value.to_string()]).collect::<Vec<_>>()
    };
    out.table(&["solver", "value"].map(String::from), &numbers(&settings.model.solver))?;
    out.line("")?;
    out.table(&["insect (SI)", "value"].map(String::from), &numbers(&settings.model.insect))?;
    out.line("")?;
    let (model, network) = (&spec.model, &spec.surrogate);
    out.line(format_args!(
        "model     {}, insect {}, elevation phase {}, elastic storage {}",
        word(&model.kind),
        model.insect,
        word(&model.elevation_phase),
        model.elastic_storage
    ))?;
    if spec.sampling.samples > 0 {
        match network.kind {
            SurrogateKind::Network => out.line(format_args!(
                "network   {} neurons, at most {} iterations",
                network.neurons, network.max_iterations
            ))?,
            SurrogateKind::GaussianProcess => out.line("surrogate gaussian process")?,
        }
    }
    for optimisation in &spec.optimisations {
        let how = match optimisation.method {
            Method::Sqp => format!("sqp, {} starts", optimisation.starts),
            Method::Paper | Method::Direct => {
                let flown = if optimisation.is_direct() { ", every individual flown" } else { "" };
                let (population, generations) = (optimisation.population(), optimisation.generations());
                format!("population {population}, {generations} generations{flown}")
            }
        };
        out.line(format_args!("optimise  {}: {how}", optimisation.name))?;
    }
    out.line(format_args!("samples   {}, {} simulations in all", spec.sampling.samples, report.simulations))?;
    let about = if cost.extrapolated { " (from its first stroke)" } else { "" };
    let (what, strokes) = match cost.study_individuals {
        0 => ("sampling", u64::from(cost.study_samples)),
        n => ("flying", u64::from(cost.study_samples) + n),
    };
    out.line(format_args!(
        "{what:9} {} on {} cores: {strokes} x {:.3} s{about} / {}",
        span(cost.study_estimate_s),
        cost.cores,
        cost.production_sample_s,
        cost.cores
    ))
}

fn parameters(settings: &Settings) -> Vec<Vec<String>> {
    let row = |name: &str| {
        let [low, high] = settings.parameters.get(name).copied().unwrap_or_default();
        let high = if low < high { high.to_string() } else { "held".to_owned() };
        vec![name.to_owned(), low.to_string(), high]
    };
    TABLE.iter().map(|p| row(p.name)).collect()
}

/// A choice as study files write it.
fn word(choice: &impl Serialize) -> String {
    serde_json::to_value(choice).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}
