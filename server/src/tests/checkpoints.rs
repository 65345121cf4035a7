//! Where a training stands, told and taken up.

use manduca_protocol::worker::Lease;
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

/// A renewal with a checkpoint.
fn at(lease: &Lease, checkpoint: Value) -> Value {
    json!({ "renew": [{ "job": lease.job, "attempt": lease.attempt, "checkpoint": checkpoint }] })
}

/// A study whose samples are flown, with its training leased.
async fn training(bench: &Bench, worker: &str, spec: &Value) -> (String, Lease) {
    let study = bench.submit(spec).await;
    let samples = bench.claim(worker, 20).await;
    let results: Vec<_> = samples.iter().map(|l| completion(l, result(l))).collect();
    bench.exchange(worker, json!({ "complete": results })).await;
    (study, bench.claim(worker, 1).await.remove(0))
}

#[tokio::test]
async fn the_fit_of_a_process_is_taken_up_where_it_was_lost() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let mut spec = study(20, &[]);
    spec["surrogate"] = json!({ "kind": "gaussian-process" });
    let (study, first) = training(&bench, &worker, &spec).await;
    let ascent = json!({ "ascent": 0, "at": [0.5, -1.0], "iterations": 9, "stopped": "no step" });
    let told = json!({ "kind": "fit", "ascents": [ascent] });
    bench.exchange(&worker, at(&first, told)).await;
    assert_eq!(bench.get(&format!("{study}/surrogate")).await.status.as_u16(), 404, "a fit has no curve to show");
    bench.fail(&worker, &first, "the machine went down").await;
    bench.pass(10.0).await;
    let second = bench.claim(&worker, 1).await.remove(0);
    let task = bench.get(&format!("/v1/jobs/{}/task", second.job)).await.json();
    assert_eq!((&task["fit"]["ascents"], &task["checkpoint"]), (&json!([ascent]), &Value::Null));
}

#[tokio::test]
async fn a_checkpoint_is_kept_until_its_job_ends() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let (study, first) = training(&bench, &worker, &study(20, &[])).await;
    let renewal = |lease: &Lease, iterations| at(lease, checkpoint(iterations));
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

#[tokio::test]
async fn what_is_told_of_a_job_under_way_is_bounded() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let (study, lease) = training(&bench, &worker, &study(20, &[])).await;
    let note = format!("\u{1b}]0;title\u{7}{}", "x".repeat(100_000));
    let renewal = json!({ "renew": [{ "job": lease.job, "attempt": lease.attempt,
                                      "progress": { "done": 1, "total": 2, "note": note } }] });
    assert_eq!(bench.exchange(&worker, renewal).await.cancel, []);
    let view = bench.view(&study).await;
    let told = view["progress"]["note"].as_str().unwrap_or_else(|| panic!("{view}"));
    assert!(told.starts_with(" ]0;title x") && told.len() == 2000, "{}", told.len());
    assert!(!told.chars().any(char::is_control), "{}", &told[..20]);

    // A checkpoint which no training has is left out, and its lease lives on.
    bench.exchange(&worker, at(&lease, checkpoint(3))).await;
    let mut large = checkpoint(1);
    large["members"] = json!(vec![json!({ "network": checkpoint(0)["network"], "curve": [], "best_iteration": 0,
                                          "stopped": "x".repeat(3000) })]);
    let mut wide = checkpoint(1);
    wide["network"]["hidden_biases"] = json!(vec![0.0; 5000]);
    for wrong in [checkpoint(10_001), large, wide] {
        assert_eq!(bench.exchange(&worker, at(&lease, wrong)).await.cancel, []);
        let curve = bench.get(&format!("{study}/surrogate")).await.json()["curve"].as_array().map(Vec::len);
        assert_eq!(curve, Some(4));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_training_which_fails_from_anothers_checkpoint_begins_anew() {
    let bench = Bench::open().await;
    let (liar, honest) = (bench.worker("liar").await, bench.worker("honest").await);
    let (_, first) = training(&bench, &liar, &study(20, &[])).await;
    bench.exchange(&liar, at(&first, checkpoint(3))).await;
    assert_eq!(bench.delete(&liar).await.status.as_u16(), 204);
    let second = bench.claim(&honest, 1).await.remove(0);
    let path = format!("/v1/jobs/{}/task", second.job);
    assert!(bench.get(&path).await.json()["checkpoint"].is_object(), "it goes on from there");
    // Its own checkpoints are made of it.
    bench.exchange(&honest, at(&second, checkpoint(4))).await;
    bench.fail(&honest, &second, "non-finite result").await;
    let explained = bench.get(&format!("/v1/jobs/{}/explain", second.job)).await.json();
    assert_eq!(explained["failed_attempts"][0]["fault"], "failed", "its machine is not to blame: {explained}");
    bench.pass(10.0).await;
    let third = bench.claim(&honest, 1).await.remove(0);
    assert_eq!(bench.get(&path).await.json()["checkpoint"], Value::Null);
    bench.complete(&honest, &third, trained()).await;
    bench.check_counts().await;
}
