//! Workers which leave by themselves, or within a limit.

use std::time::{Duration, Instant};

use manduca_worker::{Settings, Summary, WorkerError};

use super::coordinator::{Coordinator, DONE};
use super::{answers, settings, start, until};

/// What a slot says when a training could be taken up again.
pub const CHECKPOINT: &str = r#"{"message":"checkpoint","at":{"kind":"fit","ascents":[]}}"#;

/// A port which nobody listens on.
async fn nobody() -> String {
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    format!("http://{}", listener.local_addr().unwrap())
}

async fn ends(settings: Settings) -> Result<Summary, WorkerError> {
    tokio::time::timeout(Duration::from_secs(30), start(settings).1).await.unwrap().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn limits_count_from_the_start_whatever_the_coordinator_does() {
    let coordinator = Coordinator::start().await;
    // One which takes connections and never answers.
    let mute = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let mute_url = format!("http://{}", mute.local_addr().unwrap());
    coordinator.change(|s| s.stranger = Some((404, "text/html", "no")));
    for url in [nobody().await, mute_url, coordinator.url.clone()] {
        for idle in [true, false] {
            let mut settings = settings(&coordinator, &answers(DONE));
            settings.coordinator = url.clone();
            let limit = Some(Duration::from_secs(1));
            if idle {
                settings.idle_exit = limit
            } else {
                settings.max_runtime = limit
            }
            let ended = ends(settings).await;
            assert!(matches!(ended, Err(WorkerError::NeverRegistered { .. })), "{url}: {ended:?}");
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn an_idle_worker_leaves_a_coordinator_which_has_gone() {
    let coordinator = Coordinator::start().await;
    coordinator.queue(1..=1);
    let mut settings = settings(&coordinator, &answers(DONE));
    settings.idle_exit = Some(Duration::from_secs(2));
    let (_shutdown, worker) = start(settings);
    until("the job is done", || coordinator.see(|s| s.completed.len() == 1)).await;
    coordinator.change(|s| s.stranger = Some((502, "text/html", "gone")));
    let ended = tokio::time::timeout(Duration::from_secs(30), worker).await.unwrap().unwrap().unwrap();
    assert_eq!(ended, Summary { completed: 1, ..Summary::default() });
}

#[tokio::test(flavor = "multi_thread")]
async fn results_nobody_takes_do_not_keep_a_worker_for_ever() {
    let coordinator = Coordinator::start().await;
    coordinator.queue(1..=2);
    let mut settings = settings(&coordinator, &format!("read task; sleep 1; echo '{DONE}'; cat"));
    (settings.idle_exit, settings.drain_timeout) = (Some(Duration::from_secs(2)), Duration::from_secs(1));
    let (_shutdown, worker) = start(settings);
    until("both are leased", || coordinator.see(|s| s.leased.len() == 2)).await;
    coordinator.change(|s| s.stranger = Some((502, "text/html", "gone")));
    let ended = tokio::time::timeout(Duration::from_secs(60), worker).await.unwrap().unwrap().unwrap();
    assert_eq!(ended, Summary { undelivered: 2, ..Summary::default() });
}

#[tokio::test(flavor = "multi_thread")]
async fn a_drain_has_a_limit_and_gives_back_what_still_runs() {
    let coordinator = Coordinator::start().await;
    coordinator.change(|s| s.inline = false);
    coordinator.queue(1..=2);
    let script = format!("while read task; do echo '{CHECKPOINT}'; sleep 2; echo '{CHECKPOINT}'; sleep 60; done");
    let mut settings = settings(&coordinator, &script);
    settings.drain_timeout = Duration::from_secs(4);
    let (shutdown, worker) = start(settings);
    until("both have told where they are", || coordinator.see(|s| s.checkpoints >= 2)).await;
    let asked = Instant::now();
    shutdown.drain.cancel();
    let ended = tokio::time::timeout(Duration::from_secs(30), worker).await.unwrap().unwrap().unwrap();
    assert!(asked.elapsed() >= Duration::from_secs(4), "they had their time");
    assert_eq!(ended, Summary { given_back: 2, ..Summary::default() });
    coordinator.see(|s| assert_eq!((s.left, s.checkpoints, s.failed.len()), (1, 4, 0)));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_goodbye_is_said_past_a_stranger() {
    let coordinator = Coordinator::start().await;
    let (shutdown, worker) = start(settings(&coordinator, &answers(DONE)));
    until("it has registered", || coordinator.see(|s| s.registered == 1)).await;
    coordinator.change(|s| (s.stranger, s.intercepted) = (Some((200, "text/html", "hello")), 0));
    shutdown.drain.cancel();
    until("it has said goodbye to a stranger", || coordinator.see(|s| s.intercepted >= 2)).await;
    coordinator.change(|s| s.stranger = None);
    worker.await.unwrap().unwrap();
    assert_eq!(coordinator.see(|s| s.left), 1);
}
