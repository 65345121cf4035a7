//! Options which say what to keep of a flight.

use std::path::PathBuf;

use clap::Args;
use manduca_numerics::history::Steps;

const HEADING: &str = "Step by step (docs/histories.md)";

/// What is kept of a flight; nothing unless asked for. With `--case all` each case
/// has files of its own, its name before the ending.
#[derive(Debug, Args)]
pub struct RecordArgs {
    /// Write angles, rates, lift, drag, moment and power per joint at every step: .csv or .ndjson
    /// (a row per step), or .json (one object). With --case all a file per case: FILE-CASE.csv.
    #[arg(long, value_name = "FILE", help_heading = HEADING)]
    pub history: Option<PathBuf>,
    /// Write the vortex rings of wing and wake at the steps of --wake-steps, as one JSON object.
    #[arg(long, value_name = "FILE.json", help_heading = HEADING)]
    pub wake: Option<PathBuf>,
    /// Write wing and wake into this folder for ParaView: two .vtp files for each step of
    /// --wake-steps, and flight.pvd to open. With --case all a folder in it per case.
    #[arg(long, value_name = "DIR", help_heading = HEADING)]
    pub vtk: Option<PathBuf>,
    /// Steps whose rings are written: last, all (of the last stroke), all/4 (every fourth of them), or
    /// STROKE:STEP with strokes from 1 and steps from 0, such as 7:0,7:12,last [default: last, and all
    /// with --vtk].
    #[arg(long, value_name = "LIST", help_heading = HEADING)]
    pub wake_steps: Option<Steps>,
}
