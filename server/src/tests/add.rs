//! Further optima of a study which has its network.

use manduca_protocol::task::Task;
use serde_json::{Value, json};
use std::time::Duration;

use super::answers::{optimised, result, study};
use super::bench::Bench;

/// A finished study with these optimisations.
async fn finished(bench: &Bench, worker: &str, names: &[&str]) -> String {
    let study = bench.submit(&study(20, names)).await;
    bench.work_off(worker).await;
    assert_eq!(bench.view(&study).await["state"], "succeeded");
    study
}

fn case() -> Value {
    json!({ "name": "case II", "method": "sqp", "parameters": { "stroke_plane_deg": 15.0 }, "starts": 9,
            "verify_strokes": 30, "refine_simulations": 0 })
}

#[tokio::test]
async fn an_optimisation_added_runs_on_the_network_there_is() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let study = finished(&bench, &worker, &["one"]).await;
    let before = bench.view(&study).await;
    bench.pass(1000.0).await;
    let added = bench.post(&format!("{study}/optimisations"), case().to_string()).await;
    assert_eq!((added.status.as_u16(), &added.json()["status"]), (201, &json!("pending")));
    let place = format!("{study}/optimisations/case%20II");
    assert_eq!(added.header("location"), place);
    assert_eq!(bench.view(&study).await["state"], "optimising");
    // Not lost with the process.
    let bench = bench.restart(Duration::from_secs(5)).await;
    let worker = bench.worker("w").await;
    let leases = bench.claim(&worker, 9).await;
    assert_eq!(leases.len(), 1, "what there was is not done again");
    let task = bench.get(&format!("/v1/jobs/{}/task", leases[0].job)).await.json();
    assert_eq!((&task["optimisation"]["name"], &task["bounds"]["lower"][1]), (&json!("case II"), &json!(15.0)));
    bench.complete(&worker, &leases[0], with_prices()).await;
    let leases = bench.claim(&worker, 9).await;
    let Some(Task::Simulate(task)) = &leases[0].task else { panic!("not a simulation") };
    assert_eq!((leases.len(), task.model.solver.get("strokes")), (1, Some(&30.0)));
    bench.complete(&worker, &leases[0], result(&leases[0])).await;
    let after = bench.view(&study).await;
    assert_eq!((&after["state"], &after["samples"]), (&json!("succeeded"), &before["samples"]));
    let waited = after["stages_s"]["optimising"].as_f64().expect("seconds");
    assert!(waited < 10.0, "the time between is no part of the stage: {waited}");
    let all = bench.get(&format!("{study}/optimisations")).await.json();
    assert_eq!((&all[0], all.as_array().map(Vec::len)), (&before["optimisations"][0], Some(2)));
    let one = bench.get(&place).await.json();
    assert_eq!((&one, one["status"].as_str()), (&all[1], Some("verified")));
    let optimum = bench.get(&format!("{study}/optimum")).await.json();
    let optimality = &optimum["optimisations"][1]["optimality"];
    assert_eq!((&optimality["multipliers"]["lift"], &optimality["kkt_residual"]), (&json!(0.6), &json!(1e-11)));
    assert!(optimum["optimisations"][0].get("optimality").is_none());
    bench.check_counts().await;
}

/// An optimum as sequential quadratic programming gives it.
fn with_prices() -> Value {
    let mut result = optimised();
    let point = result["parameters"].clone();
    let local = json!({ "parameters": point, "predicted": result["predicted"], "clearance_mm": result["clearance_mm"], "hits": 8 });
    result["history"] = json!([]);
    result["optimality"] = json!({
        "multipliers": { "lift": 0.6, "drag": 0.1, "pitch_moment": 0.0, "clearance_per_mm": 0.0, "bounds": point },
        "kkt_residual": 1e-11, "violation": 0.0, "starts": 9, "converged": 8, "optima": [local]
    });
    result
}

#[tokio::test]
async fn an_optimisation_is_added_once_and_to_studies_which_have_ended() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let running = bench.submit(&study(20, &["one"])).await;
    bench.post(&format!("{running}/optimisations"), case().to_string()).await.problem(409, "wrong-state");
    bench.post(&format!("{running}/cancel"), "").await;
    bench.post(&format!("{running}/optimisations"), case().to_string()).await.problem(409, "wrong-state");
    // A study without any ended with its network.
    let study = finished(&bench, &worker, &[]).await;
    let path = format!("{study}/optimisations");
    assert_eq!(bench.get(&path).await.json(), json!([]));
    for (status, state) in [(201, "optimising"), (200, "optimising")] {
        assert_eq!(bench.post(&path, case().to_string()).await.status, status);
        assert_eq!(bench.view(&study).await["state"], state);
    }
    bench.work_off(&worker).await;
    assert_eq!(bench.post(&path, case().to_string()).await.json()["status"], "verified");
    assert_eq!(bench.view(&study).await["spec"]["optimisations"].as_array().map(Vec::len), Some(1));
    bench.get(&format!("{path}/two")).await.problem(404, "unknown-optimisation");
    bench.get("/v1/studies/x/optimisations/two").await.problem(404, "unknown-study");
    bench.get(&format!("{path}/%ff")).await.problem(404, "no-route");
}

#[tokio::test]
async fn what_is_wrong_with_an_optimisation_is_named() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let study = finished(&bench, &worker, &["one"]).await;
    let path = format!("{study}/optimisations");
    let with = |field: &str, value: Value| {
        let mut spec = case();
        spec[field] = value;
        spec.to_string()
    };
    let cases = [
        (with("name", json!("one")), "/name"),
        (with("starts", json!(0)), "/starts"),
        (with("method", json!("guess")), "/method"),
        (with("parameters", json!({ "frequency_hz": [1.0, 20.0] })), "/parameters/frequency_hz"),
        (with("colour", json!("red")), "/colour"),
    ];
    for (body, pointer) in cases {
        assert_eq!(bench.post(&path, body).await.problem(422, "invalid-request"), [pointer]);
    }
    bench.post(&path, "{").await.problem(400, "malformed-json");
    assert_eq!(bench.view(&study).await["state"], "succeeded");
}
