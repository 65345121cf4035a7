//! The jobs in the slots.

use std::collections::HashMap;

use manduca_protocol::ids::JobId;
use manduca_protocol::worker::{Failure, Fault, Lease, Renewal};
use tokio::sync::watch;
use tokio::task::{Id, JoinSet};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use crate::http::Http;
use crate::job::{self, Finished};
use crate::slot::{News, Slot};

/// A job in a slot.
struct Entry {
    attempt: u32,
    since: Instant,
    stop: CancellationToken,
    news: watch::Receiver<News>,
    task: Id,
}

/// How a job left its slot.
pub(super) enum Ended {
    Finished(Box<Finished>),
    /// A bug of the worker itself; nothing to report where the job was cancelled.
    Lost(Option<Failure>),
}

/// Everything which computes now. A cancelled job leaves `entries` at once, and
/// `tasks` when its child is dead.
#[derive(Default)]
pub(super) struct Running {
    entries: HashMap<JobId, Entry>,
    tasks: JoinSet<Finished>,
}

impl Running {
    pub(super) fn len(&self) -> usize {
        self.entries.len()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Its jobs and their attempts.
    pub(super) fn jobs(&self) -> impl Iterator<Item = (JobId, u32)> {
        self.entries.iter().map(|(job, entry)| (*job, entry.attempt))
    }

    /// Computes a job. An earlier attempt at it has lost its lease, or this one would not be here.
    pub(super) fn start(&mut self, slot: Slot, lease: Lease, http: Http) {
        let (job, attempt) = (lease.job, lease.attempt);
        let (sender, news) = watch::channel(News::default());
        let stop = CancellationToken::new();
        let task = self.tasks.spawn(job::work(slot, lease, http, sender, stop.clone())).id();
        let entry = Entry { attempt, since: Instant::now(), stop, news, task };
        if let Some(earlier) = self.entries.insert(job, entry) {
            earlier.stop.cancel();
        }
    }

    /// Waits for a job to end; for ever where none runs.
    pub(super) async fn next(&mut self) -> Ended {
        let joined = match self.tasks.join_next().await {
            Some(joined) => joined,
            None => std::future::pending().await,
        };
        match joined {
            Ok(finished) => {
                if self.entries.get(&finished.job).is_some_and(|entry| entry.attempt == finished.attempt) {
                    self.entries.remove(&finished.job);
                }
                Ended::Finished(Box::new(finished))
            }
            Err(error) => {
                let job = self.entries.iter().find(|(_, e)| e.task == error.id()).map(|(&job, _)| job);
                let lost = job.and_then(|job| Some((job, self.entries.remove(&job)?.attempt)));
                let reason = format!("the worker failed: {error}");
                Ended::Lost(lost.map(|(job, attempt)| Failure { job, attempt, reason, fault: Some(Fault::Machine) }))
            }
        }
    }

    /// Stops a job, unless it was leased again after the question whose answer this is.
    pub(super) fn cancel(&mut self, job: JobId, asked: Instant) -> bool {
        if self.entries.get(&job).is_none_or(|entry| entry.since > asked) {
            return false;
        }
        self.entries.remove(&job).inspect(|entry| entry.stop.cancel()).is_some()
    }

    /// Stops everything; says how much that was.
    pub(super) fn cancel_all(&mut self) -> usize {
        self.entries.drain().map(|(_, entry)| entry.stop.cancel()).count()
    }

    /// Whether a job has progress not yet reported.
    pub(super) fn has_news(&self) -> bool {
        self.entries.values().any(|entry| entry.news.has_changed().unwrap_or(false))
    }

    /// Renewals of all jobs, or only of those with news; with their news or without.
    pub(super) fn renewals(&mut self, all: bool, tell: bool) -> Vec<Renewal> {
        let renewal = |(&job, entry): (&JobId, &mut Entry)| {
            let changed = entry.news.has_changed().unwrap_or(false);
            let News { progress, checkpoint } = if changed {
                entry.news.borrow_and_update().clone()
            } else {
                News { progress: entry.news.borrow().progress.clone(), checkpoint: None }
            };
            let (progress, checkpoint) = if tell { (progress, checkpoint) } else { (None, None) };
            (all || changed).then_some(Renewal { job, attempt: entry.attempt, progress, checkpoint })
        };
        self.entries.iter_mut().filter_map(renewal).collect()
    }
}
