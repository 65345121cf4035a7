//! The worker's one loop. It alone owns what the worker knows, so there is
//! nothing to lock and no order of events to fear.
//!
//! At most two requests are under way: a *report*, which delivers results and
//! renewals, asks for as many jobs as there are idle slots and is answered at
//! once; and a *poll*, which only waits for jobs. A result never waits behind a
//! poll, and no poll is cut short while it might have been granted a job, for
//! such a job would be lost until its lease expires.

mod flight;
mod running;

use std::time::Duration;

use manduca_numerics::simulation;
use manduca_protocol::ids::{JobId, WorkerId};
use manduca_protocol::worker::{
    Completion, ExchangeRequest, ExchangeResponse, Failure, Fault, Lease, PROTOCOL_VERSION, RegisterRequest,
    RegisterResponse,
};
use tokio::time::{Instant, MissedTickBehavior, sleep_until};
use tracing::{debug, info, warn};

use crate::backoff::Backoff;
use crate::http::{self, CallError, Http};
use crate::job::Finished;
use crate::outbox::{Delivered, Outbox, Report};
use crate::slot::{Outcome, Slot};
use crate::{Settings, Shutdown, Summary, WorkerError};
use flight::{Flight, Landed, landed};
use running::{Ended, Running};

/// How often the loop looks whether a renewal or news of a long job is due.
const TICK: Duration = Duration::from_secs(1);
/// A poll which comes back empty sooner than this is not repeated at once.
const TOO_SOON: Duration = Duration::from_millis(500);
/// How long the worker says goodbye.
const GOODBYE: Duration = Duration::from_secs(3);

pub(crate) struct Agent {
    settings: Settings,
    http: Http,
    shutdown: Shutdown,
    worker: WorkerId,
    renew: Duration,
    idle: Vec<Slot>,
    running: Running,
    outbox: Outbox,
    /// An answer was lost which may have brought jobs.
    missed: bool,
    report: Option<Flight>,
    poll: Option<Flight>,
    renew_at: Instant,
    renewal_due: bool,
    not_before: Instant,
    poll_after: Instant,
    backoff: Backoff,
    drain_until: Option<Instant>,
    began: Instant,
    idle_since: Instant,
    summary: Summary,
}

impl Agent {
    pub(crate) fn new(settings: Settings, http: Http, shutdown: Shutdown) -> Self {
        let slot = |_| Slot::new(settings.program.clone(), settings.arguments.clone());
        Self {
            idle: (0..settings.slots).map(slot).collect(),
            http,
            shutdown,
            worker: WorkerId::new(),
            renew: TICK,
            running: Running::default(),
            outbox: Outbox::new(),
            missed: false,
            report: None,
            poll: None,
            renew_at: Instant::now(),
            renewal_due: false,
            not_before: Instant::now(),
            poll_after: Instant::now(),
            backoff: Backoff::default(),
            drain_until: None,
            began: Instant::now(),
            idle_since: Instant::now(),
            summary: Summary::default(),
            settings,
        }
    }

    pub(crate) async fn run(mut self) -> Result<Summary, WorkerError> {
        if !self.register().await? {
            return Ok(self.summary);
        }
        let mut tick = tokio::time::interval(TICK.min(self.renew));
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let Shutdown { drain, stop } = self.shutdown.clone();
        while !self.is_done() {
            self.take_off();
            tokio::select! {
                () = stop.cancelled() => break,
                () = drain.cancelled(), if self.drain_until.is_none() => self.drain("asked to leave"),
                ended = self.running.next() => self.on_ended(ended),
                answer = landed(&mut self.report) => self.on_report(answer).await?,
                answer = landed(&mut self.poll) => self.on_poll(answer).await?,
                _ = tick.tick() => self.on_tick(),
                () = sleep_until(self.not_before), if self.not_before > Instant::now() => {}
            }
        }
        self.leave().await;
        Ok(self.summary)
    }

    /// Introduces the worker, for as long as it takes; false when it is told to leave first.
    async fn register(&mut self) -> Result<bool, WorkerError> {
        let request = RegisterRequest {
            name: self.settings.name.clone(),
            slots: u32::try_from(self.settings.slots).unwrap_or(u32::MAX),
            protocol_version: PROTOCOL_VERSION,
            solver_version: simulation::SOLVER_VERSION.into(),
            level: simulation::level().into(),
        };
        let shutdown = self.shutdown.clone();
        loop {
            let answer = tokio::select! {
                () = shutdown.stop.cancelled() => return Ok(false),
                () = shutdown.drain.cancelled() => return Ok(false),
                answer = http::call::<RegisterResponse>(self.http.post("/v1/workers").json(&request)) => answer,
            };
            match answer {
                Ok(answer) => {
                    self.settle(&answer);
                    return Ok(true);
                }
                Err(error) if error.is_passing() => {
                    self.trouble(&error);
                    tokio::select! {
                        () = shutdown.stop.cancelled() => return Ok(false),
                        () = shutdown.drain.cancelled() => return Ok(false),
                        () = sleep_until(self.not_before) => {}
                    }
                }
                Err(CallError::Refused(problem)) => return Err(WorkerError::Refused(problem)),
                Err(error) => return Err(WorkerError::NotACoordinator(error)),
            }
        }
    }

    fn settle(&mut self, answer: &RegisterResponse) {
        self.worker = answer.worker;
        // What the network says is bounded, or a bad number would spin or starve the loop.
        self.renew = Duration::from_secs_f64(answer.renew_s.clamp(0.05, 3600.0));
        self.backoff.reset();
        self.not_before = Instant::now();
        let (slots, level) = (self.settings.slots, simulation::level());
        info!(worker = %self.worker, slots, level, coordinator = self.http.base(), "registered");
    }

    /// Sends off whatever is due.
    fn take_off(&mut self) {
        let now = Instant::now();
        if now < self.not_before {
            return;
        }
        if self.report.is_none() && (!self.outbox.is_empty() || self.renewal_due) {
            let mut request = ExchangeRequest { want: self.unasked(), ..ExchangeRequest::default() };
            let batch = self.outbox.fill(&mut request);
            if self.renewal_due {
                let all = now >= self.renew_at;
                request.renew = self.running.renewals(all);
                self.renew_at = if all { now + self.renew } else { self.renew_at };
                self.renewal_due = false;
            }
            self.report = Some(self.exchange(request, batch));
        }
        let want = self.unasked();
        if self.poll.is_none() && want > 0 && now >= self.poll_after {
            let request =
                ExchangeRequest { want, wait_s: self.settings.poll.as_secs_f64(), ..ExchangeRequest::default() };
            self.poll = Some(self.exchange(request, 0));
        }
    }

    /// Idle slots no request under way asks a job for.
    fn unasked(&self) -> u32 {
        if self.drain_until.is_some() {
            return 0;
        }
        let idle = u32::try_from(self.idle.len()).unwrap_or(u32::MAX);
        [&self.report, &self.poll].into_iter().flatten().fold(idle, |left, flight| left.saturating_sub(flight.want))
    }

    /// Jobs it computes or has yet to deliver, and their attempts.
    fn jobs(&self) -> impl Iterator<Item = (JobId, u32)> {
        self.running.jobs().chain(self.outbox.jobs())
    }

    fn exchange(&mut self, mut request: ExchangeRequest, batch: usize) -> Flight {
        if request.want > 0 && std::mem::take(&mut self.missed) {
            request.have = Some(self.jobs().map(|(job, _)| job).collect());
        }
        let wait = Duration::try_from_secs_f64(request.wait_s).unwrap_or_default();
        let path = format!("/v1/workers/{}/exchange", self.worker);
        let call = self.http.post(&path).timeout(http::CALL + wait).json(&request);
        Flight::new(http::call(call), request.want, batch)
    }

    async fn on_report(&mut self, landed: Landed) -> Result<(), WorkerError> {
        match landed.answer {
            Ok(answer) => {
                let Delivered { completed, failed, refused } = self.outbox.answered(landed.batch, &answer);
                self.summary.completed += completed;
                self.summary.failed += failed;
                self.summary.refused += refused;
                self.on_answer(answer, landed.since);
            }
            Err(error) if error.status() == Some(404) => self.start_over().await?,
            Err(error) => {
                if !error.is_passing() {
                    self.outbox.refused(landed.batch, &error.to_string());
                }
                // It may have carried renewals.
                self.renew_at = Instant::now();
                self.missed |= landed.want > 0;
                self.trouble(&error);
            }
        }
        Ok(())
    }

    async fn on_poll(&mut self, landed: Landed) -> Result<(), WorkerError> {
        match landed.answer {
            Ok(answer) => {
                if answer.jobs.is_empty() && landed.since.elapsed() < TOO_SOON {
                    self.poll_after = Instant::now() + TOO_SOON;
                }
                self.on_answer(answer, landed.since);
            }
            Err(error) if error.status() == Some(404) => self.start_over().await?,
            Err(error) => {
                self.missed = true;
                self.trouble(&error);
            }
        }
        Ok(())
    }

    fn on_answer(&mut self, answer: ExchangeResponse, asked: Instant) {
        if self.backoff.reset() {
            info!("the coordinator answers again");
        }
        for job in answer.cancel {
            if self.running.cancel(job, asked) {
                info!(%job, "job taken away");
            }
        }
        for lease in answer.jobs {
            self.start(lease);
        }
        if answer.drain && self.drain_until.is_none() {
            self.drain("the coordinator asks it to leave");
        }
    }

    fn start(&mut self, lease: Lease) {
        let (job, attempt) = (lease.job, lease.attempt);
        // Given again because another answer was on its way.
        if self.jobs().any(|had| had == (job, attempt)) {
            return;
        }
        match self.idle.pop() {
            Some(slot) => {
                debug!(%job, attempt, kind = ?lease.kind, "job started");
                self.running.start(slot, lease, self.http.clone());
            }
            None => {
                let reason = "more jobs granted than asked for".into();
                self.fail(Failure { job, attempt, reason, fault: Some(Fault::Machine) });
            }
        }
    }

    fn on_ended(&mut self, ended: Ended) {
        let Finished { job, attempt, kind, slot, outcome } = match ended {
            Ended::Finished(finished) => *finished,
            Ended::Lost(failure) => {
                // The slot went down with its task; its child is killed on drop.
                self.idle.push(Slot::new(self.settings.program.clone(), self.settings.arguments.clone()));
                return failure.into_iter().for_each(|f| self.fail(f));
            }
        };
        self.idle.push(slot);
        match outcome {
            Outcome::Done(result, provenance) => {
                info!(%job, attempt, ?kind, wall_s = provenance.wall_s, "job done");
                self.outbox.push(Report::Complete(Completion { job, attempt, result: *result, provenance }));
            }
            Outcome::Failed(reason, fault) => self.fail(Failure { job, attempt, reason, fault: Some(fault) }),
            Outcome::Cancelled => {}
        }
    }

    fn fail(&mut self, failure: Failure) {
        warn!(job = %failure.job, attempt = failure.attempt, reason = failure.reason, "attempt failed");
        self.outbox.push(Report::Fail(failure));
    }

    fn on_tick(&mut self) {
        let due = Instant::now() >= self.renew_at;
        self.renewal_due |= (due && !self.running.is_empty()) || self.running.has_news();
        if !self.running.is_empty() || !self.outbox.is_empty() {
            self.idle_since = Instant::now();
        }
        let is_over = |limit: Option<Duration>, since: Instant| limit.is_some_and(|limit| since.elapsed() >= limit);
        if self.drain_until.is_some() {
            return;
        }
        if is_over(self.settings.max_runtime, self.began) {
            self.drain("its time is over");
        } else if is_over(self.settings.idle_exit, self.idle_since) {
            self.drain("there was nothing to do for long enough");
        }
    }

    /// Notes a failed call and when to try again.
    fn trouble(&mut self, error: &CallError) {
        if !self.backoff.is_failing() {
            warn!(%error, "reconnecting");
        }
        let wait = self.backoff.next();
        debug!(%error, wait_s = wait.as_secs_f64(), "call failed");
        self.not_before = Instant::now() + wait;
    }

    /// The coordinator no longer knows this worker: its leases are gone, and so
    /// is the use of what it has computed under them.
    async fn start_over(&mut self) -> Result<(), WorkerError> {
        (self.report, self.poll) = (None, None);
        let running = self.running.cancel_all();
        warn!(running, undelivered = self.outbox.len(), "unknown to the coordinator: leases dropped, registering anew");
        self.outbox.clear();
        if !self.register().await? {
            self.drain("asked to leave");
        }
        Ok(())
    }

    fn drain(&mut self, why: &str) {
        info!(why, running = self.running.len(), "draining: finishing what runs, taking nothing new");
        // A job granted to this poll goes back with the goodbye.
        self.poll = None;
        self.drain_until = Some(Instant::now() + self.settings.drain_patience);
    }

    fn is_done(&mut self) -> bool {
        let Some(until) = &mut self.drain_until else { return false };
        let answers = !self.backoff.is_failing();
        if answers || !self.running.is_empty() {
            *until = Instant::now() + self.settings.drain_patience;
        }
        let delivered = self.outbox.is_empty() && self.report.is_none();
        let given_up = Instant::now() >= *until;
        if given_up {
            warn!(undelivered = self.outbox.len(), "the coordinator does not answer; leaving without delivering");
        }
        self.running.is_empty() && (delivered || given_up)
    }

    /// Says goodbye, so that whatever is still leased is given to others at once.
    async fn leave(&mut self) {
        self.running.cancel_all();
        self.idle.clear();
        let request = self.http.delete(&format!("/v1/workers/{}", self.worker)).timeout(GOODBYE);
        match http::send(request).await {
            Ok(_) => info!(completed = self.summary.completed, failed = self.summary.failed, "left"),
            Err(error) => warn!(%error, "left without a goodbye; leases expire by themselves"),
        }
    }
}
