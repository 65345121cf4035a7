//! `manduca report reproduction`: a finished study beside the paper.

use std::process::ExitCode;

use anyhow::{Context, Result};
use manduca_numerics::cases::{CASES, Case, case};
use manduca_numerics::parameters::Bounds;
use manduca_protocol::ids::StudyId;
use manduca_protocol::resolve;
use manduca_protocol::task::{Estimate, SimulateOutcome};
use manduca_protocol::view::{JobRole, JobView, OptimumView, StudyView};
use manduca_report::reproduction::{self, Effort, Found, Optimum, Study};

use crate::api::Api;
use crate::args::ReproductionArgs;
use crate::output::note;
use crate::progress::span;
use crate::render;

/// Fetches a study and writes its document.
pub async fn reproduction(args: &ReproductionArgs) -> Result<ExitCode> {
    let api = args.coordinator.api()?;
    let id = api.find(&args.study).await?;
    let mut study = fetched(&api, id).await?;
    if let Some(truth) = &args.truth {
        study.fresh = super::bench::samples::read(truth)?;
    }
    let effort = Effort { population: args.population, populations: args.populations.clone(), runs: args.runs };
    let report = tokio::task::spawn_blocking(move || reproduction::compute(&study, &effort, &mut |step| note(step)));
    super::report::write(&args.report, report.await?.context("the document failed")?)
}

/// A study with its surrogate and optima, as documents take it.
pub(super) async fn fetched(api: &Api, id: StudyId) -> Result<Study> {
    let view = api.study(id).await?;
    let surrogate = api.model(id).await?;
    let resolved = resolve::study(&view.spec).map_err(|_| anyhow::anyhow!("the study is of another version"))?;
    let training = api.surrogate(id).await?;
    let first = training.curve.iter().filter(|e| e.network == 0);
    Ok(Study {
        facts: facts(api, id, &view).await?,
        curve: first.map(|e| [f64::from(e.iteration), e.train_mse, e.validation_mse, e.test_mse]).collect(),
        errors: training.test.map(|t| render::scaled(&t.rmse)),
        fresh: Vec::new(),
        surrogate,
        bounds: Bounds { lower: resolved.bounds.lower, upper: resolved.bounds.upper },
        seed: view.spec.seed,
        optima: view.optimisations.iter().filter_map(optimum).collect(),
    })
}

/// What computing the samples took on one core, and how many were there already.
async fn cost(api: &Api, id: StudyId) -> Result<String> {
    let jobs = api.jobs_done(id).await?;
    let samples: Vec<_> = jobs.iter().filter(|job| job.role == JobRole::Sample).collect();
    let flights = on_one_core(samples.iter().copied());
    let cached = samples.iter().filter(|job| job.cached).count();
    let shared = if cached > 0 { format!(", {cached} of them taken from an earlier study") } else { String::new() };
    Ok(flights + &shared)
}

/// What jobs took together, in words.
pub(super) fn on_one_core<'a>(jobs: impl Iterator<Item = &'a JobView>) -> String {
    let seconds = jobs.filter_map(|job| Some(job.provenance.as_ref()?.wall_s)).sum();
    format!("{} of one core", span(seconds))
}

/// The version a study was begun with, and this program's where it is another.
pub(super) fn version(begun: &str) -> String {
    match manduca_numerics::simulation::SOLVER_VERSION {
        present if present == begun => begun.to_owned(),
        present => format!("{begun}; this program computes with {present} (CHANGELOG.md tells what changed)"),
    }
}

async fn facts(api: &Api, id: StudyId, view: &StudyView) -> Result<Vec<(String, String)>> {
    let dataset = api.part(id, "dataset", "text/csv").await?.bytes().await.context("the dataset broke off")?;
    let spec = &view.spec;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let facts = [
        ("study", format!("{} ({id})", spec.name)),
        ("seed", spec.seed.to_string()),
        ("samples", format!("{} flown, {} infeasible", view.samples.succeeded, view.samples.infeasible)),
        ("dataset", format!("blake3 of its CSV {}", blake3::hash(&dataset).to_hex())),
        ("solver_version", version(&view.solver_version)),
        ("surrogate", serde_json::to_string(&spec.surrogate)?),
        ("wall time", render::study::stages(&view.stages_s)),
        ("the samples' flights", cost(api, id).await?),
        ("cores of this document's searches", cores.to_string()),
    ];
    Ok(facts.map(|(name, value)| (name.to_owned(), value)).to_vec())
}

/// An optimum as documents take it; none where it was not found.
pub(super) fn optimum(view: &OptimumView) -> Option<Optimum> {
    let found = view.optimum.as_ref()?;
    let simulated = view.simulated.as_ref().and_then(|s| match &s.outcome {
        SimulateOutcome::Ok { scaled, .. } => Some(render::estimates(scaled)),
        SimulateOutcome::Infeasible { .. } => None,
    });
    let with_errors = |e: [Estimate; 4]| (e.map(|e| e.mean), e.map(|e| e.se));
    let refined = view.search.as_ref().and_then(|search| {
        let best = search.standing.best.as_ref()?;
        Some(Found {
            point: best.parameters.0,
            predicted: search.standing.predicted.as_ref().map(render::scaled),
            simulated: best.scaled.as_ref().map(|s| with_errors(render::estimates(s))),
        })
    });
    Some(Optimum {
        name: view.name.clone(),
        paper: published(&view.name),
        first: Found {
            point: found.parameters.0,
            predicted: Some(render::scaled(&found.predicted)),
            simulated: simulated.map(with_errors),
        },
        refined,
        refining: view.search.as_ref().map(render::study::refinement),
        prices: prices(view),
    })
}

/// The published case an optimisation of the paper's studies is compared with, by its name: `case-II` and `optimum 2` mean
/// the second, `five` Table 4, anything else the first.
fn published(name: &str) -> &'static Case {
    let lower = name.to_lowercase();
    let words: Vec<_> = lower.split(|c: char| !c.is_ascii_alphanumeric()).collect();
    let means = |any: &[&str]| any.iter().any(|word| words.contains(word));
    let wanted = if means(&["ii", "2"]) {
        "optimum-2"
    } else if means(&["five", "5"]) {
        if means(&["direct"]) { "five-direct" } else { "five-ann" }
    } else {
        "optimum-1"
    };
    case(wanted).unwrap_or(&CASES[0])
}

/// What trim costs: at the refined optimum, else at the first.
fn prices(view: &OptimumView) -> Option<[f64; 3]> {
    let refined = view.search.as_ref().and_then(|s| s.standing.prices.as_ref());
    let first = || view.optimum.as_ref()?.optimality.as_ref().map(|o| &o.multipliers);
    match refined {
        Some(p) => Some([p.lift, p.drag, p.pitch_moment]),
        None => first().map(|p| [p.lift, p.drag, p.pitch_moment]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_case_is_known_by_its_name() {
        let names = ["case-I", "case-II", "Case II, r = 20", "five parameters", "five-direct", "whatever"];
        let wanted = ["optimum-1", "optimum-2", "optimum-2", "five-ann", "five-direct", "optimum-1"];
        assert_eq!(names.map(|n| published(n).name), wanted);
    }
}
