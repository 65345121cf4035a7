//! One module per command.

mod analyse;
mod bench;
mod completions;
mod dataset;
mod db;
mod doctor;
mod dry_run;
mod figures;
mod five;
mod hold;
mod host;
mod lists;
mod optimise;
mod record;
mod report;
mod reproduction;
mod run;
mod serve;
mod simulate;
mod study;
mod token;
mod vtk;
mod worker;
mod workers;

use std::process::ExitCode;

use anyhow::Result;

use crate::args::Command;

/// Does what was asked for.
pub async fn dispatch(command: Command) -> Result<ExitCode> {
    match command {
        Command::Run(args) => run::run(args).await,
        Command::Serve(args) => serve::serve(args).await,
        Command::Healthcheck(args) => serve::healthcheck(args).await,
        Command::Worker(args) => worker::worker(args).await,
        Command::Token(command) => token::token(command).await,
        Command::Db(command) => db::db(command).await,
        Command::Workers(command) => workers::workers(command).await,
        Command::Explain(args) => workers::explain(args).await,
        Command::Doctor(args) => doctor::doctor(args).await,
        Command::Study(command) => study::dispatch(command).await,
        Command::Optimum(args) => study::optimum(args).await,
        Command::Optimise(args) => optimise::optimise(args).await,
        Command::Analyse(command) => analyse::analyse(command).await,
        Command::Dataset(args) => dataset::dataset(args).await,
        Command::Figures(args) => figures::figures(args).await,
        Command::Simulate(args) => simulate::simulate(&args),
        Command::Bench(command) => bench::bench(&command).await,
        Command::Report(command) => report::report(&command).await,
        Command::Insects(args) => lists::insects(&args),
        Command::Completions(args) => completions::completions(&args),
        Command::Settings(args) => lists::settings(&args),
        Command::Slot => Ok(manduca_worker::slot::slot_main()),
    }
}
