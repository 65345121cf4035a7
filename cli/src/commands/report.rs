//! `manduca report`: documents computed from the solver.

use std::process::ExitCode;

use anyhow::{Context, Result};
use manduca_report::convergence::{self, Effort};
use manduca_report::output::Report;
use manduca_report::verification;

use super::five::five;
use super::reproduction::reproduction;
use crate::args::{ReportArgs, ReportCommand};
use crate::output::{Output, note};

/// Computes a report and writes it.
pub async fn report(command: &ReportCommand) -> Result<ExitCode> {
    match command {
        ReportCommand::Verification(args) => {
            write(args, verification::compute(&mut |step| note(step)).context("the verification failed")?)
        }
        ReportCommand::Convergence(args) => {
            let effort = Effort { strokes: args.strokes, errors: args.errors, lines: args.lines };
            let report = convergence::compute(effort, &mut |step| note(step)).context("the study failed")?;
            write(&args.report, report)
        }
        ReportCommand::Reproduction(args) => reproduction(args).await,
        ReportCommand::Five(args) => five(args).await,
    }
}

pub(super) fn write(args: &ReportArgs, report: Report) -> Result<ExitCode> {
    let files = report.write(&args.output).with_context(|| format!("cannot write to {}", args.output.display()))?;
    let mut out = Output::stdout();
    if args.json {
        out.json(&serde_json::json!({ "files": files }))?;
        return Ok(ExitCode::SUCCESS);
    }
    for path in files {
        out.line(path.display())?;
    }
    Ok(ExitCode::SUCCESS)
}
