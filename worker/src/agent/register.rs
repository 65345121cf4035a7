//! The worker introduces itself, at its start and after a coordinator has forgotten it.

use std::time::Duration;

use manduca_numerics::simulation;
use manduca_protocol::worker::{PROTOCOL_VERSION, RegisterRequest, RegisterResponse};
use tokio::time::{Instant, sleep_until};
use tracing::{info, warn};

use super::Agent;
use crate::http::{self, CallError};
use crate::{Summary, WorkerError};

impl Agent {
    /// Introduces the worker, for as long as it takes; false when it is told to leave first, or its
    /// time is over.
    pub(super) async fn register(&mut self, first: bool) -> Result<bool, WorkerError> {
        let request = RegisterRequest {
            name: self.settings.name.clone(),
            slots: u32::try_from(self.settings.slots).unwrap_or(u32::MAX),
            protocol_version: PROTOCOL_VERSION,
            solver_version: simulation::SOLVER_VERSION.into(),
            level: simulation::level().into(),
        };
        let shutdown = self.shutdown.clone();
        loop {
            let call = http::call::<RegisterResponse>(self.http.post("/v1/workers").json(&request));
            let over = self.ends_at();
            let answer = tokio::select! {
                () = shutdown.stop.cancelled() => return Ok(false),
                () = shutdown.drain.cancelled() => return Ok(false),
                () = until(over) => return Ok(false),
                answer = call => answer,
            };
            match answer {
                Ok(answer) => {
                    self.settle(&answer);
                    return Ok(true);
                }
                Err(CallError::Refused(problem)) if is_final(&problem, first) => {
                    return Err(WorkerError::Refused(problem));
                }
                Err(error) => self.on_trouble(&error),
            }
            tokio::select! {
                () = shutdown.stop.cancelled() => return Ok(false),
                () = shutdown.drain.cancelled() => return Ok(false),
                () = until(over) => return Ok(false),
                () = sleep_until(self.not_before) => {}
            }
        }
    }

    fn settle(&mut self, answer: &RegisterResponse) {
        self.worker = Some(answer.worker);
        // What the network says is bounded, or a bad number would spin or starve the loop.
        let renew = if answer.renew_s.is_finite() { answer.renew_s.clamp(0.05, 3600.0) } else { 5.0 };
        self.renew = Duration::from_secs_f64(renew);
        self.trouble.is_over();
        self.not_before = Instant::now();
        let (slots, level) = (self.settings.slots, simulation::level());
        info!(worker = %answer.worker, slots, level, coordinator = self.http.base(), "registered");
    }

    /// The end of a worker which is not registered.
    pub(super) fn unregistered(self) -> Result<Summary, WorkerError> {
        if self.shutdown.drain.is_cancelled() || self.shutdown.stop.is_cancelled() {
            return Ok(self.summary);
        }
        let why = self.last_trouble.unwrap_or_else(|| "it does not answer".into());
        Err(WorkerError::NeverRegistered { after: self.began.elapsed(), why })
    }

    /// The coordinator no longer knows this worker. Every attempt is fenced by the name it was leased
    /// under: no coordinator takes what was computed for a name it does not know, so that is lost.
    pub(super) async fn start_over(&mut self) -> Result<(), WorkerError> {
        (self.report, self.poll, self.worker) = (None, None, None);
        for (job, attempt) in self.outbox.jobs() {
            warn!(%job, attempt, "result lost: the coordinator has forgotten the worker it was leased to");
        }
        let undelivered = self.outbox.len();
        let running = self.running.cancel_all();
        warn!(running, undelivered, "unknown to the coordinator: leases dropped, registering anew");
        self.summary.lost += (running + undelivered) as u64;
        self.outbox.clear();
        if !self.register(false).await? && self.drain_until.is_none() {
            self.drain("asked to leave, or its time is over");
        }
        Ok(())
    }
}

/// Whether a coordinator's refusal will be the same at the next try. A worker which has been taken
/// before waits out a refused token, for its coordinator may be under repair.
fn is_final(problem: &manduca_protocol::problem::Problem, first: bool) -> bool {
    let differs = problem.is("solver-version") || problem.is("protocol-version");
    differs || (first && (400..500).contains(&problem.status) && !matches!(problem.status, 408 | 425 | 429))
}

/// Waits until a time; for ever where there is none.
async fn until(time: Option<Instant>) {
    match time {
        Some(time) => sleep_until(time).await,
        None => std::future::pending().await,
    }
}
