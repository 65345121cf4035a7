//! Crashes cost time, never results.

use std::collections::BTreeSet;

use manduca_tests::coordinator::{Coordinator, text};
use manduca_tests::studies::{blades, lattice};
use manduca_tests::wait_for;
#[cfg(target_os = "linux")]
use manduca_tests::{
    process::{kill, runs},
    studies::endless,
};
use serde_json::{Value, json};

const SAMPLES: u32 = 60;

/// What a study leaves behind, without ids and times.
#[derive(Debug, PartialEq)]
struct Legacy {
    csv: String,
    json: String,
    optimisations: Value,
    rmse: Value,
    curve: Value,
}

fn legacy(coordinator: &Coordinator, study: &str) -> Legacy {
    let result = coordinator.get(&format!("/v1/studies/{study}/optimum"));
    Legacy {
        csv: coordinator.dataset(study, "text/csv"),
        json: coordinator.dataset(study, "application/json"),
        optimisations: result["optimisations"].clone(),
        rmse: result["surrogate"]["rmse"].clone(),
        curve: coordinator.get(&format!("/v1/studies/{study}/surrogate"))["curve"].clone(),
    }
}

/// The study done by one worker which nobody disturbs.
fn undisturbed(study: &Value) -> Legacy {
    let coordinator = Coordinator::start();
    let _worker = coordinator.worker("calm");
    let id = coordinator.submit(study);
    coordinator.wait_until_succeeded(&id);
    legacy(&coordinator, &id)
}

/// Every sample has one result, and every job has one end.
fn assert_complete(coordinator: &Coordinator, id: &str) {
    let rows = coordinator.get(&format!("/v1/studies/{id}/dataset"));
    let rows = rows.as_array().unwrap();
    let distinct: BTreeSet<_> = rows.iter().map(|row| row["sample"].as_u64().unwrap()).collect();
    assert_eq!(distinct.len(), rows.len(), "a sample has two results");
    let flown = rows.iter().filter(|row| row["outcome"] == "ok").count() as u64;
    let infeasible = rows.len() as u64 - flown;
    assert_eq!(flown, u64::from(SAMPLES));

    let view = coordinator.study(id);
    let none_open = json!({ "ready": 0, "delayed": 0, "leased": 0, "succeeded": flown, "infeasible": infeasible,
        "dead": 0, "cancelled": 0 });
    assert_eq!(view["samples"], none_open);

    let jobs = coordinator.jobs(id);
    let of = |role: &str| jobs.iter().filter(|job| job["role"] == role).count();
    assert_eq!((of("sample"), of("train"), of("optimise"), of("verify")), (rows.len(), 1, 1, 1));
    let places: BTreeSet<_> = jobs.iter().map(|job| (text(&job["role"]), job["ordinal"].as_u64())).collect();
    assert_eq!(places.len(), jobs.len(), "a job is listed twice");
    for job in &jobs {
        assert!(job["state"] == "succeeded" || job["state"] == "infeasible", "{job}");
        assert!(job["attempt"].as_u64().unwrap() >= 1 && job["provenance"]["wall_s"].is_number(), "{job}");
    }
}

/// Jobs which were computed more than once, because whoever had them first died.
fn repeated(coordinator: &Coordinator, id: &str) -> usize {
    coordinator.jobs(id).iter().filter(|job| job["attempt"].as_u64().unwrap() > 1).count()
}

#[test]
fn a_study_outlives_two_workers_and_its_coordinator_to_the_same_bytes() {
    let study = lattice("crashes", 11, SAMPLES);
    let mut coordinator = Coordinator::start();
    let mut doomed = [coordinator.worker("doomed-1"), coordinator.worker("doomed-2")];
    let survivor = coordinator.worker("survivor");
    let id = coordinator.submit(&study);

    coordinator.wait_for_samples(&id, 5);
    // A worker with work to get always holds a lease: the kill takes a job with it.
    coordinator.wait_for_lease("doomed-1");
    doomed[0].kill();
    coordinator.wait_for_samples(&id, 10);
    coordinator.wait_for_lease("doomed-2");
    doomed[1].kill();
    coordinator.wait_for_samples(&id, 15);
    coordinator.kill();
    coordinator.restart();

    let view = coordinator.study(&id);
    assert_eq!(view["state"], "sampling", "the jobs of the dead cannot be back already: {view}");
    assert!(view["samples"]["succeeded"].as_u64().unwrap() >= 15, "results were lost: {view}");
    coordinator.wait_until_succeeded(&id);
    assert_complete(&coordinator, &id);
    // One job was lost with each dead worker. A third may have been leased in the very answer
    // which the coordinator was killed before sending.
    let again = repeated(&coordinator, &id);
    assert!((2..=3).contains(&again), "{again} jobs were flown again");
    let disturbed = legacy(&coordinator, &id);
    drop((doomed, survivor, coordinator));

    let calm = undisturbed(&study);
    assert_eq!(disturbed.csv, calm.csv);
    assert_eq!(disturbed, calm);
}

#[test]
fn what_was_answered_is_kept_by_a_coordinator_killed_again_and_again() {
    let mut coordinator = Coordinator::start();
    let study = lattice("kept", 12, 40);
    let id = coordinator.submit(&study);
    let _worker = coordinator.worker("steady");
    for round in 1..=3 {
        // Whoever has seen a result must see it for ever.
        coordinator.wait_for_samples(&id, 8 * round);
        let seen = coordinator.dataset(&id, "application/x-ndjson");
        coordinator.kill();
        coordinator.restart();
        let kept = coordinator.dataset(&id, "application/x-ndjson");
        for row in seen.lines() {
            assert!(kept.lines().any(|line| line == row), "round {round} lost {row}");
        }
    }
    // Its leases went on in spite of the restarts: at most the one job of an answer never sent
    // was given out twice.
    coordinator.wait_until_succeeded(&id);
    let again = repeated(&coordinator, &id);
    assert!(again <= 3, "{again} jobs were flown again");
}

/// A training whose worker dies is taken up where it stood, and ends in the same bits.
#[test]
fn a_training_outlives_its_worker() {
    let mut study = blades("training", 13, 800);
    study["optimisations"] = json!([]);
    study["surrogate"] = json!({ "neurons": 60, "max_iterations": 1500, "patience": 1000, "ensemble": 4 });
    let coordinator = Coordinator::start();
    let id = coordinator.submit(&study);
    let mut doomed = coordinator.worker("doomed");
    let path = format!("/v1/studies/{id}/surrogate");
    // The curve so far is shown while it trains: it is of the checkpoint.
    let seen = wait_for("a checkpoint", || {
        let answer = coordinator.send(coordinator.request("GET", &path));
        (answer.status == 200).then(|| answer.json())
    });
    assert!(seen["test"].is_null(), "it was done too soon to be killed: {}", seen["stops"]);
    doomed.kill();

    let job = coordinator.jobs(&id).into_iter().find(|job| job["role"] == "train").unwrap();
    let task = coordinator.get(&format!("/v1/jobs/{}/task", job["id"]));
    let at = &task["checkpoint"];
    let done = at["members"].as_array().unwrap().iter().map(|member| &member["curve"]);
    let kept: Vec<_> = done.chain([&at["curve"]]).flat_map(|curve| curve.as_array().unwrap()).collect();
    let told = seen["curve"].as_array().unwrap();
    assert!(told.len() > 1 && kept.len() >= told.len() && told.iter().zip(kept).all(|(told, kept)| told == kept));

    let _survivor = coordinator.worker("survivor");
    coordinator.wait_until_succeeded(&id);
    assert_eq!(repeated(&coordinator, &id), 1);
    // Its samples are shared, its training is its own.
    let calm = coordinator.submit(&study);
    coordinator.wait_until_succeeded(&calm);
    assert_eq!(repeated(&coordinator, &calm), 0);
    let trained = |id: &str| coordinator.get(&format!("/v1/studies/{id}/surrogate"));
    assert_eq!(trained(&id), trained(&calm));
    let task = coordinator.get(&format!("/v1/jobs/{}/task", job["id"]));
    assert!(task["checkpoint"].is_null(), "nobody goes on from a training which has ended");
}

#[cfg(target_os = "linux")]
#[test]
fn a_killed_slot_costs_one_attempt_and_none_outlives_its_worker() {
    let coordinator = Coordinator::start();
    let mut worker = coordinator.worker("host");
    let id = coordinator.submit(&endless("slots"));
    let slot = wait_for("a compute slot", || worker.children().first().copied());
    coordinator.wait_for_lease("host");
    kill(slot);

    let failed =
        wait_for("the failed attempt", || coordinator.jobs(&id).into_iter().find(|job| !job["reason"].is_null()));
    assert!(failed["reason"].as_str().unwrap().contains("signal 9"), "{failed}");
    assert_eq!(failed["attempt"], 1, "{failed}");
    assert_eq!(worker.ended(), None, "the worker went down with its slot");
    let next = wait_for("the next slot", || worker.children().first().copied().filter(|&next| next != slot));
    coordinator.wait_for_lease("host");

    // What it computes would take minutes, and nobody is left to be told.
    worker.kill();
    wait_for("the orphan to end", || (!runs(next)).then_some(()));
}
