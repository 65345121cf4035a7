//! `manduca workers` and `manduca explain`.

mod trust;

use std::process::ExitCode;

use anyhow::Result;
use manduca_protocol::ids::JobId;
use manduca_protocol::who::WorkerView;

use crate::args::{DrainArgs, ExplainArgs, WorkerListArgs, WorkersCommand};
use crate::exit::refused;
use crate::output::{Output, counted, note};

/// Does what was asked for.
pub async fn workers(command: WorkersCommand) -> Result<ExitCode> {
    match command {
        WorkersCommand::List(args) => list(args).await,
        WorkersCommand::Drain(args) => drain(args).await,
        WorkersCommand::Disown(args) => trust::disown(args).await,
        WorkersCommand::Readmit(args) => trust::readmit(args).await,
    }
}

async fn list(args: WorkerListArgs) -> Result<ExitCode> {
    let workers = args.coordinator.api()?.workers().await?;
    let mut out = Output::stdout();
    if args.json {
        out.json(&workers)?;
        return Ok(ExitCode::SUCCESS);
    }
    // Only where tokens are asked for do workers have one.
    let with_tokens = workers.iter().any(|w| w.token.is_some());
    let mut head = ["name", "state", "slots", "jobs", "done", "failed", "heard of, s", "level", "id"].to_vec();
    if with_tokens {
        head.insert(1, "token");
    }
    let head: Vec<_> = head.into_iter().map(str::to_owned).collect();
    let row = |w: &WorkerView| {
        let mut row = vec![
            w.name.clone(),
            state(w).to_owned(),
            w.slots.to_string(),
            w.leased.to_string(),
            w.completed.to_string(),
            w.failed.to_string(),
            format!("{:.0}", w.last_seen_s),
            w.level.clone(),
            w.id.to_string(),
        ];
        if with_tokens {
            row.insert(1, w.token.clone().unwrap_or_else(|| "-".into()));
        }
        row
    };
    out.table(&head, &workers.iter().map(row).collect::<Vec<_>>())?;
    Ok(ExitCode::SUCCESS)
}

fn state(worker: &WorkerView) -> &'static str {
    match worker {
        WorkerView { alive: false, .. } => "silent",
        WorkerView { set_aside: Some(_), .. } => "not trusted",
        WorkerView { draining: true, .. } => "draining",
        WorkerView { quarantined: true, .. } => "set aside",
        _ => "working",
    }
}

async fn drain(args: DrainArgs) -> Result<ExitCode> {
    let api = args.coordinator.api()?;
    let workers = match &args.worker {
        Some(name) => api.workers_called(name).await?,
        None => api.workers().await?,
    };
    if let (Some(text), true) = (&args.worker, workers.is_empty()) {
        return Err(refused(format!("no worker's name or id is `{text}` (`manduca workers list` shows them)")));
    }
    for worker in &workers {
        api.drain(worker.id).await?;
        note(format_args!("worker `{}` finishes {} and leaves", worker.name, counted(worker.leased, "job")));
    }
    if args.json {
        Output::stdout().json(&workers)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Why a job is where it is.
pub async fn explain(args: ExplainArgs) -> Result<ExitCode> {
    let told = args.coordinator.api()?.explain(JobId(args.job)).await?;
    let mut out = Output::stdout();
    if args.json {
        out.json(&told)?;
        return Ok(ExitCode::SUCCESS);
    }
    let state = serde_json::to_value(told.state)?;
    out.line(format_args!("job {} of study {}: {}", told.job, told.study, state.as_str().unwrap_or_default()))?;
    for sentence in &told.because {
        out.line(format_args!("  {sentence}"))?;
    }
    for failed in &told.failed_attempts {
        let worker = failed.worker_name.clone().unwrap_or_else(|| failed.worker.to_string());
        let token = failed.token.as_ref().map(|token| format!(" of token `{token}`")).unwrap_or_default();
        let (attempt, reason) = (failed.attempt, &failed.reason);
        out.line(format_args!("  attempt {attempt} by worker `{worker}`{token}, {}: {reason}", failed.fault))?;
    }
    Ok(ExitCode::SUCCESS)
}
