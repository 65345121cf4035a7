//! `manduca study ...` and `manduca optimum`.

use std::process::ExitCode;

use anyhow::{Result, bail};
use manduca_protocol::ids::StudyId;
use manduca_protocol::view::{StudyState, StudyView};

use super::{dataset, dry_run};
use crate::api::Api;
use crate::args::{ListArgs, StudyCommand, SubmitArgs, TargetArgs};
use crate::exit::INTERRUPTED;
use crate::follow::{Followed, follow};
use crate::output::{Output, note};
use crate::progress::{glance, span};
use crate::{render, signals, study_file};

/// Does what was asked for.
pub async fn dispatch(command: StudyCommand) -> Result<ExitCode> {
    match command {
        StudyCommand::Submit(args) => submit(args).await,
        StudyCommand::List(args) => list(args).await,
        StudyCommand::Show(args) => show(args).await,
        StudyCommand::Watch(args) => {
            let api = args.coordinator.api()?;
            let id = api.find(&args.study).await?;
            watch(&api, id, args.json).await
        }
        StudyCommand::Pause(args) => act(args, "pause").await,
        StudyCommand::Resume(args) => act(args, "resume").await,
        StudyCommand::Cancel(args) => act(args, "cancel").await,
        StudyCommand::RetryFailed(args) => act(args, "retry-failed").await,
        StudyCommand::Model(args) => dataset::model(args).await,
    }
}

/// Prints the optima of a study.
pub async fn optimum(args: TargetArgs) -> Result<ExitCode> {
    let api = args.coordinator.api()?;
    let result = api.result(api.find(&args.study).await?).await?;
    let mut out = Output::stdout();
    if args.json {
        out.json(&result)?;
    } else if result.optimisations.iter().all(|o| o.parameters.is_none()) {
        out.line(format_args!("no optimum yet: the study is {}", result.state.name()))?;
    } else {
        render::study::result(&mut out, &result)?;
    }
    Ok(ExitCode::SUCCESS)
}

async fn submit(args: SubmitArgs) -> Result<ExitCode> {
    let spec = study_file::load(&args.study)?;
    if args.dry_run {
        return dry_run::dry_run(&args, &spec);
    }
    let api = args.coordinator.api()?;
    let mut out = Output::stdout();
    let id = api.submit(&spec, args.idempotency_key.as_deref()).await?;
    if args.wait {
        note(format_args!("study {id}"));
        drop(out);
        return watch(&api, id, args.json).await;
    }
    if args.json {
        out.json(&serde_json::json!({ "study": id }))?
    } else {
        out.line(id)?
    }
    Ok(ExitCode::SUCCESS)
}

async fn list(args: ListArgs) -> Result<ExitCode> {
    let studies = args.coordinator.api()?.studies().await?;
    let mut out = Output::stdout();
    if args.json {
        out.json(&serde_json::json!({ "studies": studies }))?;
        return Ok(ExitCode::SUCCESS);
    }
    // Only where tokens are asked for is it known who submitted.
    let with_tokens = studies.iter().any(|s| s.submitted_by.is_some());
    let rows: Vec<_> = studies
        .iter()
        .map(|s| {
            let samples = format!("{}/{}", s.samples_succeeded, s.samples);
            let mut row =
                vec![s.id.to_string(), s.name.clone(), s.state.name().to_owned(), samples, s.created_at.clone()];
            row.extend(with_tokens.then(|| s.submitted_by.clone().unwrap_or_else(|| "-".into())));
            row
        })
        .collect();
    let mut head = ["study", "name", "state", "samples", "created"].map(String::from).to_vec();
    head.extend(with_tokens.then(|| "by".to_owned()));
    out.table(&head, &rows)?;
    Ok(ExitCode::SUCCESS)
}

async fn show(args: TargetArgs) -> Result<ExitCode> {
    let api = args.coordinator.api()?;
    let view = api.study(api.find(&args.study).await?).await?;
    let mut out = Output::stdout();
    if args.json {
        out.json(&view)?
    } else {
        describe(&mut out, &view)?
    }
    Ok(ExitCode::SUCCESS)
}

fn describe(out: &mut Output, view: &StudyView) -> std::io::Result<()> {
    out.heading(format_args!("{} {}", view.spec.name, view.id))?;
    if !view.spec.description.is_empty() {
        out.line(&view.spec.description)?;
    }
    let from = view.paused_from.map_or_else(String::new, |from| format!(" in {}", from.name()));
    out.line(format_args!("state     {}{from}", view.state.name()))?;
    for (what, by) in [("submitted", &view.submitted_by), ("steered", &view.steered_by)] {
        if let Some(by) = by {
            out.line(format_args!("{what:<9} by token `{by}`"))?;
        }
    }
    if let Some(failure) = &view.failure {
        out.line(format_args!("failure   {failure}"))?;
    }
    let glance = glance(view);
    if !crate::follow::is_over(view.state) {
        out.line(format_args!("progress  {}/{}  {}", glance.done, glance.total, glance.detail))?;
    }
    if view.spec.sampling.samples > 0 {
        let s = &view.samples;
        let waiting = s.ready + s.delayed;
        out.line(format_args!(
            "samples   {} of {}; {} infeasible, {} dead, {} running, {waiting} waiting",
            s.succeeded, view.spec.sampling.samples, s.infeasible, s.dead, s.leased
        ))?;
    }
    render::trust::trust(out, view)?;
    for optimum in &view.optimisations {
        if let Some(search) = &optimum.breeding {
            out.line(format_args!("flown     {}: {}", optimum.name, render::study::breeding(search)))?;
        }
        for warning in &optimum.warnings {
            out.line(format_args!("warning   {}: {warning}", optimum.name))?;
        }
    }
    out.line(format_args!("time      {}", render::study::stages(&view.stages_s)))?;
    if let Some(eta) = view.eta_s {
        out.line(format_args!("left      {} of this stage", span(eta)))?;
    }
    out.line(format_args!("created   {}, solver version {}", view.created_at, view.solver_version))
}

/// Follows a study and prints its optima; Ctrl-C leaves it running.
pub(super) async fn watch(api: &Api, id: StudyId, json: bool) -> Result<ExitCode> {
    let interrupted = signals::shutdown().drain;
    let view = match follow(api, id, &interrupted).await? {
        Followed::Ended(view) => view,
        Followed::Interrupted => {
            note(format_args!("the study goes on; `manduca study watch {id}` follows it again"));
            return Ok(ExitCode::from(INTERRUPTED));
        }
    };
    match view.state {
        StudyState::Cancelled => bail!("the study was cancelled"),
        StudyState::Failed => bail!("the study failed: {}", view.failure.as_deref().unwrap_or("no reason given")),
        _ => {}
    }
    let result = api.result(id).await?;
    let mut out = Output::stdout();
    if json {
        out.json(&result)?
    } else {
        render::study::result(&mut out, &result)?
    }
    Ok(ExitCode::SUCCESS)
}

async fn act(args: TargetArgs, action: &str) -> Result<ExitCode> {
    let api = args.coordinator.api()?;
    let id = api.find(&args.study).await?;
    api.act(id, action).await?;
    let view = api.study(id).await?;
    let mut out = Output::stdout();
    if args.json {
        out.json(&view)?
    } else {
        out.line(format_args!("{id} is {}", view.state.name()))?
    }
    Ok(ExitCode::SUCCESS)
}
