//! A study from submission to its answer.

use manduca_protocol::task::{JobKind, Task};
use serde_json::json;

use super::answers::{completion, infeasible, result, search_asks, search_ended, study};
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
    let mut far = result_parameters();
    (far["frequency_hz"], far["sweep_shape"]) = (json!(41.0), json!(0.5));
    let predictions = json!({ "points": [result_parameters(), far] });
    let answer = bench.post(&format!("{study}/surrogate/predictions"), predictions.to_string()).await.json();
    assert!(answer["predictions"][0]["lift"].is_number(), "{answer}");
    assert_eq!(answer["outside"], json!([{ "point": 1, "parameters": ["frequency_hz"] }]));
    assert_eq!(answer["test_rmse"]["lift"], 0.0);
    assert!(answer["by"].as_str().is_some_and(|by| by.contains("surrogate as it was trained")), "{answer}");
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
    assert_eq!(answer["surrogate"]["rmse"]["power"], 0.0);
    let optimum = &answer["optimisations"][0];
    assert_eq!((&optimum["clearance_margin_mm"], optimum["stopped"].is_string()), (&json!(0.0), true), "{optimum}");
    assert_eq!(optimum["paper"], "optimum-1", "the paper's box, insect and lattice");
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

#[tokio::test]
async fn rounds_of_a_search_and_their_strokes_take_turns() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let mut asked = study(20, &["one"]);
    asked["optimisations"][0]["refine_simulations"] = json!(50);
    let study = bench.submit(&asked).await;
    // Samples, training, optimisation and its verification.
    for expected in [20, 1, 1, 1] {
        let leases = bench.claim(&worker, 100).await;
        assert_eq!(leases.len(), expected);
        let results: Vec<_> = leases.iter().map(|l| completion(l, result(l))).collect();
        bench.exchange(&worker, json!({ "complete": results })).await;
    }
    assert_eq!(bench.view(&study).await["state"], "refining");
    let first = bench.claim(&worker, 100).await;
    assert_eq!((first.len(), first[0].kind), (1, JobKind::Search));
    let task = bench.get(&format!("/v1/jobs/{}/task", first[0].job)).await.json();
    assert!(task["state"]["search"] == "refine" && task["state"]["round"] == 0, "{task}");
    assert!(task["surrogate"].is_object(), "{task}");
    assert_eq!(task["flown"][0]["parameters"]["frequency_hz"], 25.5);
    bench.complete(&worker, &first[0], search_asks(1, &task["flown"], &[26.0, 27.0, 28.0])).await;

    let strokes = bench.claim(&worker, 100).await;
    assert_eq!(strokes.len(), 3);
    let Some(Task::Simulate(task)) = &strokes[0].task else { panic!("not a simulation") };
    assert_eq!(task.model.solver.get("strokes"), Some(&18.0), "as exact as the verification");
    assert!(bench.claim(&worker, 100).await.is_empty(), "the next round waits for every stroke");
    // One of them cannot be flown.
    bench.complete(&worker, &strokes[0], result(&strokes[0])).await;
    bench.complete(&worker, &strokes[1], infeasible("the wings cross")).await;
    bench.complete(&worker, &strokes[2], result(&strokes[2])).await;

    let second = bench.claim(&worker, 100).await;
    let task = bench.get(&format!("/v1/jobs/{}/task", second[0].job)).await.json();
    assert_eq!((&task["state"]["round"], task["flown"].as_array().map(Vec::len)), (&json!(1), Some(3)));
    assert!(task["flown"][1]["scaled"].is_null() && task["flown"][2]["scaled"].is_object(), "{task}");
    bench.complete(&worker, &second[0], search_ended()).await;
    let view = bench.view(&study).await;
    assert_eq!((&view["state"], &view["optimisations"][0]["status"]), (&json!("succeeded"), &json!("refined")));
    let optimum = bench.get(&format!("{study}/optimum")).await.json();
    assert_eq!(optimum["optimisations"][0]["refined"]["ended"], "they agree");
    bench.check_counts().await;
}

#[tokio::test]
async fn a_round_which_asks_for_nothing_is_no_result() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let mut asked = study(20, &["one"]);
    asked["optimisations"][0]["refine_simulations"] = json!(50);
    let study = bench.submit(&asked).await;
    for _ in 0..4 {
        let results: Vec<_> = bench.claim(&worker, 100).await.iter().map(|l| completion(l, result(l))).collect();
        bench.exchange(&worker, json!({ "complete": results })).await;
    }
    let round = bench.claim(&worker, 100).await;
    let told =
        bench.exchange(&worker, json!({ "complete": [completion(&round[0], search_asks(1, &json!([]), &[]))] })).await;
    assert!(told.rejected[0].reason.contains("asks for 0 strokes"), "{:?}", told.rejected);
    assert_eq!(bench.view(&study).await["state"], "refining");
}
