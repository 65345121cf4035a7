//! One leased job, from its task to its outcome.

use std::time::Duration;

use manduca_protocol::ids::JobId;
use manduca_protocol::task::{JobKind, Task};
use manduca_protocol::worker::{Fault, Lease};
use tokio::sync::watch;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tracing::warn;

use crate::http::{self, Http};
use crate::slot::{News, Outcome, Slot};
use crate::trouble::Trouble;

/// Longest time a large task may take to arrive.
const FETCH: Duration = Duration::from_secs(300);
/// A run limit beyond this is none.
const LONGEST_RUN: f64 = 30.0 * 86_400.0;

/// A job which has come to its end, with the slot it gives back.
pub(crate) struct Finished {
    pub(crate) job: JobId,
    pub(crate) attempt: u32,
    pub(crate) kind: JobKind,
    pub(crate) slot: Slot,
    pub(crate) outcome: Outcome,
}

/// Fetches the task where it did not come with the lease, and computes it.
pub(crate) async fn work(
    mut slot: Slot,
    lease: Lease,
    http: Http,
    news: watch::Sender<News>,
    stop: CancellationToken,
) -> Finished {
    let Lease { job, attempt, kind, run_limit_s, task, .. } = lease;
    let task = match task {
        Some(task) => Ok(task),
        None => tokio::select! {
            () = stop.cancelled() => Err(Outcome::Cancelled),
            task = fetch(&http, job) => task.map_err(|why| Outcome::Failed(why, Fault::Machine)),
        },
    };
    let limit = Duration::try_from_secs_f64(run_limit_s.min(LONGEST_RUN)).unwrap_or_default();
    let outcome = match task {
        Ok(task) => slot.run(&task, limit, &news, &stop).await,
        Err(outcome) => outcome,
    };
    Finished { job, attempt, kind, slot, outcome }
}

/// Fetches a task for as long as it takes: the lease is renewed meanwhile, and the coordinator ends it
/// where nothing comes of it. A refused token may be a passing fault too.
async fn fetch(http: &Http, job: JobId) -> Result<Task, String> {
    let mut trouble = Trouble::default();
    loop {
        let request = http.get(&format!("/v1/jobs/{job}/task")).timeout(FETCH);
        match http::call(request).await {
            Ok(task) => return Ok(task),
            Err(error) if error.is_passing() || matches!(error.status(), Some(401 | 403)) => {
                let (wait, tell) = trouble.add(&error, Instant::now());
                if tell {
                    warn!(%job, %error, advice = error.advice(), "the task cannot be fetched yet");
                }
                tokio::time::sleep(wait).await;
            }
            Err(error) => return Err(format!("cannot fetch the task: {error}")),
        }
    }
}
