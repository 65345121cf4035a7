//! Workers that return wrong results, and what is left of them.

use std::time::Duration;

use manduca_numerics::simulation;
use manduca_numerics::surrogate::Split;
use manduca_protocol::resolve;
use manduca_protocol::task::{JobKind, SimulateOutcome, SimulateResult, Task};
use manduca_protocol::worker::Lease;
use serde_json::{Value, json};

use super::answers::{self, completion, study};
use super::bench::Bench;

/// A study of blade elements, so that workers and the coordinator really fly it.
fn blades(samples: u32, audit: f64) -> Value {
    let mut study = study(samples, &[]);
    study["model"] = json!({ "kind": "quasi-steady" });
    study["audit"] = json!(audit);
    // Flown strokes are not as simple as made-up ones.
    study["surrogate"] = json!({ "neurons": 2, "features": "paper", "train_share": 0.8, "validation_share": 0.1 });
    study
}

/// The true result of a lease.
fn honest(lease: &Lease) -> Value {
    let Some(Task::Simulate(task)) = &lease.task else { panic!("a simulation comes with its task") };
    let model = resolve::model(&task.model, "/model").expect("a model");
    let flown = simulation::simulate(&model.simulation(&task.parameters));
    let outcome = SimulateOutcome::of(flown).expect("finite means");
    let result = SimulateResult { outcome, solver_version: simulation::SOLVER_VERSION.into() };
    let mut result = serde_json::to_value(result).expect("JSON");
    result["kind"] = json!("simulate");
    result
}

/// The same with more lift: as valid as the true one.
fn forged(lease: &Lease) -> Value {
    let mut result = honest(lease);
    if result["outcome"] == "ok" {
        for (of, what) in [("means", "lift_n"), ("scaled", "lift")] {
            for part in ["mean", "se"] {
                result[of][what][part] = json!(1.01 * result[of][what][part].as_f64().expect("a number"));
            }
        }
        let [power, lift] = ["power_w", "lift_n"].map(|what| result["means"][what]["mean"].as_f64().expect("a number"));
        result["power_per_lift_w_per_n"] = json!((lift > 0.0).then(|| power / lift));
    }
    result
}

type Lie = dyn Fn(&Lease) -> bool;

/// Three workers, the first of which lies where `lies` says so, work until nothing is left of the sampling.
async fn sample(bench: &Bench, study: &str, lies: &Lie) -> [String; 3] {
    let mut workers = Vec::new();
    for name in ["liar", "second", "third"] {
        workers.push(bench.worker(name).await);
    }
    while bench.view(study).await["state"] == "sampling" {
        let mut idle = true;
        for (i, worker) in workers.iter().enumerate() {
            let leases = bench.claim(worker, 40).await;
            let result = |lease: &Lease| if i == 0 && lies(lease) { forged(lease) } else { honest(lease) };
            let results: Vec<_> = leases
                .iter()
                .filter(|lease| lease.kind == JobKind::Simulate)
                .map(|lease| completion(lease, result(lease)))
                .collect();
            idle &= results.is_empty();
            bench.exchange(worker, json!({ "complete": results })).await;
        }
        if idle {
            // The coordinator flies what they differ about.
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    }
    workers.try_into().expect("three workers")
}

async fn dataset(bench: &Bench, study: &str) -> Vec<u8> {
    bench.get(&format!("{study}/dataset?format=csv")).await.body.to_vec()
}

async fn seen(bench: &Bench, name: &str) -> Value {
    let workers = bench.get("/v1/workers").await.json();
    workers.as_array().and_then(|all| all.iter().find(|w| w["name"] == name).cloned()).expect("is listed")
}

/// What an undisturbed run of the study finds.
async fn undisturbed(spec: &Value) -> Vec<u8> {
    let bench = Bench::open().await;
    let study = bench.submit(spec).await;
    sample(&bench, &study, &|_| false).await;
    dataset(&bench, &study).await
}

#[tokio::test(flavor = "multi_thread")]
async fn who_forges_simulations_is_named_and_set_aside_and_its_results_are_replaced() {
    let calm = undisturbed(&blades(500, 0.2)).await;
    // Of a tenth of some 170 results, so many audits miss none in ten million runs.
    let tenth = |lease: &Lease| lease.job.0 % 10 == 0;
    for (lies, audit, name) in [(&(|_: &Lease| true) as &Lie, 0.2, "all"), (&tenth, 0.6, "a tenth")] {
        let bench = Bench::open().await;
        let study = bench.submit(&blades(500, audit)).await;
        let [liar, ..] = sample(&bench, &study, lies).await;
        assert_eq!(dataset(&bench, &study).await, calm, "{name} forged");
        let told = seen(&bench, "liar").await;
        assert!(told["set_aside"].as_str().is_some_and(|why| why.contains("coordinator's own flight")), "{told}");
        for honest in ["second", "third"] {
            assert_eq!(seen(&bench, honest).await.get("set_aside"), None);
        }
        let view = bench.view(&study).await;
        assert_eq!(view["distrusted"][0]["name"], "liar");
        assert!(view["distrusted"][0]["replaced"].as_u64() > Some(0), "{}", view["distrusted"]);
        assert_eq!(view.get("disowned_results"), None);
        assert!(view["audit_verdicts"]["not_independent"].as_u64() > Some(50), "{}", view["audit_verdicts"]);
        let evidence = bench.get("/v1/evidence?class=nondeterminism").await.json();
        let accused: Vec<_> = evidence.as_array().expect("a list").iter().map(|e| e["worker"].clone()).collect();
        assert!(!accused.is_empty() && accused.iter().all(|id| liar.ends_with(id.as_str().expect("an id"))));
        assert!(bench.claim(&liar, 5).await.is_empty());
        bench.check_counts().await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn who_forges_a_training_is_named_and_set_aside_and_another_one_trains() {
    let bench = Bench::open().await;
    let study = bench.submit(&study(20, &[])).await;
    let (liar, honest) = (bench.worker("liar").await, bench.worker("honest").await);
    let samples = bench.claim(&honest, 20).await;
    let results: Vec<_> = samples.iter().map(|lease| completion(lease, answers::result(lease))).collect();
    bench.exchange(&honest, json!({ "complete": results })).await;
    let training = bench.claim(&liar, 1).await.remove(0);
    let mut flattering = answers::trained();
    flattering["surrogate"]["networks"][0]["output_biases"][0] = json!(0.5);
    let told = bench.complete(&liar, &training, flattering).await;
    assert!(told.rejected[0].reason.contains("not 0 as claimed"), "{:?}", told.rejected);
    assert!(seen(&bench, "liar").await["set_aside"].is_string());
    bench.pass(5.0).await;
    assert!(bench.claim(&liar, 1).await.is_empty());
    assert_eq!(bench.work_off(&honest).await, 1);
    assert_eq!(bench.view(&study).await["state"], "succeeded");
    bench.check_counts().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_surrogate_of_no_use_is_refused_without_accusing_anybody() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    let worker = bench.worker("w").await;
    let samples = bench.claim(&worker, 20).await;
    let results: Vec<_> = samples.iter().map(|lease| completion(lease, answers::result(lease))).collect();
    bench.exchange(&worker, json!({ "complete": results })).await;
    let training = bench.claim(&worker, 1).await.remove(0);
    let mut large = answers::trained();
    let network = large["surrogate"]["networks"][0].clone();
    large["surrogate"]["networks"].as_array_mut().expect("networks").push(network);
    let told = bench.complete(&worker, &training, large).await;
    assert!(told.rejected[0].reason.contains("not of 1 networks with 2 neurons"), "{:?}", told.rejected);
    // Sent again because the answer was lost, it is no second failure.
    assert_eq!(bench.get(&format!("/v1/jobs/{}/explain", training.job)).await.json()["failures"], 1);
    let told = bench.complete(&worker, &training, answers::trained()).await;
    assert!(told.rejected[0].reason.contains("no longer"), "{:?}", told.rejected);
    assert_eq!(seen(&bench, "w").await.get("set_aside"), None);
    bench.check_counts().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_study_from_which_nothing_can_be_learnt_strikes_nobody() {
    let bench = Bench::open().await;
    let worker = bench.worker("lone").await;
    for seed in 1..8 {
        let mut hopeless = study(20, &[]);
        hopeless["seed"] = json!(seed);
        let path = bench.submit(&hopeless).await;
        let samples = bench.claim(&worker, 20).await;
        let results: Vec<_> = samples.iter().map(|lease| completion(lease, answers::result(lease))).collect();
        bench.exchange(&worker, json!({ "complete": results })).await;
        let training = bench.claim(&worker, 1).await.remove(0);
        let told = bench.complete(&worker, &training, constant(&bench, &training, seed).await).await;
        assert!(told.rejected[0].reason.contains("no better than the mean"), "{:?}", told.rejected);
        let view = bench.view(&path).await;
        assert!(view["state"] == "failed" && view["failure"].to_string().contains("needs more of them"), "{view}");
    }
    let seen = seen(&bench, "lone").await;
    assert_eq!((seen.get("set_aside"), &seen["strikes"]), (None, &json!(0)), "{seen}");
    let mut other = study(20, &[]);
    other["seed"] = json!(99);
    bench.submit(&other).await;
    assert_eq!(bench.claim(&worker, 20).await.len(), 20, "it still has jobs");
}

/// A training that predicts one number, and says truly how it errs.
async fn constant(bench: &Bench, lease: &Lease, seed: u64) -> Value {
    let task = bench.get(&format!("/v1/jobs/{}/task", lease.job)).await.json();
    let lift: Vec<f64> =
        task["dataset"].as_array().expect("samples").iter().map(|s| s["y"][0].as_f64().unwrap()).collect();
    let mut training = answers::trained();
    let network = &mut training["surrogate"]["networks"][0];
    network["output_weights"] = json!(vec![0.0; 8]);
    let told = network["output_biases"][0].as_f64().unwrap() + 1.0;
    network["output_biases"][0] = json!(told);
    let split = Split::new(lift.len(), 0.8, 0.1, seed);
    for (name, share) in [("train", &split.train), ("validation", &split.validation), ("test", &split.test)] {
        let squares: f64 = share.iter().map(|&i| (lift[i] - told).powi(2)).sum();
        training[name]["rmse"]["lift"] = json!((squares / share.len() as f64).sqrt());
    }
    training
}

#[tokio::test(flavor = "multi_thread")]
async fn an_optimum_must_be_what_it_claims() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &["one"])).await;
    let worker = bench.worker("w").await;
    for _ in 0..2 {
        let mut results = Vec::new();
        for lease in bench.claim(&worker, 20).await {
            results.push(completion(&lease, bench.result(&lease).await));
        }
        bench.exchange(&worker, json!({ "complete": results })).await;
    }
    let cases: [(&str, &[&str], Value); 3] = [
        ("is outside the bounds", &["parameters", "frequency_hz"], json!(1e9)),
        ("not 2 as claimed", &["predicted", "lift"], json!(2.0)),
        ("mm as claimed", &["clearance_mm"], json!(99.0)),
    ];
    for (told, path, value) in cases {
        // Each by another worker: whoever claims too much is set aside.
        let worker = bench.worker(told).await;
        let lease = bench.claim(&worker, 1).await.remove(0);
        assert_eq!(lease.kind, JobKind::Optimise);
        let mut wrong = answers::optimised();
        let place = path.iter().fold(&mut wrong, |at, name| &mut at[*name]);
        *place = value;
        let answer = bench.complete(&worker, &lease, wrong).await;
        assert!(answer.rejected[0].reason.contains(told), "{told}: {:?}", answer.rejected);
        assert_eq!(seen(&bench, told).await.get("set_aside").is_some(), told != "is outside the bounds");
        bench.pass(61.0).await;
    }
    bench.check_counts().await;
}

#[tokio::test]
async fn a_forged_simulation_is_refused_where_it_contradicts_itself() {
    let bench = Bench::open().await;
    bench.submit(&study(40, &[])).await;
    let long = "x".repeat(3000);
    let forge = |path: &[&str], value: Value| {
        let mut result = answers::flown(20.0);
        let place = path.iter().fold(&mut result, |at, name| &mut at[*name]);
        *place = value;
        result
    };
    let cases = [
        (forge(&["means", "power_w", "mean"], json!(-5.0)), "is not the sum of its joints'"),
        (forge(&["scaled", "lift", "se"], json!(-1.0)), "standard error is negative"),
        (forge(&["strokes_averaged"], json!(0)), "no stroke is in the means"),
        (forge(&["strokes_averaged"], json!(7000)), "7000 strokes are in the means; 6 to 16"),
        (forge(&["scaled", "drag", "mean"], json!(0.5)), "over the scale"),
        (forge(&["power_per_lift_w_per_n"], json!(0.1)), "does not follow from the means"),
        (answers::infeasible(&long), "more than 2000 characters"),
        (answers::infeasible("\u{1b}]0;title"), "control characters"),
    ];
    for (i, (wrong, told)) in cases.into_iter().enumerate() {
        let worker = bench.worker(&format!("w{i}")).await;
        let lease = bench.claim(&worker, 1).await.remove(0);
        let answer = bench.complete(&worker, &lease, wrong).await;
        assert!(answer.rejected[0].reason.contains(told), "{told}: {:?}", answer.rejected);
        assert_eq!(seen(&bench, &format!("w{i}")).await["failed"], 1);
    }
    let worker = bench.worker("slow").await;
    for (wall_s, level) in [(1e308, "test"), (-1.0, "test"), (1.0, long.as_str())] {
        let lease = bench.claim(&worker, 1).await.remove(0);
        let mut wrong = completion(&lease, answers::result(&lease));
        wrong["provenance"] = json!({ "wall_s": wall_s, "level": level });
        let told = bench.exchange(&worker, json!({ "complete": [wrong] })).await;
        assert_eq!(told.rejected.len(), 1, "{wall_s} {level}");
    }
    let told = String::from_utf8(bench.get("/metrics").await.body.to_vec()).expect("text");
    assert!(!told.contains("inf\n"), "{told}");
    let evidence = bench.get("/v1/evidence").await.json();
    assert!(evidence.to_string().len() < 20_000, "nothing long is kept");
    bench.check_counts().await;
}

#[tokio::test]
async fn unknown_fields_of_a_result_are_refused() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    let worker = bench.worker("w").await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    let mut result = answers::result(&lease);
    result["garbage"] = json!(vec![json!({ "": 0 }); 100]);
    let body = json!({ "complete": [completion(&lease, result)] }).to_string();
    bench.post(&format!("{worker}/exchange"), body).await.problem(422, "invalid-request");
}
