//! The life of studies over HTTP, with real workers.

use manduca_tests::coordinator::{Coordinator, text};
use manduca_tests::studies::{blades, endless, lattice};
use manduca_tests::wait_for;
use serde_json::{Value, json};

/// Numbers of jobs of a study's samples by state.
fn counts(coordinator: &Coordinator, id: &str) -> Value {
    coordinator.study(id)["samples"].clone()
}

/// Submits with a key; the status and the study's id.
fn submit_with_key(coordinator: &Coordinator, study: &Value, key: &str) -> (u16, String) {
    let request = coordinator.request("POST", "/v1/studies").header("idempotency-key", key).json(study);
    let answer = coordinator.send(request);
    let id = text(&answer.json()["id"]);
    assert_eq!(answer.header("location"), format!("/v1/studies/{id}"));
    (answer.status, id)
}

/// The three forms of a dataset say the same, number by number.
fn assert_forms_agree(coordinator: &Coordinator, id: &str) {
    let json: Vec<Value> = serde_json::from_str(&coordinator.dataset(id, "application/json")).unwrap();
    let ndjson = coordinator.dataset(id, "application/x-ndjson");
    let lines: Vec<Value> = ndjson.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(json, lines);
    let csv = coordinator.dataset(id, "text/csv");
    let mut rows = csv.split_terminator("\r\n").map(|line| line.split(',').collect::<Vec<_>>());
    let header = rows.next().unwrap();
    let rows: Vec<_> = rows.collect();
    assert_eq!(rows.len(), json.len());
    for (row, object) in rows.iter().zip(&json) {
        assert_eq!(row.len(), header.len());
        for (column, cell) in header.iter().zip(row) {
            let (name, part) = column.strip_suffix("_se").map_or((*column, "mean"), |name| (name, "se"));
            let groups = [&object["parameters"][name], &object["means"][name][part], &object["scaled"][name][part]];
            match groups.into_iter().find(|value| value.is_number()) {
                Some(number) => assert_eq!(cell.parse::<f64>().unwrap(), number.as_f64().unwrap(), "{column}"),
                None => assert_eq!(*cell, object[name].to_string().trim_matches('"').replace("null", ""), "{column}"),
            }
        }
    }
}

/// The optimum is predicted and flown, and the network answers for it as it did then.
fn assert_answered(coordinator: &Coordinator, id: &str, samples: u64) {
    let result = coordinator.get(&format!("/v1/studies/{id}/optimum"));
    assert_eq!((&result["state"], &result["samples"]["succeeded"]), (&json!("succeeded"), &json!(samples)));
    let optimum = &result["optimisations"][0];
    assert_eq!((&optimum["name"], &optimum["status"]), (&json!("free"), &json!("refined")));
    for name in ["lift", "drag", "pitch_moment", "power"] {
        assert!(optimum["predicted"][name].is_number(), "{name} in {optimum}");
        assert!(optimum["simulated"][name]["mean"].is_number(), "{name} in {optimum}");
        assert!(optimum["simulated"][name]["se"].is_number(), "{name} in {optimum}");
        assert!(result["surrogate"]["rmse"][name].is_number(), "{name} in {result}");
    }
    for stage in ["sampling", "training", "optimising", "verifying"] {
        assert!(result["stages_s"][stage].is_number(), "{stage} in {result}");
    }
    let surrogate = coordinator.get(&format!("/v1/studies/{id}/surrogate"));
    assert_eq!(surrogate["neurons"], 6);
    assert!(!surrogate["curve"].as_array().unwrap().is_empty());
    let asked = json!({ "points": [optimum["parameters"], optimum["parameters"]] });
    let told = coordinator.post(&format!("/v1/studies/{id}/surrogate/predictions"), &asked).expect(200);
    assert_eq!(told["predictions"], json!([optimum["predicted"], optimum["predicted"]]));
}

/// A stroke of the dataset flown while one waits has the numbers it had in the study, to the last bit.
fn assert_flown_alike(coordinator: &Coordinator, id: &str) {
    let rows: Vec<Value> = serde_json::from_str(&coordinator.dataset(id, "application/json")).unwrap();
    for row in &rows[..5] {
        let asked = json!({ "study": id, "parameters": row["parameters"], "wake": "last" });
        let flown = coordinator.post("/v1/simulations", &asked).expect(200);
        for part in ["parameters", "means", "scaled", "joints", "strokes_averaged", "solver_version"] {
            assert_eq!(flown[part], row[part], "{part} of sample {}", row["sample"]);
        }
        assert!(flown["history"].as_array().is_some_and(|rows| rows.len() == 12), "{flown}");
    }
}

/// An ETag stays while nothing changes, and says so.
fn assert_unchanged_is_304(coordinator: &Coordinator, id: &str) -> String {
    let path = format!("/v1/studies/{id}");
    let tag = coordinator.ask(&path).header("etag").to_owned();
    let again = coordinator.send(coordinator.request("GET", &path).header("if-none-match", &tag));
    assert_eq!((again.status, again.body.as_str(), again.header("etag")), (304, "", tag.as_str()));
    tag
}

#[test]
fn a_study_is_submitted_once_paused_resumed_and_answered() {
    let mut coordinator = Coordinator::start();
    let mut worker = coordinator.worker("only");
    let study = lattice("life", 21, 40);
    let (first, id) = submit_with_key(&coordinator, &study, "key-1");
    let (second, same) = submit_with_key(&coordinator, &study, "key-1");
    assert_eq!((first, second, &id), (201, 200, &same));

    coordinator.wait_for_samples(&id, 3);
    assert_eq!(coordinator.steer(&id, "pause")["state"], "paused");
    // What runs may finish; then nothing moves, while the worker flies for another study.
    wait_for("the leased jobs to finish", || (counts(&coordinator, &id)["leased"] == 0).then_some(()));
    let paused = counts(&coordinator, &id);
    assert!(paused["ready"].as_u64().unwrap() > 0, "the study was over before it could be paused: {paused}");
    let tag = assert_unchanged_is_304(&coordinator, &id);
    let other = coordinator.submit(&lattice("other", 22, 200));
    coordinator.wait_for_samples(&other, 5);
    assert_eq!(counts(&coordinator, &id), paused);
    assert_eq!(coordinator.steer(&other, "cancel")["state"], "cancelled");
    let left = counts(&coordinator, &other);
    assert_eq!((&left["ready"], &left["leased"], &left["delayed"]), (&json!(0), &json!(0), &json!(0)));

    coordinator.steer(&id, "resume");
    coordinator.wait_until_succeeded(&id);
    assert_ne!(assert_unchanged_is_304(&coordinator, &id), tag);
    assert_answered(&coordinator, &id, 40);
    assert_forms_agree(&coordinator, &id);
    assert_flown_alike(&coordinator, &id);
    assert_eq!(counts(&coordinator, &other), left, "a cancelled study goes on");
    let cancelled = coordinator.get("/v1/studies?state=cancelled");
    assert_eq!(cancelled["items"].as_array().unwrap().len(), 1);
    assert_eq!(cancelled["items"][0]["id"], json!(other));

    // Both are idle now: the worker leaves, and the coordinator does not wait for anyone.
    worker.terminate();
    assert_eq!(worker.exit_code(), Some(0), "{}", worker.said());
    assert_eq!(coordinator.leave(), Some(0), "{}", coordinator.said());
}

#[test]
fn an_equal_simulation_is_not_flown_again() {
    let coordinator = Coordinator::start();
    let _worker = coordinator.worker("only");
    let first = coordinator.submit(&blades("first", 5, 30));
    coordinator.wait_until_succeeded(&first);
    let second = coordinator.submit(&blades("second", 5, 30));
    coordinator.wait_until_succeeded(&second);
    let cached = |id: &str| {
        let jobs = coordinator.jobs(id);
        jobs.iter().filter(|job| job["role"] == "sample" && job["cached"] == true).count()
    };
    assert_eq!((cached(&first), cached(&second)), (0, 30));
    assert_eq!(coordinator.dataset(&first, "text/csv"), coordinator.dataset(&second, "text/csv"));
}

#[test]
fn a_worker_asked_to_leave_finishes_its_job_and_leaves_nothing_behind() {
    let coordinator = Coordinator::start();
    let mut worker = coordinator.worker("leaver");
    let id = coordinator.submit(&lattice("drain", 31, 400));
    coordinator.wait_for_samples(&id, 3);
    worker.terminate();
    assert_eq!(worker.exit_code(), Some(0), "{}", worker.said());
    let after = counts(&coordinator, &id);
    assert_eq!((&after["leased"], &after["delayed"]), (&json!(0), &json!(0)), "{after}");
    assert!(after["ready"].as_u64().unwrap() > 0, "the study was over before the worker left: {after}");
    // Whatever was finished was delivered, and no attempt was wasted.
    let summary = format!("{} jobs done, 0 attempts failed, 0 results refused", after["succeeded"]);
    assert!(worker.said().contains(&summary), "{summary}: {}", worker.said());
    assert_eq!(coordinator.worker_view("leaver"), None, "who has left is not listed");
}

#[test]
fn a_second_signal_gives_a_long_job_back_at_once() {
    let coordinator = Coordinator::start();
    let mut worker = coordinator.worker("hasty");
    let id = coordinator.submit(&endless("long"));
    coordinator.wait_for_lease("hasty");
    worker.terminate();
    // Signals sent together count as one: the second waits until the first is heard.
    wait_for("the worker to drain", || worker.said().contains("draining").then_some(()));
    assert_eq!(counts(&coordinator, &id)["leased"], 1, "a draining worker keeps what it computes");
    worker.terminate();
    assert_eq!(worker.exit_code(), Some(0), "{}", worker.said());
    let after = counts(&coordinator, &id);
    assert_eq!((&after["ready"], &after["leased"], &after["delayed"]), (&json!(20), &json!(0), &json!(0)), "{after}");
}

#[test]
fn a_coordinator_leaves_while_workers_wait_and_they_find_the_next_one() {
    let mut coordinator = Coordinator::start();
    let _worker = coordinator.worker("patient");
    wait_for("the worker to register", || coordinator.worker_view("patient"));
    assert_eq!(coordinator.leave(), Some(0), "{}", coordinator.said());
    coordinator.restart();
    let id = coordinator.submit(&blades("after", 6, 30));
    coordinator.wait_until_succeeded(&id);
}
