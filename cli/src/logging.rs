//! Log lines on standard error.

use std::io::IsTerminal;

use tracing_subscriber::EnvFilter;

use crate::args::{Cli, Command, LogFormat};

/// Starts logging: `MANDUCA_LOG`, then `RUST_LOG`, then `-v`/`-q` decide what is seen.
pub fn start(cli: &Cli) {
    let by_variable = ["MANDUCA_LOG", "RUST_LOG"]
        .into_iter()
        .filter(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()))
        .find_map(|name| EnvFilter::try_from_env(name).ok());
    let filter = by_variable.unwrap_or_else(|| EnvFilter::new(level(cli)));
    let builder = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    let builder = builder.with_ansi(std::io::stderr().is_terminal()).with_target(false);
    match cli.log_format {
        LogFormat::Text => builder.init(),
        LogFormat::Json => builder.json().flatten_event(true).with_current_span(false).with_span_list(false).init(),
    }
}

/// Services tell what they do; a command which shows its own progress does not.
fn level(cli: &Cli) -> &'static str {
    let quiet = !matches!(cli.command, Command::Serve(_) | Command::Worker(_));
    match (cli.quiet, cli.verbose, quiet) {
        (true, ..) => "error",
        (_, 0, true) => "error",
        (_, 0, false) | (_, 1, true) => "info",
        (_, 1, false) | (_, 2, _) => "info,manduca_server=debug,manduca_worker=debug,manduca=debug",
        _ => "trace",
    }
}
