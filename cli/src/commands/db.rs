//! `manduca db`: a database is copied, checked, and cleared of what is old.

use std::process::ExitCode;
use std::time::Duration;

use anyhow::Result;

use super::serve::DATABASE;
use super::token::{open, told};
use crate::args::{BackupArgs, CheckArgs, DbCommand, PruneArgs};
use crate::exit::refused;
use crate::output::{Output, counted, note};

/// Does what was asked for.
pub async fn db(command: DbCommand) -> Result<ExitCode> {
    match command {
        DbCommand::Backup(args) => backup(args).await,
        DbCommand::Check(args) => check(args).await,
        DbCommand::Prune(args) => prune(args).await,
    }
}

/// Unlike a coordinator, these do not make a database where there is none.
async fn existing(data: &std::path::Path) -> Result<manduca_server::Offline> {
    if !data.join(DATABASE).is_file() {
        return Err(refused(format!(
            "there is no database in {}: --data DIR or MANDUCA_DATA names its folder",
            data.display()
        )));
    }
    open(data).await
}

async fn backup(args: BackupArgs) -> Result<ExitCode> {
    let mut database = existing(&args.data.data).await?;
    database.backup(&args.file).await.map_err(told)?;
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
    let mut database = existing(&args.data.data).await?;
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
        out.line(format_args!("{verdict}; {} results compared with their digests", findings.results))?;
    }
    Ok(if findings.is_well() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

async fn prune(args: PruneArgs) -> Result<ExitCode> {
    let mut database = existing(&args.data.data).await?;
    let older_than = Duration::from_secs_f64(args.older_than_days * 86_400.0);
    let removed = database.prune(older_than, args.dry_run).await?;
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
