//! `manduca db ...`, `manduca workers ...`, `manduca explain`, `manduca doctor`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::Coordinator;

/// `manduca db ...`.
#[derive(Debug, Subcommand)]
pub enum DbCommand {
    /// Write a compact copy of a database, which may be in use, and check the copy.
    Backup(BackupArgs),
    /// Check a database: the file, what must hold in and between its tables, every digest and key.
    Check(CheckArgs),
    /// Remove studies which ended long ago.
    Prune(PruneArgs),
}

/// The folder of a database.
#[derive(Debug, Args)]
pub struct Data {
    /// Folder of the database.
    #[arg(long, value_name = "DIR", default_value = "manduca-data", env = "MANDUCA_DATA")]
    pub data: PathBuf,
}

/// `manduca db backup`.
#[derive(Debug, Args)]
#[command(after_help = "\
To restore, stop the coordinator, move its database with its -wal and -shm files away and put
the copy in its place as manduca.db.

Example:
  manduca db backup /backup/manduca-$(date +%F).db --data /var/lib/manduca")]
pub struct BackupArgs {
    /// File to write; it must not be there.
    pub file: PathBuf,
    #[command(flatten)]
    pub data: Data,
    /// Print one JSON object: the file and its size.
    #[arg(long)]
    pub json: bool,
}

/// `manduca db check`.
#[derive(Debug, Args)]
#[command(after_help = "\
The file is only read: it may lie on a read-only disk, belong to another user, and be in use.
Exit code 1 where something is wrong.")]
pub struct CheckArgs {
    #[command(flatten)]
    pub data: Data,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// `manduca db prune`.
#[derive(Debug, Args)]
#[command(after_help = "\
Removes studies which succeeded, failed or were cancelled. Results which other studies share
are kept. The file keeps its size and uses the room for what comes; a backup is compact. A
coordinator does the same by itself with `manduca serve --keep-days N`.

Example:
  manduca db prune --older-than-days 90 --dry-run")]
pub struct PruneArgs {
    /// Only studies which ended this many days ago or more.
    #[arg(long, value_name = "DAYS", value_parser = super::days)]
    pub older_than_days: f64,
    /// Only say what would be removed.
    #[arg(long)]
    pub dry_run: bool,
    /// Believe this machine's clock, even if it is more than a day after the database was last in use.
    #[arg(long)]
    pub force: bool,
    #[command(flatten)]
    pub data: Data,
    /// Print one JSON array.
    #[arg(long)]
    pub json: bool,
}

/// `manduca workers ...`.
#[derive(Debug, Subcommand)]
pub enum WorkersCommand {
    /// List the workers which are there, heard of within a day.
    List(WorkerListArgs),
    /// Ask workers to finish what they have and leave.
    Drain(DrainArgs),
    /// Set a worker aside and disown all of its results.
    Disown(DisownArgs),
    /// Give jobs again to a worker that was set aside.
    Readmit(ReadmitArgs),
}

/// `manduca workers disown`.
#[derive(Debug, Args)]
#[command(after_help = "\
Its results are dropped and computed again in studies that still sample. In all others they are
marked: their views say that they rest on them. No study shares them any more. The worker is
given no jobs until it is readmitted. A token needs the scope `admin` for this.

Examples:
  manduca workers disown node17
  manduca workers disown node17 --data /var/lib/manduca")]
pub struct DisownArgs {
    /// Its name, or its id; all workers of that name.
    pub worker: String,
    #[command(flatten)]
    pub coordinator: Coordinator,
    /// Do it in the database of this folder, which may be in use; it knows workers that left long ago.
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Print one JSON array of the ids.
    #[arg(long)]
    pub json: bool,
}

/// `manduca workers readmit`.
#[derive(Debug, Args)]
#[command(after_help = "\
Results that were disowned stay disowned. A token needs the scope `admin` for this.

Example:
  manduca workers readmit node17")]
pub struct ReadmitArgs {
    /// Its name, or its id; all workers of that name.
    pub worker: String,
    #[command(flatten)]
    pub coordinator: Coordinator,
    /// Print one JSON array of the ids.
    #[arg(long)]
    pub json: bool,
}

/// `manduca workers list`.
#[derive(Debug, Args)]
pub struct WorkerListArgs {
    #[command(flatten)]
    pub coordinator: Coordinator,
    /// Print one JSON array.
    #[arg(long)]
    pub json: bool,
}

/// `manduca workers drain`.
#[derive(Debug, Args)]
#[command(after_help = "\
A token needs the scope `admin` for this.

Examples:
  manduca workers drain node17
  manduca workers drain --all")]
pub struct DrainArgs {
    /// Its name, or its id; all workers of that name.
    #[arg(required_unless_present = "all", conflicts_with = "all")]
    pub worker: Option<String>,
    /// All workers.
    #[arg(long)]
    pub all: bool,
    #[command(flatten)]
    pub coordinator: Coordinator,
    /// Print one JSON array of the workers asked, as they were.
    #[arg(long)]
    pub json: bool,
}

/// `manduca explain`.
#[derive(Debug, Args)]
pub struct ExplainArgs {
    /// Number of the job.
    #[arg(value_name = "JOB", value_parser = job_number)]
    pub job: i64,
    #[command(flatten)]
    pub coordinator: Coordinator,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// The number of a job.
fn job_number(text: &str) -> Result<i64, String> {
    text.parse().map_err(|_| {
        "a job has a number, such as 17; `manduca dataset STUDY --provenance` tells those of its samples".into()
    })
}

/// `manduca doctor`.
#[derive(Debug, Args)]
#[command(after_help = "\
Looks at this machine, at the folder of a database if there is one, and at a coordinator if one
answers; says what it found and what to do. Exit code 1 where something is wrong.

Examples:
  manduca doctor
  manduca doctor --coordinator https://manduca.example --token-file token")]
pub struct DoctorArgs {
    #[command(flatten)]
    pub coordinator: Coordinator,
    #[command(flatten)]
    pub data: Data,
    /// Print one JSON array.
    #[arg(long)]
    pub json: bool,
}
