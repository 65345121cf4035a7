//! `manduca figures`: every plot of a study, as SVG and as PNG.

use std::fs;
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};
use manduca_numerics::cases::CASES;
use manduca_protocol::ids::StudyId;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::resolve::{self, ResolvedModel};
use manduca_protocol::task::SimulateOutcome;
use manduca_protocol::view::{DatasetRow, OptimumView, StudyView};
use manduca_report::figures::{self, Flown, Sample};
use manduca_report::flights::fly_with_history;
use manduca_report::plot::{Figure, png};
use manduca_report::reproduction::{self, Effort, Study};

use crate::api::Api;
use crate::args::FiguresArgs;
use crate::output::{Output, note};
use crate::{file, render};

/// What is known of a study.
struct Known {
    view: StudyView,
    model: ResolvedModel,
    study: Option<Study>,
    samples: Vec<Sample>,
}

/// Fetches a study and draws all there is of it.
pub async fn figures(args: FiguresArgs) -> Result<ExitCode> {
    let api = args.coordinator.api()?;
    let id = api.find(&args.study).await?;
    let known = fetched(&api, id).await?;
    let output = args.output.clone();
    let drawn = tokio::task::spawn_blocking(move || {
        let figures = drawn(&known, args.population)?;
        write(&figures, &output, args.scale)
    });
    let mut out = Output::stdout();
    let files = drawn.await??;
    if args.json {
        out.json(&serde_json::json!({ "study": id, "files": files }))?;
        return Ok(ExitCode::SUCCESS);
    }
    for name in files {
        out.line(name)?;
    }
    Ok(ExitCode::SUCCESS)
}

async fn fetched(api: &Api, id: StudyId) -> Result<Known> {
    let view = api.study(id).await?;
    let model = resolve::model(&view.spec.model, "").map_err(|_| anyhow::anyhow!("the study is of another version"))?;
    // Before it is trained there is none, and still there are samples to show.
    let study = match api.model_so_far(id).await? {
        true => Some(super::reproduction::fetched(api, id).await?),
        false => None,
    };
    let text = api.part(id, "dataset", "application/x-ndjson").await?.bytes().await.context("the dataset broke off")?;
    let rows = text.split(|b| *b == b'\n').filter(|line| !line.is_empty());
    let rows: Vec<DatasetRow> = rows.map(serde_json::from_slice).collect::<Result<_, _>>()?;
    let sample = |row: &DatasetRow| {
        let SimulateOutcome::Ok { scaled, .. } = &row.result.outcome else { return None };
        let point = row.parameters.0;
        let predicted = study.as_ref().map(|study| study.surrogate.predict(&point));
        Some(Sample { point, simulated: render::estimates(scaled).map(|e| e.mean), predicted })
    };
    let samples = rows.iter().filter_map(sample).collect();
    Ok(Known { view, model, study, samples })
}

fn drawn(known: &Known, population: bool) -> Result<Vec<(&'static str, Figure)>> {
    let mut drawn = Vec::new();
    let mut add = |name: &'static str, figure: Option<Figure>| drawn.extend(figure.map(|figure| (name, figure)));
    if let Some(study) = &known.study {
        add("training", figures::training(&study.curve));
    }
    add("agreement", figures::agreement(&known.samples));
    add("distributions", figures::distributions(&known.samples));
    let histories: Vec<_> = known.view.optimisations.iter().filter_map(refined).collect();
    add("refining", figures::refining(&histories));
    note("flying the optima");
    let flown = flown(known);
    if !flown.is_empty() {
        add("forces", Some(figures::forces(&flown, known.model.insect.weight_n())));
        add("angles", Some(figures::angles(&flown)));
        add("tip-paths", Some(figures::tip_paths(&flown)));
    }
    if let Some(study) = known.study.as_ref().filter(|_| population) {
        note("sweep of the population: some minutes");
        add("population", Some(reproduction::population(study, &Effort::default())?));
    }
    Ok(drawn)
}

/// How an optimum was refined.
fn refined(optimum: &OptimumView) -> Option<(String, Vec<[f64; 2]>)> {
    let history = &optimum.search.as_ref()?.standing.history;
    (!history.is_empty()).then(|| (optimum.name.clone(), history.clone()))
}

/// The last strokes of the optima and of the moth as measured, with the study's model.
fn flown(known: &Known) -> Vec<Flown> {
    let best = known.view.optimisations.iter().filter_map(|o| {
        let refined = o.search.as_ref().and_then(|s| Some(s.standing.best.as_ref()?.parameters));
        Some((o.name.clone(), refined.or_else(|| Some(o.optimum.as_ref()?.parameters))?))
    });
    let moth = CASES.iter().find(|c| c.name == "reference");
    let moth = moth.map(|c| ("moth as measured".to_owned(), ParameterValues(c.parameters)));
    let fly = |(name, stroke): (String, ParameterValues)| match fly_with_history(&known.model.simulation(&stroke)) {
        Ok((_, moments)) => Some((name, moments)),
        Err(why) => {
            note(format_args!("{name} is left out: {why}"));
            None
        }
    };
    best.chain(moth).filter_map(fly).collect()
}

/// Writes each figure in both forms; tells the paths.
fn write(figures: &[(&'static str, Figure)], folder: &Path, scale: f32) -> Result<Vec<String>> {
    let told = || format!("cannot write to {}", folder.display());
    fs::create_dir_all(folder).with_context(told)?;
    let mut paths = Vec::new();
    for (name, figure) in figures {
        let svg = figure.svg()?;
        for (ending, bytes) in [("png", png(&svg, scale)?), ("svg", svg.into_bytes())] {
            let path = folder.join(format!("{name}.{ending}"));
            file::write(&path, &bytes).with_context(told)?;
            paths.push(path.display().to_string());
        }
    }
    Ok(paths)
}
