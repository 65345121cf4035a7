//! What is seen of the coordinator's answers, and what must never be.

use std::collections::{BTreeSet, HashMap};
use std::hash::{DefaultHasher, Hash, Hasher};

use manduca_protocol::ids::JobId;
use manduca_protocol::worker::ExchangeResponse;
use serde_json::Value;

/// A lease is good for so long, ms.
const LEASE: i64 = 15_000;

#[derive(Debug)]
struct Held {
    worker: String,
    attempt: u32,
    until: i64,
}

/// Follows every lease from outside.
#[derive(Debug, Default)]
pub(super) struct Witness {
    held: HashMap<JobId, Held>,
    /// The last lease of each job: its attempt, and to whom.
    attempts: HashMap<JobId, (u32, String)>,
    /// Jobs whose result was acknowledged.
    pub(super) acknowledged: BTreeSet<i64>,
    /// Whether a submission was.
    pub(super) submitted: bool,
    /// Of all it saw, without the names of workers: those are different in each run.
    course: DefaultHasher,
}

impl Witness {
    /// What an exchange says and is told, apart from its leases.
    pub(super) fn see(&mut self, now: i64, worker: &str, said: &Value, told: &ExchangeResponse) {
        let leases: Vec<_> = told.jobs.iter().map(|lease| (lease.job.0, lease.attempt)).collect();
        let [accepted, cancel] =
            [&told.accepted, &told.cancel].map(|jobs| jobs.iter().map(|job| job.0).collect::<Vec<_>>());
        (now, accepted, cancel, told.rejected.len(), leases).hash(&mut self.course);
        let ids = |list: &str| -> Vec<(JobId, u32)> {
            let items = said[list].as_array().into_iter().flatten();
            items.filter_map(|i| Some((JobId(i["job"].as_i64()?), i["attempt"].as_u64()? as u32))).collect()
        };
        for (job, _) in ids("complete") {
            if told.accepted.contains(&job) {
                self.acknowledged.insert(job.0);
            }
        }
        for (job, attempt) in ids("complete").into_iter().chain(ids("fail")) {
            let ends = |h: &Held| h.worker == worker && h.attempt == attempt && told.accepted.contains(&job);
            if self.held.get(&job).is_some_and(ends) {
                self.held.remove(&job);
            }
        }
        for (job, attempt) in ids("renew") {
            let renewed = !told.cancel.contains(&job);
            if let Some(held) =
                self.held.get_mut(&job).filter(|h| renewed && h.worker == worker && h.attempt == attempt)
            {
                held.until = now + LEASE;
            }
        }
    }

    /// Its leases.
    pub(super) fn see_leases(&mut self, now: i64, worker: &str, told: &ExchangeResponse) -> Result<(), String> {
        for lease in &told.jobs {
            // The same lease again, to a worker which has not heard of it.
            let last = self.attempts.insert(lease.job, (lease.attempt, worker.to_owned()));
            let again = last.as_ref().is_some_and(|(attempt, holder)| *attempt == lease.attempt && holder == worker);
            if let Some(held) = self.held.get(&lease.job).filter(|held| held.until > now && !again) {
                return Err(format!("job {} is leased twice at once, to {worker} beside {held:?}", lease.job));
            }
            let last = last.map_or(0, |(attempt, _)| attempt);
            if lease.attempt <= last && !again {
                return Err(format!("job {} goes from attempt {last} to {}", lease.job, lease.attempt));
            }
            if self.acknowledged.contains(&lease.job.0) {
                return Err(format!("job {} is leased after its result was acknowledged", lease.job));
            }
            let held = Held { worker: worker.to_owned(), attempt: lease.attempt, until: now + LEASE };
            self.held.insert(lease.job, held);
        }
        Ok(())
    }

    /// What names all it has seen.
    pub(super) fn course(&self) -> u64 {
        self.course.finish()
    }

    /// The coordinator is killed: what has ended by then is not taken up again.
    pub(super) fn killed(&mut self, now: i64) {
        self.held.retain(|_, held| held.until > now);
    }

    /// After a restart every lease has a full term.
    pub(super) fn restarted(&mut self, now: i64) {
        self.held.values_mut().for_each(|held| held.until = now + LEASE);
    }
}
