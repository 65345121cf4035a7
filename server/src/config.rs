//! Every number the coordinator's behaviour depends on, named.

use std::path::PathBuf;
use std::time::Duration;

use manduca_protocol::task::JobKind;

use crate::auth::{Access, Hosts};

/// How the coordinator behaves. The default suits one coordinator with any
/// number of workers in one network.
#[derive(Debug, Clone)]
pub struct Config {
    /// The SQLite file; it is created when missing, its folder too.
    pub database: PathBuf,
    /// Whether tokens are asked for.
    pub access: Access,
    /// The hosts under which it answers where no tokens are asked for.
    pub hosts: Hosts,
    /// How long a lease lasts without renewal.
    pub lease: Duration,
    /// How often workers are asked to renew.
    pub renew: Duration,
    /// Time between two sweeps beyond which the coordinator was away: leases are given what it missed.
    pub away: Duration,
    /// Failures after which a job is given up.
    pub max_attempts: u32,
    /// Workers lost with a job after which it is given up.
    pub max_losses: u32,
    /// Wait after the first failure; each further one waits four times as long.
    pub backoff: Duration,
    /// Longest wait after a failure.
    pub max_backoff: Duration,
    /// Failures of a worker in a row after which it is given no jobs for a while.
    pub strikes: u32,
    /// How long that is.
    pub quarantine: Duration,
    /// Jobs a worker may hold per slot: as many wait to be delivered as are computed, at most.
    pub leases_per_slot: u32,
    /// Jobs a worker may hold before its first success.
    pub probation: u32,
    /// Failures of a worker, which nobody confirmed or contradicted within a minute, after which it is given no jobs.
    pub doubts: u32,
    /// Workers which a token may register at once.
    pub registrations: u32,
    /// Workers which it may register from then on, per second.
    pub registrations_per_s: f64,
    /// How long an attempt may compute, renewed or not, by kind of job.
    pub run_limits: RunLimits,
    /// How long the check of a training, an optimum or a round of a search may take, with its wait for those
    /// before it.
    pub check_limit: Duration,
    /// How long a worker that delivers such a result is kept waiting for the outcome of the check.
    pub check_wait: Duration,
    /// What an attempt beyond its limit is given to say so itself, before the coordinator does.
    pub run_grace: Duration,
    /// How long studies are kept after their end; for ever where none.
    pub keep: Option<Duration>,
    /// How often expired leases and waits are looked for.
    pub sweep: Duration,
    /// How long open requests may take to finish at shutdown.
    pub shutdown: Duration,
    /// How long a request's headers may take to arrive, and how long a connection may be idle.
    pub header_wait: Duration,
    /// How long a client may leave an answer unread.
    pub write_wait: Duration,
    /// Largest head of a request, bytes; at least 8192.
    pub header_limit: usize,
    /// Connections open at the same time; others wait to be accepted.
    pub connections: usize,
    /// How long a request's body may take to arrive.
    pub body_wait: Duration,
    /// Largest body of a study, an optimisation, a stroke or a registration, bytes. The largest study
    /// there can be, written with all its fields and every character escaped, has 200 KiB.
    pub study_limit: usize,
    /// Largest body of an exchange, bytes: a thousand results of simulations have 1.3 MiB.
    pub exchange_limit: usize,
    /// Largest body of an exchange by a worker with a job which is no simulation, bytes: the largest
    /// training there can be has 33 MiB.
    pub large_limit: usize,
    /// Largest body of points to predict, bytes.
    pub body_limit: usize,
    /// Connections which only read.
    pub readers: u32,
    /// Refused results kept as evidence, of each class.
    pub evidence: u32,
    /// Refused results kept as evidence, of each class and worker.
    pub evidence_per_worker: u32,
    /// Clients which may watch the changes at the same time.
    pub watchers: usize,
}

impl Config {
    /// The defaults on a database.
    pub fn new(database: impl Into<PathBuf>) -> Self {
        Self {
            database: database.into(),
            access: Access::Open,
            hosts: Hosts::default(),
            lease: Duration::from_secs(15),
            renew: Duration::from_secs(5),
            away: Duration::from_millis(3750),
            max_attempts: 3,
            max_losses: 10,
            backoff: Duration::from_secs(1),
            max_backoff: Duration::from_secs(60),
            strikes: 5,
            quarantine: Duration::from_secs(300),
            leases_per_slot: 2,
            probation: 8,
            doubts: 64,
            registrations: 1000,
            registrations_per_s: 1.0,
            run_limits: RunLimits::default(),
            check_limit: Duration::from_secs(3600),
            check_wait: Duration::from_secs(2),
            run_grace: Duration::from_secs(30),
            keep: None,
            sweep: Duration::from_millis(500),
            shutdown: Duration::from_secs(10),
            header_wait: Duration::from_secs(30),
            write_wait: Duration::from_secs(60),
            header_limit: 16 << 10,
            connections: 10_000,
            body_wait: Duration::from_secs(30),
            study_limit: 256 << 10,
            exchange_limit: 4 << 20,
            large_limit: 64 << 20,
            body_limit: 2 << 20,
            readers: 4,
            evidence: 1000,
            evidence_per_worker: 50,
            watchers: 256,
        }
    }

    /// Sets how long a lease lasts, and what follows from it.
    pub fn set_lease(&mut self, lease: Duration) {
        self.lease = lease;
        self.renew = lease / 3;
        self.away = (lease / 4).max(2 * self.sweep);
    }

    /// How long a job waits after its `failures`-th failure, ms.
    pub(crate) fn backoff_ms(&self, failures: u32) -> i64 {
        let factor = 4_u32.saturating_pow(failures.saturating_sub(1));
        millis(self.backoff.saturating_mul(factor).min(self.max_backoff))
    }

    /// How long a lease lasts, ms.
    pub(crate) fn lease_ms(&self) -> i64 {
        millis(self.lease)
    }
}

/// How long an attempt may compute before it is taken for an endless one. Apart from the
/// lease, which a worker caught in an endless loop goes on renewing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunLimits {
    /// A simulation.
    pub simulate: Duration,
    /// A training.
    pub train: Duration,
    /// An optimisation, or a round of a search.
    pub optimise: Duration,
}

impl Default for RunLimits {
    fn default() -> Self {
        let hours = |n: u64| Duration::from_secs(n * 3600);
        Self { simulate: Duration::from_secs(600), train: hours(4), optimise: hours(2) }
    }
}

impl RunLimits {
    /// That of one kind.
    pub fn of(&self, kind: JobKind) -> Duration {
        match kind {
            JobKind::Simulate => self.simulate,
            JobKind::Train => self.train,
            JobKind::Optimise | JobKind::Search => self.optimise,
        }
    }
}

/// A duration as the store counts time.
pub(crate) fn millis(duration: Duration) -> i64 {
    i64::try_from(duration.as_millis()).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_follows_from_a_lease_is_what_the_defaults_are() {
        let mut config = Config::new("x");
        let defaults = (config.renew, config.away);
        config.set_lease(config.lease);
        assert_eq!((config.renew, config.away), defaults);
        config.set_lease(Duration::from_secs(1));
        assert_eq!(config.away, 2 * config.sweep);
    }

    #[test]
    fn the_wait_grows_fourfold_up_to_its_limit() {
        let config = Config::new("x");
        assert_eq!([1, 2, 3, 4, 99].map(|n| config.backoff_ms(n)), [1000, 4000, 16_000, 60_000, 60_000]);
    }
}
