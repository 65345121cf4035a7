//! The whole worker against a coordinator which misbehaves as networks do.
#![cfg(unix)]
// A test which cannot go on panics.
#![allow(clippy::unwrap_used)]

mod coordinator;
#[path = "worker/leaving.rs"]
mod leaving;
#[path = "worker/strangers.rs"]
mod strangers;

use std::time::{Duration, Instant};

use coordinator::{Coordinator, DONE, FAILED};
use manduca_worker::{Settings, Shutdown, Summary, WorkerError};
use tokio::task::JoinHandle;

/// A slot which answers every task with one line.
fn answers(line: &str) -> String {
    format!("while read task; do echo '{line}'; done")
}

fn settings(coordinator: &Coordinator, script: &str) -> Settings {
    let mut settings = Settings::new(&coordinator.url, "/bin/sh");
    settings.arguments = vec!["-c".into(), script.into()];
    settings.slots = 2;
    settings.poll = Duration::from_secs(2);
    settings
}

fn start(settings: Settings) -> (Shutdown, JoinHandle<Result<Summary, WorkerError>>) {
    let shutdown = Shutdown::default();
    (shutdown.clone(), tokio::spawn(manduca_worker::run(settings, shutdown)))
}

async fn until(what: &str, done: impl Fn() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < Duration::from_secs(20), "still waiting until {what}");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn jobs_are_computed_delivered_and_the_worker_leaves() {
    let coordinator = Coordinator::start().await;
    coordinator.queue(1..=20);
    let (shutdown, worker) = start(settings(&coordinator, &answers(DONE)));
    until("all are done", || coordinator.see(|s| s.completed.len() == 20)).await;
    shutdown.drain.cancel();
    let summary = worker.await.unwrap().unwrap();
    assert_eq!(summary, Summary { completed: 20, ..Summary::default() });
    coordinator.see(|s| {
        assert_eq!(s.left, 1);
        assert!(s.completed.values().all(|&times| times == 1), "nothing was sent twice without need");
    });
}

#[tokio::test(flavor = "multi_thread")]
async fn a_result_is_sent_again_until_it_is_answered() {
    let coordinator = Coordinator::start().await;
    coordinator.queue(1..=3);
    // The coordinator takes the results, and its answers are lost.
    coordinator.change(|s| s.lose_reports = 4);
    let (shutdown, worker) = start(settings(&coordinator, &answers(DONE)));
    until("it was answered", || coordinator.see(|s| s.completed.len() == 3 && s.lose_reports == 0)).await;
    shutdown.drain.cancel();
    assert_eq!(worker.await.unwrap().unwrap().completed, 3);
    assert!(coordinator.see(|s| s.completed.values().any(|&times| times > 1)), "no result was sent twice");
}

#[tokio::test(flavor = "multi_thread")]
async fn jobs_in_a_lost_answer_are_asked_for_again() {
    let coordinator = Coordinator::start().await;
    coordinator.queue(1..=6);
    coordinator.change(|s| s.lose_grants = 2);
    let (shutdown, worker) = start(settings(&coordinator, &answers(DONE)));
    until("all are done", || coordinator.see(|s| s.completed.len() == 6 && s.leased.is_empty())).await;
    shutdown.drain.cancel();
    assert_eq!(worker.await.unwrap().unwrap(), Summary { completed: 6, ..Summary::default() });
    assert!(coordinator.see(|s| s.given_again >= 2), "the lost jobs came back by themselves");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_result_does_not_wait_for_an_open_poll() {
    let coordinator = Coordinator::start().await;
    let mut settings = settings(&coordinator, &format!("while read task; do sleep 0.2; echo '{DONE}'; done"));
    settings.poll = Duration::from_secs(20);
    coordinator.queue(1..=1);
    let (shutdown, worker) = start(settings);
    let begun = Instant::now();
    until("the one job is done", || coordinator.see(|s| s.completed.len() == 1)).await;
    assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
    shutdown.drain.cancel();
    worker.await.unwrap().unwrap();
    assert!(begun.elapsed() < Duration::from_secs(10), "draining does not wait for the poll");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_crash_costs_one_attempt_and_a_refusal_is_told() {
    let coordinator = Coordinator::start().await;
    coordinator.queue(1..=4);
    let script = format!(
        "n=0; while read task; do n=$((n+1)); [ $n = 2 ] && {{ echo boom >&2; exit 3; }}; echo '{FAILED}'; done"
    );
    let mut settings = settings(&coordinator, &script);
    settings.slots = 1;
    let (shutdown, worker) = start(settings);
    until("all have failed", || coordinator.see(|s| s.failed.len() == 4)).await;
    shutdown.drain.cancel();
    assert_eq!(worker.await.unwrap().unwrap().failed, 4);
    let reasons = coordinator.see(|s| s.failed.clone());
    assert_eq!(reasons.iter().filter(|r| r.contains("exit status: 3") && r.contains("boom")).count(), 2, "{reasons:?}");
    assert_eq!(reasons.iter().filter(|r| *r == "no such wing").count(), 2, "{reasons:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn leases_are_renewed_and_a_cancelled_job_is_killed() {
    let coordinator = Coordinator::start().await;
    coordinator.queue(1..=1);
    let dir = tempfile::tempdir().unwrap();
    let pid_file = dir.path().join("pid");
    let script = format!("echo $$ > {}; read task; exec sleep 60", pid_file.display());
    let (shutdown, worker) = start(settings(&coordinator, &script));
    until("it is renewed twice", || coordinator.see(|s| s.renewed >= 2)).await;
    let pid = std::fs::read_to_string(&pid_file).unwrap();
    assert!(std::path::Path::new("/proc").join(pid.trim()).exists());
    coordinator.change(|s| s.cancel = vec![1]);
    until("the slot is dead", || !std::path::Path::new("/proc").join(pid.trim()).exists()).await;
    // The slot is free again, and nothing is said of the job.
    coordinator.change(|s| s.cancel.clear());
    shutdown.drain.cancel();
    assert_eq!(worker.await.unwrap().unwrap(), Summary::default());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stop_does_not_wait_for_running_jobs() {
    let coordinator = Coordinator::start().await;
    coordinator.queue(1..=2);
    let (shutdown, worker) = start(settings(&coordinator, "exec sleep 60"));
    until("both are leased", || coordinator.see(|s| s.leased.len() == 2)).await;
    shutdown.drain.cancel();
    tokio::time::sleep(Duration::from_millis(300)).await;
    assert!(!worker.is_finished(), "draining waits for running jobs");
    shutdown.stop.cancel();
    tokio::time::timeout(Duration::from_secs(5), worker).await.unwrap().unwrap().unwrap();
    assert_eq!(coordinator.see(|s| s.left), 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_unknown_after_a_restart_registers_anew() {
    let coordinator = Coordinator::start().await;
    let (shutdown, worker) = start(settings(&coordinator, &answers(DONE)));
    until("it has registered", || coordinator.see(|s| s.registered == 1)).await;
    coordinator.change(|s| s.worker = None);
    until("it has registered again", || coordinator.see(|s| s.registered == 2)).await;
    coordinator.queue(1..=2);
    until("both are done", || coordinator.see(|s| s.completed.len() == 2)).await;
    shutdown.drain.cancel();
    worker.await.unwrap().unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_coordinator_which_refuses_it_ends_the_worker() {
    let coordinator = Coordinator::start().await;
    coordinator.change(|s| s.refuse = true);
    let (_shutdown, worker) = start(settings(&coordinator, &answers(DONE)));
    let error = worker.await.unwrap().unwrap_err();
    assert!(error.to_string().contains("another solver version"), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn large_tasks_are_fetched() {
    let coordinator = Coordinator::start().await;
    coordinator.change(|s| s.inline = false);
    coordinator.queue(1..=2);
    let (shutdown, worker) = start(settings(&coordinator, &answers(DONE)));
    until("both are done", || coordinator.see(|s| s.completed.len() == 2)).await;
    assert_eq!(coordinator.see(|s| s.fetched), 2);
    shutdown.drain.cancel();
    worker.await.unwrap().unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_leaves_by_itself_when_idle_or_when_its_time_is_over() {
    let coordinator = Coordinator::start().await;
    coordinator.queue(1..=3);
    let mut idle = settings(&coordinator, &answers(DONE));
    idle.idle_exit = Some(Duration::from_secs(1));
    let summary = tokio::time::timeout(Duration::from_secs(20), start(idle).1).await.unwrap();
    assert_eq!(summary.unwrap().unwrap(), Summary { completed: 3, ..Summary::default() });

    coordinator.queue(4..=5);
    let slow = format!("while read task; do sleep 2; echo '{DONE}'; done");
    let mut timed = settings(&coordinator, &slow);
    timed.max_runtime = Some(Duration::from_millis(1500));
    let summary = tokio::time::timeout(Duration::from_secs(20), start(timed).1).await.unwrap();
    assert_eq!(summary.unwrap().unwrap().completed, 2, "what it had taken it finished");
    coordinator.see(|s| assert_eq!(s.left, 2));
}
