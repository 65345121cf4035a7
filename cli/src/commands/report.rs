//! `manduca report`: documents computed from the solver.

use std::process::ExitCode;

use anyhow::{Context, Result};
use manduca_report::verification;

use crate::args::{ReportArgs, ReportCommand};
use crate::output::{Output, note};

/// Computes a report and writes it.
pub fn report(command: &ReportCommand) -> Result<ExitCode> {
    match command {
        ReportCommand::Verification(args) => verification(args),
    }
}

fn verification(args: &ReportArgs) -> Result<ExitCode> {
    let report = verification::compute(&mut |step| note(step)).context("the verification failed")?;
    let mut out = Output::stdout();
    for path in report.write(&args.output).with_context(|| format!("cannot write to {}", args.output.display()))? {
        out.line(path.display())?;
    }
    Ok(ExitCode::SUCCESS)
}
