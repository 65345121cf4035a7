//! One coordinator per folder: others are refused, or join it.

use std::process::{Child, Stdio};

use manduca_tests::coordinator::Coordinator;
use manduca_tests::process::Process;
use manduca_tests::program::manduca;
use manduca_tests::studies::lattice;
use manduca_tests::wait_for;
use serde_json::Value;

use super::{outcome, stderr, study_file, write_study};

fn start(arguments: &[&str]) -> Child {
    manduca(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// The answer of a `run` which must have succeeded, and what it said.
fn answer(child: Child) -> (Value, String) {
    let output = child.wait_with_output().unwrap();
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    (serde_json::from_slice(&output.stdout).unwrap(), said)
}

#[test]
fn a_second_coordinator_is_refused_and_told_of_the_first() {
    let mut coordinator = Coordinator::start();
    let data = coordinator.data();
    let second = ["serve", "--listen", "127.0.0.1:0", "--data", &data];
    let refused = outcome(&second);
    let said = stderr(&refused);
    assert_eq!(refused.status.code(), Some(2), "{said}");
    assert!(said.contains(&coordinator.url()) && said.contains("another coordinator"), "{said}");
    assert!(!said.contains("listening"), "{said}");
    // What looks at the database, or changes a token, does so beside a coordinator.
    for arguments in [
        &["db", "check"][..],
        &["db", "prune", "--older-than-days", "1", "--dry-run"],
        &["db", "prune", "--older-than-days", "1"],
        &["token", "create", "ada", "--scope", "read"],
        &["token", "list"],
    ] {
        let done = outcome(&[arguments, &["--data", &data]].concat());
        assert!(done.status.success(), "{arguments:?}: {}", stderr(&done));
    }
    // A lock does not outlive its process, however that ends.
    coordinator.kill();
    let mut next = Process::start(manduca(&second), coordinator.folder(), "next");
    wait_for("the next coordinator", || {
        assert!(next.ended().is_none(), "{}", next.said());
        next.said().contains("listening on").then_some(())
    });
}

#[test]
fn a_run_beside_a_coordinator_joins_it() {
    let coordinator = Coordinator::start();
    let study = study_file(coordinator.folder(), "joined", 5, 30);
    let run = ["run", &study, "--data", &coordinator.data(), "--slots", "1", "--json"];
    let (first, said) = answer(start(&run));
    assert!(said.contains("joining") && said.contains(&coordinator.url()), "{said}");
    assert!(!said.contains("going on with"), "it is new: {said}");
    let id = first["study"].as_str().unwrap();
    assert_eq!(coordinator.study(id)["state"], "succeeded");
    let (again, said) = answer(start(&run));
    assert!(again == first && said.contains("already done"), "{said}");
}

#[test]
fn first_starts_at_once_share_a_new_folder() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("new/data");
    let files: Vec<_> = (0..4).map(|i| study_file(folder.path(), &format!("s{i}"), i / 2, 30)).collect();
    let runs: Vec<_> = files
        .iter()
        .map(|file| start(&["run", file, "--data", data.to_str().unwrap(), "--slots", "1", "--json"]))
        .collect();
    let answers: Vec<_> = runs.into_iter().map(answer).collect();
    for (answer, said) in &answers {
        assert_eq!(answer["samples"]["succeeded"], 30, "{said}");
    }
    let holders = answers.iter().filter(|(_, said)| said.contains("watch it at http://127.0.0.1:")).count();
    assert!(holders >= 1, "{answers:?}");
    let checked = outcome(&["db", "check", "--data", data.to_str().unwrap()]);
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stdout));
}

#[test]
fn a_run_goes_on_when_the_one_it_joined_ends_or_is_killed() {
    for kills in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("data");
        let data = data.to_str().unwrap();
        let short = write_study(folder.path(), "short", &lattice("short", 1, if kills { 5000 } else { 60 }));
        let long = write_study(folder.path(), "long", &lattice("long", 2, 120));
        let first = manduca(&["run", &short, "--data", data, "--slots", "1"]);
        let mut first = Process::start(first, folder.path(), "first");
        wait_for("a coordinator", || first.said().contains("study ").then_some(()));
        let second = ["run", &long, "--data", data, "--slots", "1", "--json"];
        let log = std::fs::File::create(folder.path().join("second.log")).unwrap();
        let child = manduca(&second).stdout(Stdio::piped()).stderr(log).spawn().unwrap();
        let said = || std::fs::read_to_string(folder.path().join("second.log")).unwrap();
        wait_for("the second run to join", || said().contains("joining").then_some(()));
        if kills {
            wait_for("samples", || said().contains("sampling").then_some(()));
            first.kill();
        }
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", said());
        let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(answer["samples"]["succeeded"], 120);
        if kills {
            assert!(said().contains("this one goes on"), "{}", said());
        }
    }
}

#[test]
fn a_fresh_run_does_not_go_on_and_says_where_to_watch() {
    let folder = tempfile::tempdir().unwrap();
    let study = study_file(folder.path(), "fresh", 9, 200);
    let data = folder.path().join("data");
    let child = start(&["run", &study, "--data", data.to_str().unwrap(), "--slots", "2", "--json"]);
    let (_, said) = answer(child);
    assert!(!said.contains("going on with"), "{said}");
    assert!(said.contains("watch it at http://127.0.0.1:"), "{said}");
}
