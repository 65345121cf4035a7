//! The `manduca` command: studies of flapping flight, from sampling to optimum.

mod api;
mod args;
mod commands;
mod cost;
mod endings;
mod exit;
mod file;
mod files;
mod follow;
mod logging;
mod output;
mod progress;
mod render;
mod signals;
mod study_file;
mod text_file;
mod threads;
mod token;
mod whole;

use std::process::ExitCode;
use std::time::Duration;

fn main() -> ExitCode {
    let cli = args::parse();
    if matches!(cli.command, args::Command::Slot) {
        // A slot is no async program: it reads, computes and writes.
        return manduca_worker::slot::slot_main();
    }
    if cli.quiet {
        output::hush();
    }
    logging::start(&cli);
    let coordinates = matches!(cli.command, args::Command::Serve(_) | args::Command::Run(_));
    let runtime = if coordinates { threads::of_a_coordinator() } else { threads::of_a_command() };
    let runtime = match runtime {
        Ok(runtime) => runtime,
        Err(error) => return exit::report(&error.into()),
    };
    signals::ignore_file_size_limit(&runtime);
    let done = runtime.block_on(commands::dispatch(cli.command));
    // What was logged comes before what is said last.
    logging::finish();
    let code = done.unwrap_or_else(|error| exit::report(&error));
    // A draw of samples still on its own thread must not hold up the end.
    runtime.shutdown_timeout(Duration::from_secs(1));
    code
}
