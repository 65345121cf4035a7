//! What Prometheus is told. Counters count decisions, after the commit which
//! made them; gauges are read from the store when asked.

use std::fmt::Write;
use std::sync::atomic::AtomicU64;
use std::time::Duration;

use prometheus_client::encoding::{EncodeLabelSet, text};
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::registry::Registry;

use crate::event::Event;
use crate::store::{Depth, WorkerSums, role_name};

/// One decision, by its name.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Decision {
    decision: &'static str,
}

/// A completion.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Completion {
    role: &'static str,
    outcome: &'static str,
}

/// A role.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Role {
    role: &'static str,
}

/// An answer.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Status {
    status: u16,
}

/// Why a request was turned away before it was looked at.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Reason {
    reason: &'static str,
}

/// Counts since the coordinator was started.
pub(crate) struct Metrics {
    registry: Registry,
    decisions: Family<Decision, Counter>,
    leased: Counter,
    completions: Family<Completion, Counter>,
    wall: Family<Role, Histogram>,
    answers: Family<Status, Counter>,
    turned_away: Family<Reason, Counter>,
    exchange: Histogram,
    serving: Histogram,
    commit: Histogram,
    operations: Histogram,
    store_failing: Gauge,
    seconds_computed: Counter<f64, AtomicU64>,
}

/// Bounds of stretches of serving, seconds: none should be longer than 50 ms.
const STRETCHES: [f64; 8] = [1e-4, 1e-3, 5e-3, 0.01, 0.025, 0.05, 0.25, 1.0];

fn seconds() -> Histogram {
    // 0.1 ms to 52 s.
    Histogram::new(exponential_buckets(1e-4, 3.0, 13))
}

impl Default for Metrics {
    fn default() -> Self {
        let mut metrics = Self {
            registry: Registry::with_prefix("manduca"),
            decisions: Family::default(),
            leased: Counter::default(),
            completions: Family::default(),
            wall: Family::new_with_constructor(|| Histogram::new(exponential_buckets(0.01, 3.0, 13))),
            answers: Family::default(),
            turned_away: Family::default(),
            exchange: seconds(),
            serving: Histogram::new(STRETCHES),
            commit: seconds(),
            operations: Histogram::new(exponential_buckets(1.0, 2.0, 10)),
            store_failing: Gauge::default(),
            seconds_computed: Counter::default(),
        };
        metrics.register();
        metrics
    }
}

impl Metrics {
    fn register(&mut self) {
        let r = &mut self.registry;
        r.register("decisions", "Decisions of the coordinator, by kind", self.decisions.clone());
        r.register("jobs_leased", "Jobs given to workers", self.leased.clone());
        r.register("jobs_completed", "Results taken, by role and outcome", self.completions.clone());
        r.register("job_wall_seconds", "Time jobs computed, by role", self.wall.clone());
        r.register("job_wall_seconds_sum", "Time all jobs computed", self.seconds_computed.clone());
        r.register("http_answers", "Answers, by status", self.answers.clone());
        r.register("requests_turned_away", "Requests refused for their token", self.turned_away.clone());
        r.register("exchange_seconds", "From an exchange's arrival to its commit", self.exchange.clone());
        r.register("serving_seconds", "Processor time of a connection in one stretch", self.serving.clone());
        r.register("commit_seconds", "Time of one commit with all it contains", self.commit.clone());
        r.register("commit_operations", "Operations committed together", self.operations.clone());
        r.register("store_failing", "1 while the database takes no writes", self.store_failing.clone());
    }

    /// Counts a decision.
    pub(crate) fn observe(&self, event: &Event) {
        let Some(decision) = event.name() else { return };
        self.decisions.get_or_create(&Decision { decision }).inc_by(event.count());
        match event {
            Event::Leased { jobs, .. } => {
                self.leased.inc_by(*jobs as u64);
            }
            Event::Completed { role, outcome, wall_s, .. } => {
                let role = role_name(*role);
                self.completions.get_or_create(&Completion { role, outcome }).inc();
                self.wall.get_or_create(&Role { role }).observe(*wall_s);
                self.seconds_computed.inc_by(wall_s.max(0.0));
            }
            _ => {}
        }
    }

    /// Counts an answer.
    pub(crate) fn answered(&self, status: u16) {
        self.answers.get_or_create(&Status { status }).inc();
    }

    /// Counts a request refused for its token.
    pub(crate) fn turned_away(&self, reason: &'static str) {
        self.turned_away.get_or_create(&Reason { reason }).inc();
    }

    /// Notes how long an exchange waited for its commit.
    pub(crate) fn exchanged(&self, took: Duration) {
        self.exchange.observe(took.as_secs_f64());
    }

    /// Notes how long a connection kept a thread which serves.
    pub(crate) fn served(&self, took: Duration) {
        self.serving.observe(took.as_secs_f64());
    }

    /// Notes a commit, or that there was none.
    pub(crate) fn committed(&self, took: Duration, operations: usize, done: bool) {
        self.commit.observe(took.as_secs_f64());
        self.operations.observe(operations as f64);
        self.store_failing.set(i64::from(!done));
    }

    /// Everything in the OpenMetrics text format.
    ///
    /// # Errors
    /// None in practice: text is written to a string.
    pub(crate) fn render(&self, depths: &[Depth], workers: &WorkerSums) -> Result<String, std::fmt::Error> {
        let mut out = String::with_capacity(8192);
        writeln!(out, "# HELP manduca_jobs Jobs in the store, by role and state.\n# TYPE manduca_jobs gauge")?;
        for Depth { role, state, jobs } in depths {
            writeln!(out, "manduca_jobs{{role=\"{role}\",state=\"{state}\"}} {jobs}")?;
        }
        writeln!(out, "# HELP manduca_workers Workers heard of lately.\n# TYPE manduca_workers gauge")?;
        for (state, n) in
            [("alive", workers.alive), ("quarantined", workers.quarantined), ("draining", workers.draining)]
        {
            writeln!(out, "manduca_workers{{state=\"{state}\"}} {n}")?;
        }
        writeln!(out, "# HELP manduca_slots Slots of the workers alive.\n# TYPE manduca_slots gauge")?;
        writeln!(out, "manduca_slots {}", workers.slots)?;
        text::encode(&mut out, &self.registry)?;
        Ok(out)
    }
}
