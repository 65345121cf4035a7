//! `manduca worker`.

use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result};
use manduca_worker::Settings;

use super::host;
use crate::args::WorkerArgs;
use crate::output::note;
use crate::signals;

/// What a worker of this program is, before its options.
pub fn settings(coordinator: String, slots: Option<usize>, name: Option<String>) -> Result<Settings> {
    let program = host::this_program().context("cannot find this program")?;
    let mut settings = Settings::new(coordinator, program);
    settings.slots = slots.unwrap_or(settings.slots);
    settings.name = name.unwrap_or_else(host::name);
    Ok(settings)
}

/// Works until told to leave.
pub async fn worker(args: WorkerArgs) -> Result<ExitCode> {
    let mut settings = settings(args.coordinator.url.clone(), args.slots, args.name)?;
    settings.token = args.coordinator.token()?;
    settings.idle_exit = args.idle_exit.map(Duration::from_secs_f64);
    settings.max_runtime = args.max_runtime.map(Duration::from_secs_f64);
    let summary = manduca_worker::run(settings, signals::shutdown()).await?;
    note(format_args!(
        "{} jobs done, {} attempts failed, {} results refused",
        summary.completed, summary.failed, summary.refused
    ));
    Ok(ExitCode::SUCCESS)
}
