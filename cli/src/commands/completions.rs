//! `manduca completions`.

use std::process::ExitCode;

use anyhow::Result;
use clap::CommandFactory;

use crate::args::{Cli, CompletionsArgs};
use crate::output::Output;

/// Prints the script of a shell.
pub fn completions(args: &CompletionsArgs) -> Result<ExitCode> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "manduca", &mut script);
    let mut out = Output::stdout();
    out.writer().write_all(&script)?;
    Ok(ExitCode::SUCCESS)
}
