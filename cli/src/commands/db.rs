//! `manduca db`: a database is copied, checked, and cleared of what is old.

use std::process::ExitCode;
use std::time::Duration;

use anyhow::Result;

use super::token::{look, open, told};
use crate::args::{BackupArgs, CheckArgs, DbCommand, PruneArgs};
use crate::exit::INTERRUPTED;
use crate::output::{Output, counted, note};
use crate::signals;

/// Does what was asked for.
pub async fn db(command: DbCommand) -> Result<ExitCode> {
    match command {
        DbCommand::Backup(args) => backup(args).await,
        DbCommand::Check(args) => check(args).await,
        DbCommand::Prune(args) => prune(args).await,
    }
}

async fn backup(args: BackupArgs) -> Result<ExitCode> {
    let mut database = look(&args.data.data).await?;
    let interrupted = signals::shutdown();
    tokio::select! {
        done = database.backup(&args.file) => done.map_err(told)?,
        () = interrupted.drain.cancelled() => return Ok(ExitCode::from(INTERRUPTED)),
    }
    database.close().await;
    if args.json {
        let bytes = std::fs::metadata(&args.file)?.len();
        Output::stdout().json(&serde_json::json!({ "file": args.file, "bytes": bytes }))?;
    } else {
        note(format_args!("written and checked: {}", args.file.display()));
    }
    Ok(ExitCode::SUCCESS)
}

async fn check(args: CheckArgs) -> Result<ExitCode> {
    let mut database = look(&args.data.data).await?;
    let findings = database.check().await?;
    database.close().await;
    let mut out = Output::stdout();
    if args.json {
        out.json(&findings)?;
    } else {
        for line in findings.damage.iter().chain(&findings.breaches) {
            out.line(line)?;
        }
        let verdict = if findings.is_well() { "all is well" } else { "something is wrong" };
        out.line(format_args!(
            "{verdict}; {} results compared with their digests, {} simulations with their keys",
            findings.results, findings.keys
        ))?;
    }
    Ok(if findings.is_well() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

async fn prune(args: PruneArgs) -> Result<ExitCode> {
    let older_than = Duration::from_secs_f64(args.older_than_days * 86_400.0);
    let mut database = if args.dry_run { look(&args.data.data).await? } else { open(&args.data.data).await? };
    let removed = match args.dry_run {
        true => database.prunable(older_than).await?,
        false => database.prune(older_than, args.force).await.map_err(told)?,
    };
    database.close().await;
    let mut out = Output::stdout();
    if args.json {
        out.json(&removed)?;
        return Ok(ExitCode::SUCCESS);
    }
    let head = ["study", "name", "jobs"].map(str::to_owned);
    let jobs: u64 = removed.iter().map(|study| study.jobs).sum();
    let studies = if removed.len() == 1 { "study" } else { "studies" };
    let told = format!("{} {studies} with {}", removed.len(), counted(jobs, "job"));
    let rows: Vec<_> = removed.into_iter().map(|s| vec![s.study, s.name, s.jobs.to_string()]).collect();
    if !rows.is_empty() {
        out.table(&head, &rows)?;
    }
    let verb = if args.dry_run { "would be removed" } else { "removed" };
    out.line(format_args!("{told} {verb}"))?;
    Ok(ExitCode::SUCCESS)
}
