//! Answers which are not the coordinator's, and refusals of its own.

use manduca_worker::{Summary, WorkerError};

use super::coordinator::{Coordinator, DONE};
use super::{answers, settings, start, until};

/// What proxies, portals and other services say.
const STRANGERS: [(u16, &str, &str); 16] = [
    (404, "text/html", "<h1>404 Not Found</h1>"),
    (401, "text/html", "<h1>Log in</h1>"),
    (403, "text/plain", "forbidden"),
    (400, "text/html", "<h1>400 Bad Request</h1>"),
    (410, "", ""),
    (413, "text/html", "too large"),
    (422, "application/json", r#"{"detail":"unprocessable"}"#),
    (502, "text/html", "<h1>Bad Gateway</h1>"),
    (302, "text/html", ""),
    (200, "text/html", "<h1>Welcome to this network</h1>"),
    (200, "application/json", "{}"),
    (200, "application/json", r#"{"accepted":[1,2],"reje"#),
    (200, "application/json", ""),
    (204, "", ""),
    (404, "application/problem+json", r#"{"type":"about:blank","title":"Not Found","status":404,"detail":""}"#),
    (404, "text/plain", r#"{"type":"urn:manduca:problem:unknown-worker","title":"t","status":404,"detail":""}"#),
];

#[tokio::test(flavor = "multi_thread")]
async fn a_strangers_answer_costs_no_result_and_no_running_job() {
    let coordinator = Coordinator::start().await;
    let slow = format!("while read task; do sleep 0.05; echo '{DONE}'; done");
    let (shutdown, worker) = start(settings(&coordinator, &slow));
    for (i, stranger) in STRANGERS.into_iter().enumerate() {
        let (first, last) = (10 * i as i64 + 1, 10 * i as i64 + 4);
        coordinator.queue(first..=last);
        until("both slots have a job", || coordinator.see(|s| s.leased.len() == 2)).await;
        coordinator.change(|s| (s.stranger, s.intercepted) = (Some(stranger), 0));
        until("the worker has asked a few times", || coordinator.see(|s| s.intercepted >= 3)).await;
        coordinator.change(|s| s.stranger = None);
        until("all is delivered", || coordinator.see(|s| s.completed.len() == 4 * (i + 1))).await;
        assert!(!worker.is_finished(), "{stranger:?}");
    }
    shutdown.drain.cancel();
    let jobs = 4 * STRANGERS.len() as u64;
    assert_eq!(worker.await.unwrap().unwrap(), Summary { completed: jobs, ..Summary::default() });
    coordinator.see(|s| assert_eq!((s.registered, s.failed.len(), s.left), (1, 0, 1)));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_strangers_answer_to_the_registration_is_waited_out() {
    let coordinator = Coordinator::start().await;
    coordinator.change(|s| s.stranger = Some(STRANGERS[0]));
    let (shutdown, worker) = start(settings(&coordinator, &answers(DONE)));
    for stranger in STRANGERS {
        coordinator.change(|s| (s.stranger, s.intercepted) = (Some(stranger), 0));
        until("it has asked once more", || coordinator.see(|s| s.intercepted >= 1)).await;
        assert!(!worker.is_finished(), "{stranger:?}");
    }
    coordinator.change(|s| s.stranger = None);
    until("it has registered", || coordinator.see(|s| s.registered == 1)).await;
    shutdown.drain.cancel();
    worker.await.unwrap().unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_task_is_fetched_past_strangers() {
    let coordinator = Coordinator::start().await;
    coordinator.change(|s| s.inline = false);
    let (shutdown, worker) = start(settings(&coordinator, &answers(DONE)));
    until("it has registered", || coordinator.see(|s| s.registered == 1)).await;
    for (i, stranger) in [STRANGERS[0], STRANGERS[1], STRANGERS[9], STRANGERS[11]].into_iter().enumerate() {
        coordinator.change(|s| (s.stranger_of_tasks, s.intercepted) = (Some(stranger), 0));
        coordinator.queue(i as i64..=i as i64);
        until("the task was asked for twice", || coordinator.see(|s| s.intercepted >= 2)).await;
        coordinator.change(|s| s.stranger_of_tasks = None);
        until("the job is done", || coordinator.see(|s| s.completed.len() == i + 1)).await;
    }
    shutdown.drain.cancel();
    assert_eq!(worker.await.unwrap().unwrap(), Summary { completed: 4, ..Summary::default() });
}

#[tokio::test(flavor = "multi_thread")]
async fn a_token_refused_at_the_start_ends_a_worker_and_later_is_waited_out() {
    let coordinator = Coordinator::start().await;
    let ours = r#"{"type":"urn:manduca:problem:unauthenticated","title":"No valid token","status":401,"detail":"d"}"#;
    coordinator.change(|s| s.stranger = Some((401, "application/problem+json", ours)));
    let error = start(settings(&coordinator, &answers(DONE))).1.await.unwrap().unwrap_err();
    assert!(matches!(&error, WorkerError::Refused(problem) if problem.status == 401), "{error}");

    coordinator.change(|s| s.stranger = None);
    coordinator.queue(1..=2);
    let (shutdown, worker) = start(settings(&coordinator, &answers(DONE)));
    until("both are done", || coordinator.see(|s| s.completed.len() == 2)).await;
    coordinator.change(|s| (s.stranger, s.intercepted) = (Some((401, "application/problem+json", ours)), 0));
    until("it has asked", || coordinator.see(|s| s.intercepted >= 3)).await;
    coordinator.change(|s| s.stranger = None);
    coordinator.queue(3..=3);
    until("the third is done", || coordinator.see(|s| s.completed.len() == 3)).await;
    shutdown.drain.cancel();
    assert_eq!(worker.await.unwrap().unwrap(), Summary { completed: 3, ..Summary::default() });
}

#[tokio::test(flavor = "multi_thread")]
async fn a_result_which_is_refused_a_few_times_is_not_lost() {
    let coordinator = Coordinator::start().await;
    coordinator.change(|s| s.unreadable = 4);
    coordinator.queue(1..=2);
    let (shutdown, worker) = start(settings(&coordinator, &answers(DONE)));
    until("both are done", || coordinator.see(|s| s.completed.len() == 2)).await;
    shutdown.drain.cancel();
    assert_eq!(worker.await.unwrap().unwrap(), Summary { completed: 2, ..Summary::default() });
}

#[tokio::test(flavor = "multi_thread")]
async fn a_result_which_is_refused_again_and_again_becomes_a_failure() {
    let coordinator = Coordinator::start().await;
    coordinator.change(|s| s.unreadable = u32::MAX);
    coordinator.queue(1..=2);
    let (shutdown, worker) = start(settings(&coordinator, &answers(DONE)));
    until("both have failed", || coordinator.see(|s| s.failed.len() == 2)).await;
    shutdown.drain.cancel();
    assert_eq!(worker.await.unwrap().unwrap(), Summary { failed: 2, ..Summary::default() });
    assert!(coordinator.see(|s| s.failed.iter().all(|reason| reason.contains("cannot read the result"))));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_checkpoint_which_is_refused_costs_no_lease() {
    let coordinator = Coordinator::start().await;
    let script = format!("while read task; do echo '{}'; sleep 2; echo '{DONE}'; done", super::leaving::CHECKPOINT);
    coordinator.change(|s| s.unreadable_checkpoints = true);
    coordinator.queue(1..=2);
    let (shutdown, worker) = start(settings(&coordinator, &script));
    until("both are done", || coordinator.see(|s| s.completed.len() == 2)).await;
    coordinator.see(|s| assert!(s.renewed >= 4 && s.checkpoints == 0, "{} renewals", s.renewed));
    shutdown.drain.cancel();
    worker.await.unwrap().unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn an_answer_which_leaves_results_out_is_no_answer_to_them() {
    let coordinator = Coordinator::start().await;
    coordinator.change(|s| s.silent = true);
    coordinator.queue(1..=2);
    let (shutdown, worker) = start(settings(&coordinator, &answers(DONE)));
    until("both have come twice", || {
        coordinator.see(|s| s.completed.len() == 2 && s.completed.values().all(|times| *times >= 2))
    })
    .await;
    coordinator.change(|s| s.silent = false);
    shutdown.drain.cancel();
    assert_eq!(worker.await.unwrap().unwrap(), Summary { completed: 2, ..Summary::default() });
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_lost_with_a_forgotten_registration_is_counted() {
    let coordinator = Coordinator::start().await;
    coordinator.queue(1..=2);
    let (shutdown, worker) = start(settings(&coordinator, "exec sleep 60"));
    until("both are leased", || coordinator.see(|s| s.leased.len() == 2)).await;
    coordinator.change(|s| s.worker = None);
    until("it has registered again", || coordinator.see(|s| s.registered == 2)).await;
    shutdown.drain.cancel();
    assert_eq!(worker.await.unwrap().unwrap(), Summary { lost: 2, ..Summary::default() });
}
