//! The coordinator stops and starts.

use std::time::Duration;

use serde_json::json;

use super::answers::{result, study};
use super::bench::Bench;

#[tokio::test]
async fn leases_have_a_full_new_term_after_a_restart() {
    let bench = Bench::open().await;
    let study = bench.submit(&study(20, &[])).await;
    let worker = bench.worker("w").await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    let bench = bench.restart(Duration::from_secs(3600)).await;
    bench.pass(14.0).await;
    let renewal = json!({ "renew": [{ "job": lease.job, "attempt": 1 }] });
    assert!(bench.exchange(&worker, renewal).await.cancel.is_empty());
    bench.pass(14.0).await;
    assert_eq!(bench.complete(&worker, &lease, result(&lease)).await.accepted, [lease.job]);
    assert_eq!(bench.view(&study).await["samples"]["succeeded"], 1);
    bench.check_counts().await;
}

#[tokio::test]
async fn a_closed_store_answers_with_a_problem() {
    let bench = Bench::open().await;
    bench.state.close().await;
    let answer = bench.post("/v1/studies", study(20, &[]).to_string()).await;
    answer.problem(503, "unavailable");
    assert_eq!(answer.header("retry-after"), "1");
    bench.get("/readyz").await.problem(503, "unavailable");
    assert_eq!(bench.get("/healthz").await.status, 200);
}
