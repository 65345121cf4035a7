//! What the coordinator does beside the requests: it checks large results, and flies strokes about which two
//! workers differ. All of it is in the store, so that a restart loses nothing of it.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use manduca_protocol::ids::JobId;
use manduca_protocol::task::{JobKind, Task};
use manduca_protocol::view::JobRole;
use tokio::sync::{Notify, oneshot};
use tokio_util::sync::CancellationToken;

use crate::claims::{self, Fault};
use crate::compose;
use crate::error::chain;
use crate::event::Event;
use crate::look::{self, Failed};
use crate::store::{BeginDispute, Checked, Dispute, Settle, Store, StoreError, Truth};

/// How long to wait after a failure of the store.
const PAUSE: Duration = Duration::from_secs(5);

/// The outcome of a check: why a result is of no use, if it is not.
type Told = Option<String>;

/// Who waits for what.
#[derive(Debug, Default)]
pub(crate) struct Beside {
    trainings: Notify,
    others: Notify,
    disputes: Notify,
    waiting: Mutex<HashMap<JobId, Vec<oneshot::Sender<Told>>>>,
}

impl Beside {
    /// Hears of what was committed.
    pub(crate) fn observe(&self, event: &Event) {
        match event {
            Event::Unchecked { role: JobRole::Train, .. } => self.trainings.notify_one(),
            Event::Unchecked { .. } => self.others.notify_one(),
            Event::Audited { agrees: false, .. } => self.disputes.notify_one(),
            _ => {}
        }
    }

    /// The outcome of a check of this job's result, once there is one.
    pub(crate) fn wait(&self, job: JobId) -> oneshot::Receiver<Told> {
        let (sender, receiver) = oneshot::channel();
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.retain(|_, senders| {
            senders.retain(|sender| !sender.is_closed());
            !senders.is_empty()
        });
        waiting.entry(job).or_default().push(sender);
        receiver
    }

    fn tell(&self, job: JobId, told: &Told) {
        let senders = self.waiting.lock().unwrap_or_else(PoisonError::into_inner).remove(&job);
        for sender in senders.into_iter().flatten() {
            // Whoever waited may have gone.
            let _ = sender.send(told.clone());
        }
    }
}

/// Starts all of it. Trainings, which may take a minute each, wait apart from the rest.
pub(crate) fn start(store: &Store, beside: &Arc<Beside>, stopping: &CancellationToken) {
    for kind in [JobKind::Train, JobKind::Search] {
        tokio::spawn(check(store.clone(), beside.clone(), stopping.clone(), kind));
    }
    tokio::spawn(settle(store.clone(), beside.clone(), stopping.clone()));
}

/// Checks results one after the other until the coordinator stops.
async fn check(store: Store, beside: Arc<Beside>, stopping: CancellationToken, kind: JobKind) {
    let news = if kind == JobKind::Train { &beside.trainings } else { &beside.others };
    while !stopping.is_cancelled() {
        match check_next(&store, &beside, kind).await {
            Ok(true) => {}
            Ok(false) => tokio::select! {
                () = stopping.cancelled() => {}
                () = news.notified() => {}
            },
            Err(error) => pause(&error, "A result could not be checked", &stopping).await,
        }
    }
}

/// Checks the result that has waited longest; false where none waits.
async fn check_next(store: &Store, beside: &Beside, kind: JobKind) -> Result<bool, StoreError> {
    let Some(unchecked) = store.next_unchecked(kind).await? else { return Ok(false) };
    let (job, attempt) = (unchecked.result.job, unchecked.result.attempt);
    let fault = match claims::check(store, unchecked).await {
        Ok(checked) => checked.err(),
        Err(StoreError::Corrupt(why)) => Some(Fault::Unreadable(why)),
        Err(StoreError::UnknownJob(_)) => None,
        Err(error) => return Err(error),
    };
    store.run(Checked { job, attempt, fault: fault.clone() }).await?;
    let told = fault.filter(|fault| !matches!(fault, Fault::Unreadable(_)));
    beside.tell(job, &told.map(|fault| fault.to_string()));
    Ok(true)
}

/// Settles differences between samples and audits, one after the other, until the coordinator stops.
async fn settle(store: Store, beside: Arc<Beside>, stopping: CancellationToken) {
    while !stopping.is_cancelled() {
        match settle_next(&store, &stopping).await {
            Ok(true) => {}
            Ok(false) => tokio::select! {
                () = stopping.cancelled() => {}
                () = beside.disputes.notified() => {}
            },
            Err(error) => pause(&error, "A difference could not be settled", &stopping).await,
        }
    }
}

/// Settles the oldest difference; false where there is none.
async fn settle_next(store: &Store, stopping: &CancellationToken) -> Result<bool, StoreError> {
    let Some(dispute) = store.next_dispute().await? else { return Ok(false) };
    let audit = dispute.audit;
    let truth = if store.run(BeginDispute { audit }).await? {
        match fly(dispute, stopping.clone()).await {
            Some(truth) => truth,
            // The coordinator stops: it begins again when it is back.
            None => return Ok(true),
        }
    } else {
        Truth::Unknown
    };
    store.run(Settle { audit, truth }).await?;
    Ok(true)
}

/// Flies the stroke of a dispute on a thread of its own; nothing when the coordinator stops.
async fn fly(dispute: Dispute, stopping: CancellationToken) -> Option<Truth> {
    let sample = dispute.sample;
    let task = compose::simulation(&dispute.spec, JobRole::Sample, dispute.ordinal, &dispute.parameters);
    let Ok(Task::Simulate(task)) = task else { return Some(Truth::Unknown) };
    let flying = tokio::task::spawn_blocking(move || look::result(&task, &|| !stopping.is_cancelled()));
    match flying.await {
        Ok(Ok(Some(digest))) => Some(Truth::Digest(digest)),
        Ok(Ok(None)) => None,
        Ok(Err(Failed::NonFinite)) => Some(Truth::Nothing),
        Ok(Err(error)) => {
            tracing::error!(error.cause = %chain(&error), job.id = %sample, "The coordinator could not fly a stroke");
            Some(Truth::Unknown)
        }
        Err(error) => {
            tracing::error!(error.cause = %error, job.id = %sample, "The coordinator's flight of a stroke ended");
            Some(Truth::Unknown)
        }
    }
}

async fn pause(error: &StoreError, what: &'static str, stopping: &CancellationToken) {
    if matches!(error, StoreError::Closed) {
        return stopping.cancelled().await;
    }
    tracing::error!(error.cause = %chain(error), "{what}");
    tokio::select! {
        () = stopping.cancelled() => {}
        () = tokio::time::sleep(PAUSE) => {}
    }
}
