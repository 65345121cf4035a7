//! A study from submission to its answer.

use manduca_protocol::task::Task;
use serde_json::json;

use super::answers::{completion, infeasible, result, study};
use super::bench::Bench;

#[tokio::test]
async fn a_study_runs_through_its_stages() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let study = bench.submit(&study(20, &["one", "two"])).await;
    assert_eq!(bench.view(&study).await["state"], "sampling");
    bench.get(&format!("{study}/surrogate")).await.problem(404, "not-yet");
    let samples = bench.claim(&worker, 100).await;
    assert_eq!(samples.len(), 20);
    // Two of them cannot be flown: two further ones are drawn.
    let results: Vec<_> = samples
        .iter()
        .enumerate()
        .map(|(i, l)| completion(l, if i < 2 { infeasible("the wings cross") } else { result(l) }))
        .collect();
    bench.exchange(&worker, json!({ "complete": results })).await;
    let further = bench.claim(&worker, 100).await;
    assert_eq!(further.len(), 2);
    bench.pass(2.0).await;
    let results: Vec<_> = further.iter().map(|l| completion(l, result(l))).collect();
    let told = bench.exchange(&worker, json!({ "complete": results, "want": 5 })).await;
    assert_eq!(told.jobs.len(), 1, "the training follows in the same round trip");
    let task: Task =
        serde_json::from_value(bench.get(&format!("/v1/jobs/{}/task", told.jobs[0].job)).await.json()).expect("a task");
    let Task::Train(task) = task else { panic!("not a training") };
    assert_eq!((task.dataset.len(), task.seed), (20, 5));
    assert_eq!(task.bounds.lower[0], 15.0);
    bench.complete(&worker, &told.jobs[0], result(&told.jobs[0])).await;
    optimise_and_verify(&bench, &worker, &study).await;
    bench.check_counts().await;
}

async fn optimise_and_verify(bench: &Bench, worker: &str, study: &str) {
    let predictions = json!({ "points": [result_parameters()] });
    let answer = bench.post(&format!("{study}/surrogate/predictions"), predictions.to_string()).await.json();
    assert!(answer["predictions"][0]["lift"].is_number(), "{answer}");
    assert_eq!(bench.get(&format!("{study}/surrogate")).await.json()["neurons"], 2);
    let leases = bench.claim(worker, 5).await;
    assert_eq!(leases.len(), 2);
    let task = bench.get(&format!("/v1/jobs/{}/task", leases[1].job)).await.json();
    assert_eq!((task["kind"].as_str(), task["optimisation"]["name"].as_str()), (Some("optimise"), Some("two")));
    for lease in &leases {
        bench.complete(worker, lease, result(lease)).await;
    }
    let view = bench.view(study).await;
    assert_eq!((view["state"].as_str(), &view["optimisations"][0]["status"]), (Some("verifying"), &json!("optimised")));
    let leases = bench.claim(worker, 5).await;
    let Some(Task::Simulate(task)) = &leases[0].task else { panic!("not a simulation") };
    assert_eq!(task.model.solver.get("strokes"), Some(&18.0));
    // Both optimisations found the same stroke, but each was leased before the other was flown.
    for lease in &leases {
        bench.complete(worker, lease, result(lease)).await;
    }
    let view = bench.view(study).await;
    assert_eq!(view["state"], "succeeded");
    assert_eq!(view["stages_s"]["sampling"], 2.0);
    let answer = bench.get(&format!("{study}/optimum")).await.json();
    assert_eq!(answer["samples"], json!({ "succeeded": 20, "infeasible": 2, "dead": 0 }));
    assert_eq!(answer["optimisations"][1]["status"], "verified");
    assert_eq!(answer["optimisations"][1]["simulated"]["lift"]["mean"], 25.5 / 25.0);
    assert_eq!(answer["surrogate"]["rmse"]["power"], 0.01);
}

fn result_parameters() -> serde_json::Value {
    super::answers::optimised()["parameters"].clone()
}

#[tokio::test]
async fn without_optimisations_a_study_ends_with_its_network() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let study = bench.submit(&study(20, &[])).await;
    bench.work_off(&worker).await;
    assert_eq!(bench.view(&study).await["state"], "succeeded");
}

#[tokio::test]
async fn a_training_given_up_fails_the_study_until_it_is_tried_again() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let study = bench.submit(&study(20, &["one"])).await;
    let samples = bench.claim(&worker, 20).await;
    let results: Vec<_> = samples.iter().map(|l| completion(l, result(l))).collect();
    bench.exchange(&worker, json!({ "complete": results })).await;
    for _ in 0..3 {
        let lease = bench.claim(&worker, 1).await.remove(0);
        bench.fail(&worker, &lease, "the loss is NaN").await;
        bench.pass(10.0).await;
    }
    let view = bench.view(&study).await;
    assert_eq!(view["state"], "failed");
    assert!(view["failure"].as_str().is_some_and(|why| why.contains("the loss is NaN")), "{view}");
    assert_eq!(bench.post(&format!("{study}/retry-failed"), "").await.json()["state"], "training");
    bench.work_off(&worker).await;
    assert_eq!(bench.view(&study).await["state"], "succeeded");
    bench.check_counts().await;
}

#[tokio::test]
async fn a_study_nothing_of_which_can_be_flown_fails_with_a_sentence() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let study = bench.submit(&study(20, &[])).await;
    loop {
        let leases = bench.claim(&worker, 100).await;
        if leases.is_empty() {
            break;
        }
        let results: Vec<_> = leases.iter().map(|l| completion(l, infeasible("the wings cross"))).collect();
        bench.exchange(&worker, json!({ "complete": results })).await;
    }
    let view = bench.view(&study).await;
    assert_eq!((view["state"].as_str(), view["samples"]["infeasible"].as_u64()), (Some("failed"), Some(40)));
    assert!(view["failure"].as_str().is_some_and(|why| why.contains("too few")), "{view}");
    bench.post(&format!("{study}/retry-failed"), "").await.problem(409, "wrong-state");
}
