//! Optimisations whose fitness is flown.

use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::{Clearance, ElevationPhase};
use manduca_numerics::optimise::Fitness;
use manduca_numerics::parameters::Bounds;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::task::{JobKind, Task};
use manduca_protocol::view::JobRole;
use manduca_protocol::worker::Lease;
use serde_json::{Value, json};
use std::time::Duration;

use super::answers::{generation_asks, generations_found, infeasible, result, search_ended, study};
use super::bench::Bench;

/// A study without samples, of one direct optimisation.
fn direct(refine_simulations: u32) -> Value {
    let mut asked = study(0, &["five"]);
    asked["optimisations"] = json!([{
        "name": "five", "method": "direct", "population": 8, "generations": 3,
        "refine_simulations": refine_simulations, "verify_strokes": 30
    }]);
    asked
}

async fn task(bench: &Bench, lease: &Lease) -> Value {
    bench.get(&format!("/v1/jobs/{}/task", lease.job)).await.json()
}

/// Leases one round, which must be the only job.
async fn round(bench: &Bench, worker: &str) -> (Lease, Value) {
    let leases = bench.claim(worker, 9).await;
    assert_eq!((leases.len(), leases[0].kind), (1, JobKind::Search));
    let task = task(bench, &leases[0]).await;
    (leases[0].clone(), task)
}

/// Two generations, of one stroke in all, which is the optimum.
async fn evolve(bench: &Bench, worker: &str, first: &Lease) {
    bench.complete(worker, first, generation_asks(0, &[20.0])).await;
    let mut leases = bench.claim(worker, 9).await;
    // Another study may have flown it.
    if leases[0].kind == JobKind::Simulate {
        bench.complete(worker, &leases[0], result(&leases[0])).await;
        leases = bench.claim(worker, 9).await;
    }
    bench.complete(worker, &leases[0], generations_found(20.0)).await;
}

#[tokio::test]
async fn generations_are_flown_verified_and_refined_without_a_network() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let study = bench.submit(&direct(40)).await;
    let view = bench.view(&study).await;
    assert_eq!((&view["state"], &view["stages_s"]["sampling"]), (&json!("optimising"), &Value::Null));
    let (first, asked) = round(&bench, &worker).await;
    assert_eq!((&asked["state"]["search"], &asked["state"]["genes"]), (&json!("breed"), &json!([])));
    assert!(asked["surrogate"].is_null() && asked["flown"] == json!([]), "{asked}");
    bench.complete(&worker, &first, generation_asks(0, &[20.0, 21.0, 22.0])).await;

    let strokes = bench.claim(&worker, 9).await;
    assert_eq!(strokes.len(), 3);
    let Some(Task::Simulate(flown)) = &strokes[0].task else { panic!("not a simulation") };
    assert_eq!(flown.model.solver.get("strokes"), None, "as a sample is flown");
    let job = bench.get(&format!("/v1/jobs/{}", strokes[0].job)).await.json();
    assert_eq!(job["role"], json!(JobRole::Individual));
    bench.complete(&worker, &strokes[0], result(&strokes[0])).await;
    bench.complete(&worker, &strokes[1], infeasible("it blew up")).await;
    // Not lost with the process, and of what it holds nothing is flown again.
    let bench = bench.restart(Duration::from_secs(5)).await;
    bench.complete(&worker, &strokes[2], result(&strokes[2])).await;
    let (second, asked) = round(&bench, &worker).await;
    assert_eq!((&asked["state"]["genes"][7][0], asked["flown"].as_array().map(Vec::len)), (&json!(0.5), Some(3)));
    assert!(asked["flown"][1]["scaled"].is_null() && asked["flown"][2]["scaled"].is_object(), "{asked}");

    // A stroke flown in an earlier generation is not flown again.
    bench.complete(&worker, &second, generation_asks(1, &[20.0, 23.0])).await;
    let view = bench.view(&study).await;
    assert_eq!((&view["stage_jobs"]["succeeded"], &view["stage_jobs"]["ready"]), (&json!(3), &json!(1)));
    let progress = &view["progress"];
    assert_eq!((&progress["done"], &progress["total"]), (&json!(4), &json!(4 + 1 + 8)));
    assert_eq!(progress["note"], "five: generation 2 of 3, best fitness 1.25000");
    assert_eq!(view["optimisations"][0]["breeding"]["standing"]["rounds"], 1);
    let strokes = bench.claim(&worker, 9).await;
    assert_eq!(strokes.len(), 1);
    bench.complete(&worker, &strokes[0], result(&strokes[0])).await;
    let (last, _) = round(&bench, &worker).await;
    bench.complete(&worker, &last, generations_found(23.0)).await;
    refined(&bench, &worker, &study).await;
}

/// What follows the generations.
async fn refined(bench: &Bench, worker: &str, study: &str) {
    let view = bench.view(study).await;
    assert_eq!((&view["state"], &view["optimisations"][0]["status"]), (&json!("verifying"), &json!("optimised")));
    let verify = bench.claim(worker, 9).await;
    let Some(Task::Simulate(flown)) = &verify[0].task else { panic!("not a simulation") };
    assert_eq!((verify.len(), flown.model.solver.get("strokes")), (1, Some(&30.0)));
    bench.complete(worker, &verify[0], result(&verify[0])).await;
    let (last, asked) = round(bench, worker).await;
    assert_eq!((&asked["state"]["search"], &asked["surrogate"]), (&json!("refine"), &Value::Null));
    // All that was flown, the stroke shared with an earlier generation too, and the optimum again.
    let around = asked["state"]["around"].as_array().map(Vec::len);
    assert_eq!((around, asked["flown"].as_array().map(Vec::len)), (Some(5), Some(1)));
    bench.complete(worker, &last, search_ended()).await;
    let view = bench.view(study).await;
    assert_eq!((&view["state"], &view["optimisations"][0]["status"]), (&json!("succeeded"), &json!("refined")));
    let optimum = bench.get(&format!("{study}/optimum")).await.json();
    let optimum = &optimum["optimisations"][0];
    assert_eq!((&optimum["breeding"]["ended"], &optimum["refined"]["converged"]), (&json!("tolerance"), &json!(true)));
    bench.get(&format!("{study}/surrogate")).await.problem(404, "not-yet");
    let searches = bench.get(&format!("{study}/jobs?kind=search")).await.json();
    assert_eq!(searches["items"].as_array().map(Vec::len), Some(4));
    bench.check_counts().await;
}

#[tokio::test]
async fn a_generation_given_up_fails_the_study_until_it_is_tried_again() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let study = bench.submit(&direct(0)).await;
    for _ in 0..3 {
        let (lease, _) = round(&bench, &worker).await;
        bench.fail(&worker, &lease, "no point has a finite fitness").await;
        bench.pass(10.0).await;
    }
    let view = bench.view(&study).await;
    assert_eq!((&view["state"], &view["optimisations"][0]["status"]), (&json!("failed"), &json!("failed")));
    assert!(view["failure"].as_str().is_some_and(|why| why.contains("no point has a finite fitness")), "{view}");
    assert_eq!(bench.post(&format!("{study}/retry-failed"), "").await.json()["state"], "optimising");
    let (lease, _) = round(&bench, &worker).await;
    evolve(&bench, &worker, &lease).await;
    bench.work_off(&worker).await;
    assert_eq!(bench.view(&study).await["state"], "succeeded");
    bench.check_counts().await;
}

#[tokio::test]
async fn a_direct_optimisation_is_added_to_a_study_of_either_kind() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let mut added = direct(0)["optimisations"][0].clone();
    added["name"] = json!("more");
    let sampled = bench.submit(&study(20, &["one"])).await;
    bench.work_off(&worker).await;
    let flown = bench.submit(&direct(0)).await;
    let (lease, _) = round(&bench, &worker).await;
    evolve(&bench, &worker, &lease).await;
    bench.work_off(&worker).await;
    for study in [&sampled, &flown] {
        let path = format!("{study}/optimisations");
        assert_eq!(bench.post(&path, added.to_string()).await.status, 201);
        assert_eq!(bench.view(study).await["state"], "optimising");
        let (lease, asked) = round(&bench, &worker).await;
        assert_eq!(asked["optimisation"]["name"], "more");
        evolve(&bench, &worker, &lease).await;
        bench.work_off(&worker).await;
        assert_eq!(bench.post(&path, added.to_string()).await.json()["status"], "verified");
    }
    // Without samples there is no network to ask.
    let on_network = json!({ "name": "other" }).to_string();
    let refused = bench.post(&format!("{flown}/optimisations"), on_network).await.problem(422, "invalid-request");
    assert_eq!(refused, ["/method"]);
    bench.check_counts().await;
}

#[tokio::test]
async fn only_direct_optimisations_do_without_samples() {
    let bench = Bench::open().await;
    let dry = |study: &Value| bench.post("/v1/studies?dry_run=true", study.to_string());
    // 8 of the first generation, all but one survivor of two more, and the optimum once more.
    assert_eq!(dry(&direct(40)).await.json(), json!({ "simulations": 8 + 2 * 7 + 1, "errors": [] }));
    let mut mixed = direct(0);
    mixed["optimisations"].as_array_mut().expect("a list").push(json!({ "name": "on the network" }));
    for study in [study(0, &[]), mixed] {
        let refused = bench.post("/v1/studies", study.to_string()).await.problem(422, "invalid-study");
        assert_eq!(refused, ["/sampling/samples"]);
    }
    for (field, most) in [("population", 1000), ("generations", 900)] {
        let mut large = direct(0);
        large["optimisations"][0][field] = json!(most + 1);
        let refused = bench.post("/v1/studies", large.to_string()).await.problem(422, "invalid-study");
        assert_eq!(refused, [format!("/optimisations/0/{field}")]);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_round_asks_for_strokes_inside_the_bounds_alone() {
    let bench = Bench::open().await;
    let study = bench.submit(&direct(0)).await;
    for (i, strokes) in [&[20.0, 1e9][..], &[20.0; 9]].into_iter().enumerate() {
        let worker = bench.worker(&format!("w{i}")).await;
        let (round, _) = round(&bench, &worker).await;
        let told = bench.complete(&worker, &round, generation_asks(0, strokes)).await;
        let why = &told.rejected[0].reason;
        assert!(why.contains("outside the bounds") || why.contains("9 strokes are asked for"), "{why}");
        assert_eq!(bench.view(&study).await["stage_jobs"]["ready"].as_u64().unwrap_or_default(), 0, "none is flown");
        bench.pass(61.0).await;
    }
    // Whoever is at fault, an honest worker does it.
    let worker = bench.worker("honest").await;
    let (round, _) = round(&bench, &worker).await;
    assert_eq!(bench.complete(&worker, &round, generation_asks(0, &[20.0])).await.accepted.len(), 1);
    bench.check_counts().await;
}

/// Completes a round with a state changed in these fields.
async fn changed(bench: &Bench, worker: &str, lease: &Lease, asks: &Value, fields: Value) -> Option<String> {
    let mut asks = asks.clone();
    for (field, value) in fields.as_object().expect("fields") {
        asks["next"]["state"][field] = value.clone();
    }
    let told = bench.complete(worker, lease, asks).await;
    assert_eq!(told.accepted.len() + told.rejected.len(), 1);
    told.rejected.first().map(|refused| refused.reason.clone())
}

/// A round of a forger, who is refused.
async fn forge(bench: &Bench, asks: &Value, fields: Value, why: &str) {
    let forger = bench.worker("forger").await;
    let (lease, _) = round(bench, &forger).await;
    let told = changed(bench, &forger, &lease, asks, fields).await;
    assert!(told.as_ref().is_some_and(|told| told.contains(why)), "{why}: {told:?}");
    bench.pass(61.0).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_first_generation_has_no_fitness() {
    for (fields, why) in [
        (json!({ "elite": [0.9] }), "does not fit its search: its elite"),
        (json!({ "elite": [0.9], "history": [[0.9, 0.9]] }), "does not follow from the round before"),
    ] {
        let bench = Bench::open().await;
        bench.submit(&direct(0)).await;
        let asks = generation_asks(0, &[20.0]);
        forge(&bench, &asks, fields, why).await;
        let honest = bench.worker("honest").await;
        let (lease, _) = round(&bench, &honest).await;
        assert_eq!(changed(&bench, &honest, &lease, &asks, json!({})).await, None);
        bench.check_counts().await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_round_carries_on_what_was_flown_alone() {
    let middle = Bounds::default().from_unit(&[0.5; 10]);
    let unknown = "a fitness that no flown stroke has";
    for (fields, why) in [
        (json!({ "elite": [null, null] }), "does not fit its search: its elite"),
        (json!({ "elite": [-1e300] }), unknown),
        (json!({ "elite": [0.9] }), unknown),
        (json!({ "history": [[0.9, 0.9]] }), unknown),
        (json!({ "best": [middle, 0.9] }), unknown),
        (json!({ "simulations": 2 }), "2 strokes are claimed to be flown, not 0 to 1"),
    ] {
        let bench = Bench::open().await;
        bench.submit(&direct(0)).await;
        let honest = bench.worker("honest").await;
        let (lease, _) = round(&bench, &honest).await;
        let mut asks = generation_asks(0, &[20.0]);
        asks["next"]["strokes"] = json!([ParameterValues(middle)]);
        assert_eq!(changed(&bench, &honest, &lease, &asks, json!({})).await, None);
        let stroke = bench.claim(&honest, 9).await.remove(0);
        bench.complete(&honest, &stroke, result(&stroke)).await;

        let asks = generation_asks(1, &[23.0]);
        forge(&bench, &asks, fields, why).await;
        // The fitness which the stroke has is accepted.
        let (lease, asked) = round(&bench, &honest).await;
        let flown = &asked["flown"][0];
        let means =
            ["lift", "drag", "pitch_moment", "power"].map(|of| flown["scaled"][of]["mean"].as_f64().expect("a mean"));
        let clearance_m = Clearance::new(&Insect::default(), ElevationPhase::Plus).of(&middle);
        let fitness = Fitness { bounds: Bounds::default(), margin_m: 0.0, penalty_r: 2.0, penalty_s: 5.0 };
        let fitness = fitness.judge(&middle, means, clearance_m).fitness;
        let fields = json!({ "elite": [fitness], "history": [[fitness, fitness]],
            "best": [middle, fitness], "champion": flown });
        assert_eq!(changed(&bench, &honest, &lease, &asks, fields).await, None);
        assert_eq!(bench.claim(&honest, 9).await[0].kind, JobKind::Simulate);
        bench.check_counts().await;
    }
}
