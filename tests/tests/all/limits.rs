//! Limits of the system and of time, and clients which meet them.

use std::io::{Read, Write};
use std::net::TcpListener;
use std::process::{Command, Output};
use std::thread;

use manduca_tests::coordinator::Coordinator;
use manduca_tests::program::{manduca, program};
use manduca_tests::proxy::strangers;
use manduca_tests::studies::blades;
use serde_json::Value;

/// The program under limits which a shell sets.
fn limited(limits: &str, arguments: &[&str]) -> Command {
    // Its environment is cleaned as that of any other command of a test.
    let mut command = Command::new("sh");
    command.args(["-c", &format!("{limits} && exec \"$0\" \"$@\"")]).arg(program()).args(arguments);
    for (name, value) in manduca(&[]).get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    command
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn open_files_are_raised_for_the_slots_or_refused_with_the_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let study = folder.path().join("small.json");
    std::fs::write(&study, blades("files", 3, 30).to_string()).unwrap();
    let (study, data) = (study.display().to_string(), folder.path().join("data").display().to_string());
    let run = ["run", &study, "--data", &data, "--slots", "40", "--json"];
    let output = limited("ulimit -S -n 100", &run).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(answer["samples"]["succeeded"], 30);

    for arguments in [&run[..], &["worker", "--coordinator", "http://127.0.0.1:9", "--slots", "40"]] {
        let output = limited("ulimit -n 100", arguments).output().unwrap();
        let words = said(&output);
        assert_eq!(output.status.code(), Some(2), "{words}");
        assert!(words.contains("40 slots need 224 open files") && words.contains("may have 100"), "{words}");
        assert!(words.contains("--slots 9 would fit"), "{words}");
    }
}

#[test]
fn a_worker_which_meets_nobody_leaves_when_its_time_is_over() {
    let url = {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        format!("http://{}", listener.local_addr().unwrap())
    };
    for limit in ["--idle-exit", "--max-runtime"] {
        let output = manduca(&["worker", "--coordinator", &url, "--slots", "1", limit, "1"]).output().unwrap();
        let words = said(&output);
        assert_eq!(output.status.code(), Some(1), "{words}");
        assert!(words.contains("without having been registered") && words.contains("cannot reach"), "{words}");
    }
}

/// Answers every call on a port of its own with the same bytes, and then hangs up.
fn says(bytes: Vec<u8>) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    thread::spawn(move || {
        for mut client in listener.incoming().flatten() {
            let mut request = [0; 4096];
            // Whatever it asks, and whether or not it stays for the answer.
            let _ = client.read(&mut request);
            let _ = client.write_all(&bytes);
        }
    });
    url
}

#[test]
fn a_client_which_is_not_answered_by_a_coordinator_says_so() {
    for (name, answer) in strangers() {
        let is_silent = answer.is_empty() || name == "half an answer";
        let url = says(answer);
        let output = manduca(&["study", "list", "--coordinator", &url]).output().unwrap();
        let words = said(&output);
        assert_eq!(output.status.code(), Some(1), "{name}: {words}");
        assert!(is_silent || words.contains("is not from a manduca coordinator"), "{name}: {words}");
        let health = format!("{url}/healthz");
        let output = manduca(&["healthcheck", "--url", &health]).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{name}: {}", said(&output));
    }
}

#[test]
fn a_dataset_which_comes_short_is_a_failure() {
    let coordinator = Coordinator::start();
    let _worker = coordinator.worker("only");
    let id = coordinator.submit(&blades("short", 4, 30));
    coordinator.wait_until_succeeded(&id);
    for (format, media_type) in [("csv", "text/csv"), ("ndjson", "application/x-ndjson"), ("json", "application/json")]
    {
        let whole = coordinator.dataset(&id, media_type);
        // The beginning of it, in an answer which looks well.
        let half = &whole[..whole[..whole.len() / 2].rfind('\n').unwrap() + 1];
        for announced in [true, false] {
            let length = if announced { format!("content-length: {}\r\n", half.len()) } else { String::new() };
            let head = format!("HTTP/1.1 200 OK\r\ncontent-type: {media_type}\r\nmanduca-rows: 30\r\n{length}");
            let url = says(format!("{head}connection: close\r\n\r\n{half}").into_bytes());
            let file = coordinator.folder().join(format!("short.{format}")).display().to_string();
            let output = manduca(&["dataset", &id, "--coordinator", &url, "-o", &file]).output().unwrap();
            let words = said(&output);
            assert_eq!(output.status.code(), Some(1), "{format}: {words}");
            assert!(words.contains("the dataset broke off") && !words.contains("wrote"), "{format}: {words}");
        }
    }
}
