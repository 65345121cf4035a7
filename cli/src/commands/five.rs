//! `manduca report five`: the paper's five-parameter case, searched directly and on a surrogate.

use std::process::ExitCode;

use anyhow::{Context, Result};
use manduca_report::five::{self, Five, Side};

use super::reproduction::{on_one_core, optimum, version};
use crate::api::Api;
use crate::args::FiveArgs;
use crate::render;

/// Fetches both studies and writes their document.
pub async fn five(args: &FiveArgs) -> Result<ExitCode> {
    let api = args.coordinator.api()?;
    let direct = side(&api, &args.direct, true).await?;
    let surrogate = side(&api, &args.surrogate, false).await?;
    super::report::write(&args.report, five::document(&Five { direct, surrogate }))
}

/// The first optimum of a study which was searched directly, or which was not.
async fn side(api: &Api, study: &str, direct: bool) -> Result<Side> {
    let id = api.find(study).await?;
    let view = api.study(id).await?;
    let mut all = view.optimisations.iter().zip(&view.spec.optimisations);
    let kind = if direct { "direct optimisation" } else { "optimisation on its surrogate" };
    let found =
        all.find(|(_, asked)| asked.is_direct() == direct).and_then(|(found, _)| Some((found, optimum(found)?)));
    let (found, optimum) = found.with_context(|| format!("study {id} has no finished {kind}"))?;
    let mut facts = vec![
        ("study".to_owned(), format!("{} ({id})", view.spec.name)),
        ("solver_version".to_owned(), version(&view.solver_version)),
    ];
    facts.extend(found.breeding.as_ref().map(|b| ("generations".to_owned(), render::study::breeding(b))));
    if view.spec.sampling.samples > 0 {
        facts.push(("samples".to_owned(), view.samples.succeeded.to_string()));
    }
    if let Some(errors) = &view.surrogate {
        let [lift, drag, moment, power] = render::scaled(&errors.rmse);
        facts.push(("errors".to_owned(), format!("rms on its test share: {lift:.4} {drag:.4} {moment:.4} {power:.4}")));
    }
    facts.push(("wall time".to_owned(), render::study::stages(&view.stages_s)));
    facts.push(("all its jobs".to_owned(), on_one_core(api.jobs_done(id).await?.iter())));
    Ok(Side { facts, optimum })
}
