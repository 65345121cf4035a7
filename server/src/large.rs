//! Which workers may send large exchanges: those with a job whose result is large.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use manduca_protocol::ids::WorkerId;

/// How long after its job has ended a worker may send the result again, should the answer be lost.
const REPLAYS: Duration = Duration::from_secs(600);
/// Most workers remembered; then all are forgotten, and the store is asked.
const MOST: usize = 10_000;

/// When each worker was last known to have such a job.
#[derive(Debug, Default)]
pub(crate) struct Large {
    seen: Mutex<HashMap<WorkerId, Instant>>,
}

impl Large {
    /// Notes that a worker has such a job.
    pub(crate) fn note(&self, worker: WorkerId) {
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        if seen.len() >= MOST && !seen.contains_key(&worker) {
            seen.clear();
        }
        seen.insert(worker, Instant::now());
    }

    /// Whether a worker had such a job a short while ago.
    pub(crate) fn had_lately(&self, worker: WorkerId) -> bool {
        let seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        seen.get(&worker).is_some_and(|at| at.elapsed() < REPLAYS)
    }
}
