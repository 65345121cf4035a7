//! The worker: it pulls jobs from a coordinator, computes each in a child
//! process and sends the results back until they are answered.
//!
//! [`run`] is the whole worker; [`slot::slot_main`] is what the child processes
//! run. Nothing here knows the database, and nothing but the child computes, so
//! that a crash, an out-of-memory kill or an endless loop costs one attempt and
//! never the worker.

mod agent;
mod backoff;
pub mod compute;
pub mod http;
mod job;
mod outbox;
pub mod slot;
mod trouble;

use std::path::PathBuf;
use std::time::Duration;

use manduca_protocol::problem::Problem;
use tokio_util::sync::CancellationToken;

/// Most slots of one worker: what fits in the lists of one exchange.
pub const MAX_SLOTS: usize = manduca_protocol::worker::MAX_BATCH;

/// How long a worker drains unless told otherwise: shorter than systemd waits before it kills.
pub const DRAIN_TIMEOUT: Duration = Duration::from_secs(60);

/// How a worker is set up.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Address of the coordinator, such as `http://127.0.0.1:8080`.
    pub coordinator: String,
    /// What the coordinator asks for, if it does.
    pub token: Option<http::Token>,
    /// Jobs computed at the same time, 1 to [`MAX_SLOTS`].
    pub slots: usize,
    /// Name for people, such as the host's.
    pub name: String,
    /// What a compute slot starts: a program which calls [`slot::slot_main`].
    pub program: PathBuf,
    /// Its arguments.
    pub arguments: Vec<String>,
    /// Longest wait of one request for work.
    pub poll: Duration,
    /// How long it stays without a job, whether the coordinator can be reached or not; for ever where none.
    pub idle_exit: Option<Duration>,
    /// How long it takes jobs; for ever where none. Then it finishes what runs and leaves.
    pub max_runtime: Option<Duration>,
    /// How long a draining worker computes and tries to deliver. What runs then is given back.
    pub drain_timeout: Duration,
}

impl Settings {
    /// One slot per core, started as `<program> slot`.
    pub fn new(coordinator: impl Into<String>, program: impl Into<PathBuf>) -> Self {
        Self {
            coordinator: coordinator.into(),
            token: None,
            slots: std::thread::available_parallelism().map_or(1, usize::from).min(MAX_SLOTS),
            name: "worker".into(),
            program: program.into(),
            arguments: vec!["slot".into()],
            poll: Duration::from_secs(10),
            idle_exit: None,
            max_runtime: None,
            drain_timeout: DRAIN_TIMEOUT,
        }
    }
}

/// The two ways to end a worker; each may be asked for at any time.
#[derive(Debug, Clone, Default)]
pub struct Shutdown {
    /// Finish what runs within [`Settings::drain_timeout`], take nothing new, deliver, leave.
    pub drain: CancellationToken,
    /// Leave at once: what runs is given back and computed elsewhere.
    pub stop: CancellationToken,
}

/// What a worker did in its life.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Summary {
    /// Jobs finished and delivered.
    pub completed: u64,
    /// Attempts which failed here.
    pub failed: u64,
    /// Results the coordinator refused, such as those of a lease which had expired.
    pub refused: u64,
    /// Results and running jobs lost because the coordinator no longer knew the worker.
    pub lost: u64,
    /// Results it left without delivering.
    pub undelivered: u64,
    /// Running jobs given back as it left.
    pub given_back: u64,
}

/// Why a worker cannot work.
#[derive(Debug, thiserror::Error)]
pub enum WorkerError {
    /// The settings make no sense.
    #[error("{0}")]
    Settings(String),
    /// The coordinator will not have it: versions differ, for example.
    #[error("the coordinator refuses this worker: {0}")]
    Refused(Box<Problem>),
    /// It left, as its settings say, before any coordinator had taken it.
    #[error("left after {:.0} s without having been registered by a coordinator: {why}", after.as_secs_f64())]
    NeverRegistered {
        /// How long it tried.
        after: Duration,
        /// What went wrong last.
        why: String,
    },
}

/// Works until told to leave. An unreachable coordinator is no error: the
/// worker keeps computing, keeps its results and keeps trying.
///
/// # Errors
/// When the settings make no sense, the coordinator refuses the worker, or the worker's time is over
/// before it is registered.
pub async fn run(settings: Settings, shutdown: Shutdown) -> Result<Summary, WorkerError> {
    if !(1..=MAX_SLOTS).contains(&settings.slots) {
        return Err(WorkerError::Settings(format!("slots: {} is outside 1 to {MAX_SLOTS}", settings.slots)));
    }
    let http = http::Http::with_token(&settings.coordinator, settings.token.as_ref()).map_err(WorkerError::Settings)?;
    agent::Agent::new(settings, http, shutdown).run().await
}
