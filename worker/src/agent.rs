//! The worker's one loop. It alone owns what the worker knows, so there is
//! nothing to lock and no order of events to fear.
//!
//! At most two requests are under way: a *report*, which delivers results and
//! renewals, asks for as many jobs as there are idle slots and is answered at
//! once; and a *poll*, which only waits for jobs. A result never waits behind a
//! poll, and no poll is cut short while it might have been granted a job, for
//! such a job would be lost until its lease expires.

mod flight;
mod leave;
mod register;
mod running;

use std::time::Duration;

use manduca_protocol::ids::{JobId, WorkerId};
use manduca_protocol::worker::{Completion, ExchangeRequest, ExchangeResponse, Failure, Fault, Lease};
use tokio::time::{Instant, MissedTickBehavior, sleep_until};
use tracing::{debug, info, warn};

use crate::http::{self, CallError, Http};
use crate::job::Finished;
use crate::outbox::{Delivered, Outbox, Report};
use crate::slot::{Outcome, Slot};
use crate::trouble::Trouble;
use crate::{Settings, Shutdown, Summary, WorkerError};
use flight::{Flight, Landed, landed};
use running::{Ended, Running};

/// How often the loop looks whether a renewal or news of a long job is due.
const TICK: Duration = Duration::from_secs(1);
/// A poll which comes back empty sooner than this is not repeated at once.
const TOO_SOON: Duration = Duration::from_millis(500);
/// Wait after an answer which does not tell what became of a result.
const UNTOLD: Duration = Duration::from_secs(1);

pub(crate) struct Agent {
    settings: Settings,
    http: Http,
    shutdown: Shutdown,
    /// The name it is registered under, if it is.
    worker: Option<WorkerId>,
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
    /// The coordinator refused renewals with news: the next ones go without.
    without_news: bool,
    not_before: Instant,
    poll_after: Instant,
    trouble: Trouble,
    /// What went wrong last.
    last_trouble: Option<String>,
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
            worker: None,
            renew: TICK,
            running: Running::default(),
            outbox: Outbox::new(),
            missed: false,
            report: None,
            poll: None,
            renew_at: Instant::now(),
            renewal_due: false,
            without_news: false,
            not_before: Instant::now(),
            poll_after: Instant::now(),
            trouble: Trouble::default(),
            last_trouble: None,
            drain_until: None,
            began: Instant::now(),
            idle_since: Instant::now(),
            summary: Summary::default(),
            settings,
        }
    }

    pub(crate) async fn run(mut self) -> Result<Summary, WorkerError> {
        if !self.register(true).await? {
            return self.unregistered();
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

    /// Sends off whatever is due.
    fn take_off(&mut self) {
        let now = Instant::now();
        if now < self.not_before || self.worker.is_none() {
            return;
        }
        if self.report.is_none() && (!self.outbox.is_empty() || self.renewal_due) {
            let request = self.next_report(now);
            self.report = Some(self.exchange(request));
        }
        let want = self.unasked();
        if self.poll.is_none() && want > 0 && now >= self.poll_after {
            let request =
                ExchangeRequest { want, wait_s: self.settings.poll.as_secs_f64(), ..ExchangeRequest::default() };
            self.poll = Some(self.exchange(request));
        }
    }

    /// Results, failures and renewals which are due. A report which the coordinator may be unable to
    /// read goes by itself, so that nothing else is refused with it.
    fn next_report(&mut self, now: Instant) -> ExchangeRequest {
        let mut request = ExchangeRequest::default();
        if !self.outbox.is_suspect() || !self.renewal_due {
            self.outbox.fill(&mut request);
        }
        if self.renewal_due {
            let all = now >= self.renew_at;
            request.renew = self.running.renewals(all, !self.without_news);
            self.renew_at = if all { now + self.renew } else { self.renew_at };
            self.renewal_due = false;
        }
        if !self.outbox.is_suspect() {
            request.want = self.unasked();
        }
        request
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

    fn exchange(&mut self, mut request: ExchangeRequest) -> Flight {
        if request.want > 0 && std::mem::take(&mut self.missed) {
            request.have = Some(self.jobs().map(|(job, _)| job).collect());
        }
        let wait = Duration::try_from_secs_f64(request.wait_s).unwrap_or_default();
        let worker = self.worker.map(|worker| worker.to_string()).unwrap_or_default();
        let path = format!("/v1/workers/{worker}/exchange");
        let call = self.http.post(&path).timeout(http::CALL + wait).json(&request);
        Flight::new(http::call(call), &request)
    }

    async fn on_report(&mut self, landed: Landed) -> Result<(), WorkerError> {
        match landed.answer {
            Ok(answer) => {
                let untold = self.settle_batch(landed.batch, &answer);
                self.without_news &= landed.renewed == 0;
                self.on_answer(answer, landed.since);
                if untold > 0 {
                    warn!(untold, "the answer does not tell what became of results; they are sent again");
                    self.not_before = Instant::now() + UNTOLD;
                }
            }
            Err(error) if error.is_problem("unknown-worker") => self.start_over().await?,
            Err(error) => {
                if error.refuses_content() {
                    self.on_refusal(landed.batch, landed.renewed, &error);
                }
                // It may have carried renewals.
                self.renew_at = Instant::now();
                self.missed |= landed.want > 0;
                self.on_trouble(&error);
            }
        }
        Ok(())
    }

    /// Counts what a batch has become; gives how many reports the answer leaves out.
    fn settle_batch(&mut self, batch: usize, answer: &ExchangeResponse) -> usize {
        let Delivered { completed, failed, refused, untold } = self.outbox.answered(batch, answer);
        self.summary.completed += completed;
        self.summary.failed += failed;
        self.summary.refused += refused;
        untold
    }

    /// The coordinator cannot read what was sent.
    fn on_refusal(&mut self, batch: usize, renewed: usize, error: &CallError) {
        if batch > 0 {
            self.outbox.refused(batch, &error.to_string());
        } else if renewed > 0 && !self.without_news {
            warn!(%error, "renewals are refused; they are sent without progress and checkpoints");
            self.without_news = true;
        }
    }

    async fn on_poll(&mut self, landed: Landed) -> Result<(), WorkerError> {
        match landed.answer {
            Ok(answer) => {
                if answer.jobs.is_empty() && landed.since.elapsed() < TOO_SOON {
                    self.poll_after = Instant::now() + TOO_SOON;
                }
                self.on_answer(answer, landed.since);
            }
            Err(error) if error.is_problem("unknown-worker") => self.start_over().await?,
            Err(error) => {
                self.missed = true;
                self.on_trouble(&error);
            }
        }
        Ok(())
    }

    fn on_answer(&mut self, answer: ExchangeResponse, asked: Instant) {
        if self.trouble.is_over() {
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
        self.renewal_due |= (due && !self.running.is_empty()) || (self.running.has_news() && !self.without_news);
        if !self.running.is_empty() {
            self.idle_since = Instant::now();
        }
        if self.drain_until.is_none()
            && let Some(why) = self.is_over()
        {
            self.drain(why);
        }
    }

    /// Notes a failed call and when to try again.
    fn on_trouble(&mut self, error: &CallError) {
        let (wait, tell) = self.trouble.add(error, Instant::now());
        if tell {
            let (running, undelivered, advice) = (self.running.len(), self.outbox.len(), error.advice());
            warn!(%error, advice, running, undelivered, "reconnecting; running jobs and results are kept");
        }
        debug!(%error, wait_s = wait.as_secs_f64(), "call failed");
        self.last_trouble = Some(error.to_string());
        self.not_before = Instant::now() + wait;
    }
}
