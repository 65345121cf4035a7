//! The commands which talk to a coordinator, as a user types them, and several
//! users at once.

use std::process::Output;

use manduca_tests::client::Client;
use manduca_tests::coordinator::{Coordinator, text};
use manduca_tests::program::manduca;
use manduca_tests::studies::{blades, endless, lattice};
use serde_json::{Value, json};

/// Runs a command against a coordinator to its end.
fn command(coordinator: &Coordinator, arguments: &[&str]) -> Output {
    let mut command = manduca(arguments);
    command.args(["--coordinator", &coordinator.url()]).current_dir(coordinator.folder());
    command.output().unwrap()
}

/// What a successful command prints.
fn printed(coordinator: &Coordinator, arguments: &[&str]) -> String {
    let output = command(coordinator, arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

/// What a successful command prints with `--json`.
fn object(coordinator: &Coordinator, arguments: &[&str]) -> Value {
    let text = printed(coordinator, &[arguments, &["--json"]].concat());
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

/// Writes a study file into the coordinator's folder.
fn write(coordinator: &Coordinator, name: &str, study: &Value) {
    std::fs::write(coordinator.folder().join(name), study.to_string()).unwrap();
}

#[test]
fn a_study_is_submitted_watched_and_fetched_from_the_command_line() {
    let coordinator = Coordinator::start();
    let _worker = coordinator.worker("only");
    write(&coordinator, "small.json", &blades("small", 51, 30));
    let dry = object(&coordinator, &["study", "submit", "small.json", "--dry-run"]);
    assert_eq!((&dry["simulations"], &dry["errors"]), (&json!(31), &json!([])));
    assert!(dry["study_estimate_s"].as_f64().is_some_and(|s| s > 0.0), "{dry}");
    assert_eq!(object(&coordinator, &["study", "list"]), json!({ "studies": [] }));

    let answer = object(&coordinator, &["study", "submit", "small.json", "--wait"]);
    let id = text(&answer["study"]);
    assert_eq!(answer["samples"]["succeeded"], 30);
    let end = &id[id.len() - 6..];
    for study in [id.as_str(), end, "latest"] {
        assert_eq!(object(&coordinator, &["optimum", study]), answer, "{study}");
        assert_eq!(object(&coordinator, &["study", "show", study])["id"], json!(id), "{study}");
    }
    assert_eq!(object(&coordinator, &["study", "watch", &id]), answer);
    assert_eq!(object(&coordinator, &["study", "list"])["studies"][0]["samples_succeeded"], 30);

    let csv = coordinator.dataset(&id, "text/csv");
    assert_eq!(printed(&coordinator, &["dataset", "latest"]), csv);
    let json = printed(&coordinator, &["dataset", "latest", "--format", "json"]);
    assert_eq!(json, coordinator.dataset(&id, "application/json"));
    assert_eq!(printed(&coordinator, &["dataset", "latest", "--output", "data.csv"]), "");
    assert_eq!(std::fs::read_to_string(coordinator.folder().join("data.csv")).unwrap(), csv);
    assert_eq!(printed(&coordinator, &["dataset", "latest", "-o", "data.parquet"]), "");
    assert_eq!(printed(&coordinator, &["study", "model", "latest", "-o", "net.onnx"]), "");
    let model = printed(&coordinator, &["study", "model", "latest"]);
    assert_eq!(model, coordinator.ask(&format!("/v1/studies/{id}/surrogate/model")).body);
    let begins = |name: &str| std::fs::read(coordinator.folder().join(name)).unwrap()[..4].to_vec();
    assert_eq!((begins("data.parquet"), begins("net.onnx")), (b"PAR1".to_vec(), vec![8, 8, 18, 7]));
    let drawn = object(&coordinator, &["figures", "latest", "--output", "figures", "--scale", "0.5"]);
    for name in ["training", "agreement", "distributions", "forces", "angles", "tip-paths"] {
        let (png, svg) = (format!("figures/{name}.png"), format!("figures/{name}.svg"));
        assert!(
            drawn["files"].as_array().is_some_and(|f| f.contains(&json!(png)) && f.contains(&json!(svg))),
            "{drawn}"
        );
        assert!(begins(&png) == [0x89, b'P', b'N', b'G'] && begins(&svg) == *b"<svg", "{name}");
    }
    let table = printed(&coordinator, &["optimum", "latest"]);
    assert!(table.contains("frequency_hz") && table.contains("free"), "{table}");
}

#[test]
fn a_study_is_steered_from_the_command_line() {
    let coordinator = Coordinator::start();
    write(&coordinator, "long.json", &endless("long"));
    let submit = ["study", "submit", "long.json", "--idempotency-key", "once"];
    let first = object(&coordinator, &submit);
    assert_eq!(object(&coordinator, &submit), first);
    for (action, state) in [("pause", "paused"), ("resume", "sampling"), ("cancel", "cancelled")] {
        assert_eq!(object(&coordinator, &["study", action, "latest"])["state"], state);
    }
    // Wrong requests are the user's to mend: code 2, and why on standard error.
    for (wrong, why) in [
        (&["study", "resume", "latest"][..], "cancelled"),
        (&["study", "show", "00000000-0000-7000-8000-000000000000"], "no study"),
        (&["study", "show", "ffffffffffff"], "no study"),
        (&["study", "submit", "long.json", "--idempotency-key", ""], "idempotency-key"),
        (&["study", "submit", "missing.json"], "missing.json"),
    ] {
        let output = command(&coordinator, wrong);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{wrong:?}: {errors}");
        assert!(errors.to_lowercase().contains(why), "{wrong:?}: {errors}");
    }
}

#[test]
fn the_doctor_and_the_drain_tell_scripts_what_they_found_and_did() {
    let coordinator = Coordinator::start();
    let mut worker = coordinator.worker("only");
    coordinator.submit(&lattice("drain", 31, 400));
    coordinator.wait_for_lease("only");
    let findings = object(&coordinator, &["doctor", "--data", "data"]);
    let found = findings.as_array().unwrap().iter().map(|f| (text(&f["what"]), text(&f["verdict"])));
    let found: Vec<_> = found.filter(|(_, verdict)| verdict == "well").map(|(what, _)| what).collect();
    for what in ["program", "compute slot", "database", "coordinator", "token", "clocks"] {
        assert!(found.iter().any(|f| f == what), "{what}: {findings}");
    }
    let drained = object(&coordinator, &["workers", "drain", "only"]);
    assert_eq!((drained[0]["name"].as_str(), drained.as_array().unwrap().len()), (Some("only"), 1));
    assert_eq!(worker.exit_code(), Some(0), "a drained worker leaves well");
    let unknown = command(&coordinator, &["workers", "drain", "other", "--json"]);
    assert_eq!((unknown.status.code(), unknown.stdout.len()), (Some(2), 0));
}

#[test]
fn a_coordinator_which_is_not_there_is_a_failure_that_says_so() {
    let mut coordinator = Coordinator::start();
    coordinator.kill();
    for arguments in [&["study", "list"][..], &["optimum", "latest"], &["dataset", "latest"]] {
        let output = command(&coordinator, arguments);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {errors}");
        assert!(errors.contains(&coordinator.url()), "{arguments:?}: {errors}");
        assert!(output.stdout.is_empty());
    }
}

#[test]
fn many_submit_one_study_at_once_and_get_the_same() {
    let coordinator = Coordinator::start();
    let (url, study) = (coordinator.url(), endless("popular"));
    let submit = || {
        let client = Client::new(&url);
        let answer = client.send(client.request("POST", "/v1/studies").header("idempotency-key", "same").json(&study));
        (answer.status, text(&answer.json()["id"]))
    };
    let answers: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..16).map(|_| scope.spawn(submit)).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    assert_eq!(answers.iter().filter(|(status, _)| *status == 201).count(), 1, "{answers:?}");
    assert!(answers.iter().all(|(status, id)| [200, 201].contains(status) && *id == answers[0].1), "{answers:?}");
    assert_eq!(coordinator.get("/v1/studies")["items"].as_array().unwrap().len(), 1);
    assert_eq!(coordinator.jobs(&answers[0].1).len(), 20);
}
