//! Where a training stands, told and taken up.

use serde_json::{Value, json};

use super::answers::{completion, result, study, trained};
use super::bench::Bench;

/// A checkpoint after so many iterations.
fn checkpoint(iterations: usize) -> Value {
    let network = trained()["surrogate"]["networks"][0].clone();
    let epoch =
        |i| json!({ "iteration": i, "train_mse": 1.0, "validation_mse": 1.0, "test_mse": 1.0, "damping": 0.001 });
    let curve: Vec<_> = (0..=iterations).map(epoch).collect();
    json!({ "kind": "train", "members": [], "network": network, "objective": 1.0, "damping": 0.001, "growth": 2.0,
            "curve": curve, "best": network })
}

#[tokio::test]
async fn a_checkpoint_is_kept_until_its_job_ends() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let study = bench.submit(&study(20, &[])).await;
    let samples = bench.claim(&worker, 20).await;
    let results: Vec<_> = samples.iter().map(|l| completion(l, result(l))).collect();
    bench.exchange(&worker, json!({ "complete": results })).await;
    let first = bench.claim(&worker, 1).await.remove(0);
    let renewal = |lease: &manduca_protocol::worker::Lease, iterations| json!({ "renew": [{ "job": lease.job, "attempt": lease.attempt, "checkpoint": checkpoint(iterations) }] });
    bench.exchange(&worker, renewal(&first, 1)).await;
    bench.exchange(&worker, renewal(&first, 3)).await;
    // A renewal without one keeps the last.
    bench.exchange(&worker, json!({ "renew": [{ "job": first.job, "attempt": first.attempt }] })).await;
    let view = bench.get(&format!("{study}/surrogate")).await.json();
    assert_eq!(
        (view["curve"].as_array().map(Vec::len), &view["test"], &view["neurons"]),
        (Some(4), &Value::Null, &json!(2))
    );
    assert_eq!(bench.view(&study).await["surrogate"], Value::Null);

    bench.fail(&worker, &first, "the machine went down").await;
    bench.pass(10.0).await;
    let second = bench.claim(&worker, 1).await.remove(0);
    let path = format!("/v1/jobs/{}/task", second.job);
    let task = bench.get(&path).await.json();
    assert_eq!(task["checkpoint"]["curve"].as_array().map(Vec::len), Some(4));
    // An attempt which is no longer the present one changes nothing.
    let told = bench.exchange(&worker, renewal(&first, 9)).await;
    assert_eq!(told.cancel, [first.job]);
    assert_eq!(bench.get(&path).await.json()["checkpoint"], task["checkpoint"]);

    bench.complete(&worker, &second, trained()).await;
    assert_eq!(bench.get(&path).await.json()["checkpoint"], Value::Null);
    assert!(bench.get(&format!("{study}/surrogate")).await.json()["test"].is_object());
}
