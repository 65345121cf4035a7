//! Users pause, resume and cancel.

use serde_json::json;

use super::answers::{completion, result, study};
use super::bench::Bench;

#[tokio::test]
async fn a_paused_study_gives_no_jobs_but_takes_results() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let study = bench.submit(&study(20, &[])).await;
    let leases = bench.claim(&worker, 20).await;
    for _ in 0..2 {
        let view = bench.post(&format!("{study}/pause"), "").await.json();
        assert_eq!((view["state"].as_str(), view["paused_from"].as_str()), (Some("paused"), Some("sampling")));
    }
    let results: Vec<_> = leases.iter().map(|l| completion(l, result(l))).collect();
    let told = bench.exchange(&worker, json!({ "complete": results, "want": 9 })).await;
    assert_eq!((told.accepted.len(), told.jobs.len()), (20, 0));
    for _ in 0..2 {
        let view = bench.post(&format!("{study}/resume"), "").await.json();
        assert_eq!(view["state"], "training", "what ran on had finished the sampling");
    }
    assert_eq!(bench.claim(&worker, 9).await.len(), 1);
    bench.check_counts().await;
}

#[tokio::test]
async fn a_cancelled_study_stops_its_workers_and_takes_nothing_more() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let study = bench.submit(&study(20, &[])).await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    for _ in 0..2 {
        assert_eq!(bench.post(&format!("{study}/cancel"), "").await.json()["state"], "cancelled");
    }
    let renewal = json!({ "renew": [{ "job": lease.job, "attempt": 1 }], "want": 5 });
    let told = bench.exchange(&worker, renewal).await;
    assert_eq!((told.cancel, told.jobs.len()), (vec![lease.job], 0));
    let told = bench.complete(&worker, &lease, result(&lease)).await;
    assert!(told.rejected[0].reason.contains("cancelled"));
    assert_eq!(bench.view(&study).await["samples"]["cancelled"], 20);
    for action in ["pause", "resume", "retry-failed"] {
        bench.post(&format!("{study}/{action}"), "").await.problem(409, "wrong-state");
    }
    bench.check_counts().await;
}

#[tokio::test]
async fn what_is_finished_comes_before_what_begins() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let mut other = study(20, &[]);
    other["seed"] = json!(6);
    let first = bench.submit(&study(60, &[])).await;
    let leases = bench.claim(&worker, 30).await;
    assert!(leases.iter().all(|l| first.ends_with(&l.study.to_string())));
    let second = bench.submit(&other).await;
    let rest = bench.claim(&worker, 20).await;
    assert!(rest.len() == 20 && rest.iter().all(|l| second.ends_with(&l.study.to_string())));
    for lease in &rest {
        bench.complete(&worker, lease, result(lease)).await;
    }
    let next = bench.claim(&worker, 1).await;
    assert_eq!(next[0].kind, manduca_protocol::task::JobKind::Train);
}
