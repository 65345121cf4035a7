//! Whom the coordinator blames for a failure, and what a worker may do before it is known.

use std::collections::BTreeMap;

use axum::body::Body;
use axum::http::Request;
use manduca_protocol::task::JobKind;
use manduca_protocol::worker::Lease;
use serde_json::{Value, json};

use super::answers::{completion, flown, registration, result, study};
use super::bench::Bench;
use crate::{Access, Secret};

/// A coordinator which holds workers as short as it does by default.
async fn strict() -> Bench {
    Bench::open_with(|config| (config.leases_per_slot, config.probation) = (2, 8)).await
}

async fn seen(bench: &Bench, worker: &str) -> Value {
    let workers = bench.get("/v1/workers").await.json();
    let id = worker.rsplit('/').next();
    workers.as_array().and_then(|all| all.iter().find(|w| w["id"].as_str() == id).cloned()).expect("is listed")
}

async fn blame(bench: &Bench, worker: &str, lease: &Lease, fault: &str) {
    let failure =
        json!({ "job": lease.job, "attempt": lease.attempt, "reason": format!("it is {fault}"), "fault": fault });
    let told = bench.exchange(worker, json!({ "fail": [failure] })).await;
    assert_eq!(told.accepted, [lease.job]);
}

async fn state(bench: &Bench, lease: &Lease) -> (String, u64) {
    let view = bench.get(&format!("/v1/jobs/{}", lease.job)).await.json();
    (view["state"].as_str().unwrap_or_default().to_owned(), view["attempt"].as_u64().unwrap_or_default())
}

async fn big_worker(bench: &Bench, name: &str) -> String {
    let mut asked = registration(name);
    asked["slots"] = json!(64);
    let answer = bench.post("/v1/workers", asked.to_string()).await;
    format!("/v1/workers/{}", answer.json()["worker"].as_str().expect("an id"))
}

/// Twelve studies whose training fails on every machine, and one which is fine.
#[tokio::test]
async fn studies_whose_training_fails_set_nobody_aside_and_an_innocent_one_goes_on() {
    let bench = strict().await;
    let spec = |name: String, seed: u32| {
        let mut spec = study(20, &[]);
        (spec["name"], spec["seed"]) = (json!(name), json!(seed));
        spec
    };
    let mut bad = vec![bench.submit(&spec("bad 0".into(), 5)).await];
    let mut workers = Vec::new();
    for i in 0..3 {
        workers.push(bench.worker(&format!("honest {i}")).await);
    }
    let mut innocent = None;
    let mut trainings: BTreeMap<String, u64> = BTreeMap::new();
    for turn in 0..200 {
        if turn == 30 {
            for i in 1..12 {
                bad.push(bench.submit(&spec(format!("bad {i}"), 5)).await);
            }
            innocent = Some(bench.submit(&spec("innocent".into(), 6)).await);
        }
        let worker = &workers[turn % 3];
        for lease in bench.claim(worker, 2).await {
            let study = format!("/v1/studies/{}", lease.study);
            if lease.kind == JobKind::Train && bad.contains(&study) {
                *trainings.entry(study).or_default() += 1;
                blame(&bench, worker, &lease, "failed").await;
            } else {
                bench.complete(worker, &lease, result(&lease)).await;
            }
        }
        bench.pass(0.5).await;
    }
    for study in &bad {
        let view = bench.view(study).await;
        assert_eq!(
            (&view["state"], trainings.get(study)),
            (&json!("failed"), Some(&2)),
            "two attempts are enough: {view}"
        );
    }
    assert_eq!(bench.view(&innocent.expect("was submitted")).await["state"], "succeeded");
    for worker in &workers {
        let seen = seen(&bench, worker).await;
        assert_eq!((&seen["strikes"], &seen["quarantined"]), (&json!(0), &json!(false)), "{seen}");
    }
    bench.check_counts().await;
}

#[tokio::test]
async fn a_worker_which_refuses_everything_kills_no_job_and_is_set_aside_once_others_succeed() {
    let bench = strict().await;
    let path = bench.submit(&study(60, &[])).await;
    let (liar, honest) = (bench.worker("liar").await, bench.worker("honest").await);
    // Both have done something right before.
    for worker in [&liar, &honest] {
        let lease = bench.claim(worker, 1).await.remove(0);
        bench.complete(worker, &lease, result(&lease)).await;
    }
    let mut refused = Vec::new();
    for _ in 0..3 {
        for lease in bench.claim(&liar, 4).await {
            blame(&bench, &liar, &lease, "refused").await;
            assert_eq!(state(&bench, &lease).await.0, "delayed");
            refused.push(lease);
        }
        bench.pass(1.0).await;
    }
    assert_eq!((refused.len(), seen(&bench, &liar).await["strikes"].as_u64()), (12, Some(0)), "no strike at once");
    bench.work_off(&honest).await;
    assert_eq!(bench.view(&path).await["state"], "succeeded");
    let seen = seen(&bench, &liar).await;
    assert_eq!(seen["quarantined"], true, "{seen}");
    assert_eq!(bench.view(&path).await["samples"]["dead"], 0);
    bench.check_counts().await;
}

#[tokio::test]
async fn one_machine_which_registers_anew_gives_no_job_up() {
    let bench = strict().await;
    let path = bench.submit(&study(200, &[])).await;
    let honest = bench.worker("honest").await;
    let lease = bench.claim(&honest, 1).await.remove(0);
    bench.complete(&honest, &lease, result(&lease)).await;
    for i in 0..40 {
        let liar = big_worker(&bench, &format!("liar {i}")).await;
        let mut failed = 0;
        for fault in ["refused", "failed", "machine"] {
            let leases = bench.claim(&liar, 100).await;
            failed += leases.len();
            for lease in leases {
                blame(&bench, &liar, &lease, fault).await;
            }
        }
        assert!(failed <= 8, "{failed} jobs on probation");
        bench.pass(1.0).await;
        bench.exchange(&honest, json!({})).await;
    }
    assert_eq!(bench.view(&path).await["samples"]["dead"], 0);
    bench.pass(16.0).await;
    bench.work_off(&honest).await;
    assert_eq!(bench.view(&path).await["state"], "succeeded");
    bench.check_counts().await;
}

/// Before anybody has succeeded, nobody is more credible than another; what one may do is bounded all the same.
#[tokio::test]
async fn workers_without_a_success_give_few_jobs_up() {
    let bench = strict().await;
    let path = bench.submit(&study(200, &[])).await;
    bench.worker("honest").await;
    let mut failed = BTreeMap::new();
    let mut liars = Vec::new();
    for i in 0..4 {
        liars.push(big_worker(&bench, &format!("liar {i}")).await);
    }
    for _ in 0..5 {
        for liar in &liars {
            for lease in bench.claim(liar, 100).await {
                blame(&bench, liar, &lease, "refused").await;
                *failed.entry(liar).or_insert(0) += 1;
            }
        }
        bench.pass(1.0).await;
    }
    assert!(failed.values().all(|n| *n <= 8), "{failed:?}");
    assert!(bench.view(&path).await["samples"]["dead"].as_u64().is_some_and(|dead| dead <= 16));
}

#[tokio::test]
async fn a_machine_is_struck_at_once_and_cleared_when_another_fails_the_job_too() {
    let bench = strict().await;
    bench.submit(&study(20, &[])).await;
    let (first, second) = (bench.worker("first").await, bench.worker("second").await);
    let lease = bench.claim(&first, 1).await.remove(0);
    blame(&bench, &first, &lease, "machine").await;
    assert_eq!(seen(&bench, &first).await["strikes"], 1);
    bench.pass(1.0).await;
    let others = bench.claim(&first, 1).await;
    assert_ne!(others[0].job, lease.job, "another worker is to try it");
    let again = bench.claim(&second, 1).await.remove(0);
    assert_eq!((again.job, again.attempt), (lease.job, 2));
    blame(&bench, &second, &again, "machine").await;
    for worker in [&first, &second] {
        assert_eq!(seen(&bench, worker).await["strikes"], 0);
    }
    assert_eq!(state(&bench, &lease).await, ("delayed".into(), 2), "a third attempt is due");
}

#[tokio::test]
async fn a_lone_worker_which_refuses_a_task_is_believed_at_once() {
    let bench = strict().await;
    bench.submit(&study(20, &[])).await;
    let worker = bench.worker("alone").await;
    let leases = bench.claim(&worker, 2).await;
    blame(&bench, &worker, &leases[0], "refused").await;
    assert_eq!(state(&bench, &leases[0]).await, ("dead".into(), 1));
    blame(&bench, &worker, &leases[1], "failed").await;
    assert_eq!(state(&bench, &leases[1]).await, ("delayed".into(), 1));
    assert_eq!(seen(&bench, &worker).await["strikes"], 0);
    let told = bench.get(&format!("/v1/jobs/{}/explain", leases[1].job)).await.json();
    let attempt = &told["failed_attempts"][0];
    assert_eq!((&attempt["worker_name"], &attempt["fault"]), (&json!("alone"), &json!("failed")), "{told}");
}

#[tokio::test]
async fn leases_are_bounded_by_slots_and_before_the_first_success_by_probation() {
    let bench = strict().await;
    bench.submit(&study(200, &[])).await;
    let small = bench.worker("two slots").await;
    assert_eq!(bench.claim(&small, 1000).await.len(), 4);
    assert!(bench.claim(&small, 1000).await.is_empty());
    let big = big_worker(&bench, "64 slots").await;
    let first = bench.claim(&big, 1000).await;
    assert_eq!(first.len(), 8);
    assert!(bench.claim(&big, 1000).await.is_empty());
    let told = json!({ "complete": [completion(&first[0], result(&first[0]))], "want": 1000 });
    assert_eq!(bench.exchange(&big, told).await.jobs.len(), 128 - 7);
}

/// A poll held back is answered when the worker's own jobs end, which no other event tells.
#[tokio::test]
async fn a_worker_held_back_is_given_jobs_once_it_has_delivered() {
    let bench = strict().await;
    bench.submit(&study(40, &[])).await;
    let worker = bench.worker("w").await;
    let held = bench.claim(&worker, 4).await;
    let poll = bench.exchange(&worker, json!({ "want": 2, "wait_s": 20.0 }));
    let deliver = async {
        tokio::time::sleep(std::time::Duration::from_millis(50)).await;
        let done: Vec<_> = held.iter().map(|lease| completion(lease, result(lease))).collect();
        bench.exchange(&worker, json!({ "complete": done })).await
    };
    let (polled, delivered) = tokio::join!(poll, deliver);
    assert_eq!((polled.jobs.len(), delivered.accepted.len()), (2, 4));
}

#[tokio::test]
async fn a_token_registers_so_many_workers_and_then_a_few() {
    let secret = Secret::random().expect("random");
    let hash = secret.hash();
    let bench = Bench::open_with(|config| {
        config.access = Access::Tokens(vec![hash]);
        config.registrations = 3;
    })
    .await;
    let register = || {
        let request = Request::post("/v1/workers").header("content-type", "application/json");
        let request = request.header("authorization", format!("Bearer {}", secret.reveal()));
        bench.send(request.body(Body::from(registration("w").to_string())).expect("a request"))
    };
    for _ in 0..3 {
        assert_eq!(register().await.status, 201);
    }
    let refused = register().await;
    refused.problem(429, "too-many-registrations");
    assert_eq!(refused.header("retry-after"), "1");
    bench.pass(1.0).await;
    assert_eq!(register().await.status, 201);
    register().await.problem(429, "too-many-registrations");
}

#[tokio::test]
async fn thousands_of_refused_results_leave_a_few_rows_and_wash_nothing_away() {
    let bench = Bench::open_with(|config| (config.evidence, config.evidence_per_worker) = (20, 6)).await;
    bench.submit(&study(20, &[])).await;
    let (honest, liar) = (bench.worker("honest").await, bench.worker("liar").await);
    let lease = bench.claim(&honest, 1).await.remove(0);
    bench.complete(&honest, &lease, result(&lease)).await;
    bench.complete(&honest, &lease, flown(-1.0)).await;
    let stale = completion(&bench.claim(&honest, 1).await[0], flown(1.0));
    bench.exchange(&liar, json!({ "complete": [stale.clone()] })).await;
    for _ in 0..4 {
        let flood: Vec<_> = (0..1000).map(|_| stale.clone()).collect();
        let told = bench.exchange(&liar, json!({ "complete": flood })).await;
        assert_eq!((told.accepted.len(), told.rejected.len()), (0, 1000));
    }
    for i in 0..15 {
        let other = bench.worker(&format!("liar {i}")).await;
        bench.exchange(&other, json!({ "complete": vec![stale.clone(); 3] })).await;
    }
    assert_eq!(bench.evidence("nondeterminism").await, 1, "still there");
    assert_eq!(bench.evidence("refused").await, 20);
    let of_liar: i64 = sqlx::query_scalar(
        "select count(*) from refused_results as r join workers as w on w.id = r.worker where w.name = 'liar'",
    )
    .fetch_one(bench.state.store().readers())
    .await
    .expect("counts");
    assert!(of_liar >= 1, "the first one's evidence is not washed away by others");
    let metrics = String::from_utf8(bench.get("/metrics").await.body.to_vec()).expect("text");
    assert!(metrics.contains("manduca_decisions_total{decision=\"refused\"} 4046"), "{metrics}");
}
