//! How a worker ends: it takes nothing new, finishes or gives back what it has, and says goodbye.

use std::time::Duration;

use manduca_protocol::worker::ExchangeRequest;
use tokio::time::{Instant, sleep, timeout};
use tracing::{info, warn};

use super::Agent;
use super::flight::landed;
use crate::backoff::Backoff;
use crate::http::{self, CallError, StatusCode};

/// How long the last results and checkpoints may take to be delivered once the time to drain is over.
const LAST_WORDS: Duration = Duration::from_secs(10);
/// How long the worker says goodbye.
const GOODBYE: Duration = Duration::from_secs(3);
/// Between two tries to deliver what is left.
const BETWEEN: Duration = Duration::from_millis(500);
/// Stands for no limit.
const FOR_EVER: Duration = Duration::from_secs(100 * 365 * 86_400);

impl Agent {
    /// When it leaves by itself, as things stand.
    pub(super) fn ends_at(&self) -> Option<Instant> {
        let at = |limit: Option<Duration>, since: Instant| limit.and_then(|limit| since.checked_add(limit));
        let (time, idle) = (at(self.settings.max_runtime, self.began), at(self.settings.idle_exit, self.idle_since));
        [time, idle].into_iter().flatten().min()
    }

    /// Why it is time to leave, if it is.
    pub(super) fn is_over(&self) -> Option<&'static str> {
        let is_over = |limit: Option<Duration>, since: Instant| limit.is_some_and(|limit| since.elapsed() >= limit);
        if is_over(self.settings.max_runtime, self.began) {
            return Some("its time is over");
        }
        is_over(self.settings.idle_exit, self.idle_since).then_some("there was nothing to do for long enough")
    }

    pub(super) fn drain(&mut self, why: &str) {
        let limit = self.settings.drain_timeout;
        let (running, limit_s) = (self.running.len(), limit.as_secs_f64());
        info!(why, running, limit_s, "draining: finishing what runs, taking nothing new");
        // A limit beyond what the clock can tell is none.
        self.drain_until = Some(Instant::now().checked_add(limit).unwrap_or_else(|| Instant::now() + FOR_EVER));
    }

    /// Whether nothing is left to do, or to wait for.
    pub(super) fn is_done(&self) -> bool {
        let Some(until) = self.drain_until else { return false };
        let is_idle = self.running.is_empty() && self.outbox.is_empty() && self.report.is_none();
        is_idle || Instant::now() >= until
    }

    /// Says goodbye, so that whatever is still leased is given to others at once.
    pub(super) async fn leave(&mut self) {
        let stop = self.shutdown.stop.clone();
        tokio::select! {
            biased;
            () = stop.cancelled() => {}
            () = self.deliver_last() => {}
            () = sleep(LAST_WORDS) => warn!("the last results and checkpoints could not be delivered in time"),
        }
        let given_back = self.running.cancel_all();
        self.idle.clear();
        self.summary.undelivered = self.outbox.len() as u64;
        for (job, attempt) in self.outbox.jobs() {
            warn!(%job, attempt, "left without delivering this result");
        }
        let Some(worker) = self.worker else { return };
        let path = format!("/v1/workers/{worker}");
        let told = timeout(GOODBYE, say_goodbye(self.http.clone(), &path)).await;
        let (completed, failed) = (self.summary.completed, self.summary.failed);
        match told {
            Ok(Ok(())) => {
                self.summary.given_back = given_back as u64;
                info!(completed, failed, given_back, "left");
            }
            Ok(Err(error)) => warn!(%error, given_back, "left without a goodbye; leases expire by themselves"),
            Err(_) => warn!(given_back, "left without a goodbye: no answer in time; leases expire by themselves"),
        }
    }

    /// Delivers what the time to drain has left over: results, and the newest checkpoints of the
    /// jobs which are about to be given back.
    async fn deliver_last(&mut self) {
        loop {
            if self.report.is_none() {
                if self.outbox.is_empty() && !self.running.has_news() {
                    return;
                }
                let mut request = ExchangeRequest::default();
                self.outbox.fill(&mut request);
                request.renew = self.running.renewals(false, !self.without_news);
                self.report = Some(self.exchange(request));
            }
            let landed = landed(&mut self.report).await;
            match landed.answer {
                Ok(answer) if self.settle_batch(landed.batch, &answer) == 0 => {}
                Err(error) if error.is_problem("unknown-worker") => return,
                Err(error) if error.refuses_content() => self.on_refusal(landed.batch, landed.renewed, &error),
                Ok(_) | Err(_) => sleep(BETWEEN).await,
            }
        }
    }
}

/// Tells the coordinator; an answer which is not its own is no answer.
async fn say_goodbye(http: http::Http, path: &str) -> Result<(), CallError> {
    let mut backoff = Backoff::default();
    loop {
        match http::send_expecting(http.delete(path).timeout(GOODBYE), StatusCode::NO_CONTENT).await {
            Err(error) if error.is_passing() => sleep(backoff.next()).await,
            answered => return answered,
        }
    }
}
