//! The coordinator is stopped for a while, or its disk is busy: nobody can renew.

use std::time::Duration;

use serde_json::json;

use super::answers::{result, study};
use super::bench::Bench;

/// A coordinator which is away when 3.75 s pass between two sweeps, as by default.
async fn bench() -> Bench {
    Bench::open_with(|config| config.away = Duration::from_millis(3750)).await
}

/// Lets time pass as it does while the coordinator runs.
async fn run(bench: &Bench, seconds: u32) {
    for _ in 0..seconds {
        bench.pass(1.0).await;
    }
}

#[tokio::test]
async fn an_absence_of_the_coordinator_ends_no_lease() {
    let bench = bench().await;
    bench.submit(&study(40, &[])).await;
    let worker = bench.worker("w").await;
    let leases = bench.claim(&worker, 20).await;
    let renewal = json!({ "renew": leases.iter().map(|l| json!({ "job": l.job, "attempt": 1 })).collect::<Vec<_>>() });
    for away in [20.0, 60.0, 3600.0] {
        for _ in 0..8 {
            run(&bench, 5).await;
            assert!(bench.exchange(&worker, renewal.clone()).await.cancel.is_empty());
        }
        // Ten seconds are left of the leases, and then nobody can renew.
        run(&bench, 5).await;
        bench.pass(away).await;
        run(&bench, 12).await;
        assert!(bench.exchange(&worker, renewal.clone()).await.cancel.is_empty(), "after {away} s");
    }
    assert_eq!(bench.complete(&worker, &leases[0], result(&leases[0])).await.accepted, [leases[0].job]);
    bench.check_counts().await;
}

#[tokio::test]
async fn absences_one_after_the_other_end_no_lease() {
    let bench = bench().await;
    bench.submit(&study(20, &[])).await;
    let worker = bench.worker("w").await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    let renewal = json!({ "renew": [{ "job": lease.job, "attempt": 1 }] });
    for _ in 0..20 {
        bench.pass(20.0).await;
        run(&bench, 1).await;
        assert!(bench.exchange(&worker, renewal.clone()).await.cancel.is_empty());
    }
}

#[tokio::test]
async fn jobs_of_a_worker_which_is_gone_are_given_to_others_a_term_after_an_absence() {
    let bench = bench().await;
    bench.submit(&study(20, &[])).await;
    let gone = bench.worker("gone").await;
    let lease = bench.claim(&gone, 1).await.remove(0);
    run(&bench, 5).await;
    bench.pass(20.0).await;
    run(&bench, 16).await;
    let view = bench.get(&format!("/v1/jobs/{}", lease.job)).await.json();
    assert_eq!(view["state"], "ready", "{view}");
    let again = bench.claim(&bench.worker("other").await, 1).await.remove(0);
    assert_eq!((again.job, again.attempt), (lease.job, 2));
}

#[tokio::test]
async fn a_coordinator_which_is_always_late_still_ends_leases() {
    let bench = bench().await;
    bench.submit(&study(20, &[])).await;
    let gone = bench.worker("gone").await;
    let lease = bench.claim(&gone, 1).await.remove(0);
    for _ in 0..10 {
        bench.pass(20.0).await;
    }
    assert_eq!(bench.get(&format!("/v1/jobs/{}", lease.job)).await.json()["state"], "ready");
}

#[tokio::test]
async fn an_absence_longer_than_a_run_limit_is_no_run_of_the_job() {
    let bench = bench().await;
    bench.submit(&study(20, &[])).await;
    let worker = bench.worker("w").await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    bench.pass(1000.0).await;
    let told = bench.get(&format!("/v1/jobs/{}/explain", lease.job)).await.json();
    assert!(told["lease"]["running_s"].as_f64().is_some_and(|s| s < 10.0), "{told}");
    assert_eq!(bench.complete(&worker, &lease, result(&lease)).await.accepted, [lease.job]);
}
