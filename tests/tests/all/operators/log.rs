//! A log line nobody can take is dropped, and nothing else with it.

use std::fs::File;
use std::process::Stdio;

use manduca_tests::client::Client;
use manduca_tests::coordinator::{Coordinator, free_port};
use manduca_tests::process::Process;
use manduca_tests::program::manduca;
use manduca_tests::studies::blades;
use manduca_tests::wait_for;
use serde_json::Value;

use super::{outcome, stderr};

/// A coordinator whose log goes there, with its client.
fn serve(folder: &tempfile::TempDir, log: impl Into<Stdio>) -> (Process, Client) {
    let address = format!("127.0.0.1:{}", free_port());
    let data = folder.path().join("data");
    let command = manduca(&["serve", "--listen", &address, "--data", data.to_str().unwrap()]);
    let process = Process::start_saying(command, folder.path(), "serve", log);
    (process, Client::new(&format!("http://{address}")))
}

fn wait_until_ready(process: &mut Process, client: &Client) {
    wait_for("a ready coordinator", || {
        assert!(process.ended().is_none(), "it ends");
        client.try_send(client.request("GET", "/readyz")).is_ok_and(|answer| answer.status == 200).then_some(())
    });
}

/// A whole study, each step of which is logged.
fn assert_works(folder: &tempfile::TempDir, process: &mut Process, client: &Client) {
    let submitted = client.post("/v1/studies", &blades("unheard", 3, 30)).expect(201);
    let worker = manduca(&["worker", "--coordinator", client.base(), "--slots", "1"]);
    let _worker = Process::start(worker, folder.path(), "worker");
    let path = format!("/v1/studies/{}", submitted["id"].as_str().unwrap());
    wait_for("a study to succeed", || (client.get(&path)["state"] == "succeeded").then_some(()));
    assert_eq!(client.ask("/readyz").status, 200);
    assert!(process.ended().is_none());
}

#[test]
fn a_log_whose_reader_ends_stops_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (mut process, client) = serve(&folder, Stdio::piped());
    wait_until_ready(&mut process, &client);
    process.stop_listening();
    assert_works(&folder, &mut process, &client);
    process.terminate();
    assert_eq!(process.exit_code(), Some(0));
}

#[test]
fn a_log_on_a_full_disk_stops_nothing_from_the_first_line_on() {
    let folder = tempfile::tempdir().unwrap();
    let (mut process, client) = serve(&folder, File::options().write(true).open("/dev/full").unwrap());
    wait_until_ready(&mut process, &client);
    assert_works(&folder, &mut process, &client);
}

#[test]
fn a_log_in_json_is_json_from_the_first_line_to_the_last() {
    let coordinator = Coordinator::start_serving(&["--log-format", "json"]);
    let again = ["serve", "--listen", coordinator.address(), "--data", "/nowhere", "--log-format", "json"];
    let refused = outcome(&again);
    assert!(!refused.status.success());
    let said = coordinator.said();
    let lines: Vec<_> = said.lines().map(str::to_owned).chain(stderr(&refused).lines().map(str::to_owned)).collect();
    assert!(lines.len() > 2, "{lines:?}");
    let all: Vec<Value> =
        lines.iter().map(|l| serde_json::from_str(l).unwrap_or_else(|e| panic!("{e}: {l}"))).collect();
    assert!(all.iter().any(|line| line["message"].as_str().is_some_and(|m| m.contains("listening on http://"))));
    let last = all.last().unwrap();
    assert!(last["level"] == "ERROR" && last["message"].as_str().unwrap().contains("in use"), "{last}");
}

#[test]
fn an_answer_nobody_reads_is_no_failure() {
    for arguments in [&["settings"][..], &["insects"], &["completions", "bash"], &["--help"], &["simulate", "--help"]] {
        let mut child = manduca(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", stderr(&output));
        assert!(!stderr(&output).contains("panicked"), "{arguments:?}: {}", stderr(&output));
    }
    let full = File::options().write(true).open("/dev/full").unwrap();
    let output = manduca(&["settings"]).stdout(full).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("No space left") && !stderr(&output).contains("panicked"), "{}", stderr(&output));
}
