//! `manduca worker`.

use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use manduca_worker::{Settings, Summary};

use super::host;
use crate::args::WorkerArgs;
use crate::output::{counted, note};
use crate::{files, signals};

/// What a worker of this program is, before its options.
pub fn settings(coordinator: String, slots: Option<usize>, name: Option<String>) -> Result<Settings> {
    let program = host::this_program().context("cannot find this program")?;
    let mut settings = Settings::new(coordinator, program);
    settings.slots = files::slots(slots, settings.slots)?;
    settings.name = name.unwrap_or_else(host::name);
    Ok(settings)
}

/// Works until told to leave.
pub async fn worker(args: WorkerArgs) -> Result<ExitCode> {
    let mut settings = settings(args.coordinator.url.clone(), args.slots, args.name)?;
    settings.token = args.coordinator.token()?;
    settings.idle_exit = args.idle_exit.map(Duration::from_secs_f64);
    settings.max_runtime = args.max_runtime.map(Duration::from_secs_f64);
    settings.drain_timeout = Duration::from_secs_f64(args.drain_timeout);
    let summary = manduca_worker::run(settings, signals::shutdown()).await?;
    note(told(&summary));
    if summary.undelivered > 0 {
        bail!("{} could not be delivered", counted(summary.undelivered, "result"));
    }
    Ok(ExitCode::SUCCESS)
}

/// What a worker did, and what has come to nothing.
fn told(summary: &Summary) -> String {
    let Summary { completed, failed, refused, .. } = *summary;
    let mut text = format!("{completed} jobs done, {failed} attempts failed, {refused} results refused");
    for (count, what) in [(summary.lost, "lost with their registration"), (summary.given_back, "jobs given back")] {
        if count > 0 {
            text += &format!(", {count} {what}");
        }
    }
    text
}
