//! The command as a user starts it.
// A test which cannot go on panics.
#![allow(clippy::unwrap_used)]

#[path = "command/cost.rs"]
mod cost;
#[path = "command/histories.rs"]
mod histories;
#[path = "command/operate.rs"]
mod operate;

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

/// Small and with blade elements, so that it is over in seconds.
const STUDY: &str = r#"
name = "tiny"
seed = 4

[model]
kind = "quasi-steady"

[sampling]
samples = 60

[surrogate]
neurons = 6
max_iterations = 30

[[optimisations]]
name = "case-I"
population = 400
generations = 40
"#;

fn manduca(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_manduca"));
    command.args(arguments).current_dir(folder).stdin(Stdio::null());
    for variable in ["MANDUCA_DATA", "MANDUCA_SLOTS", "MANDUCA_LOG", "RUST_LOG"] {
        command.env_remove(variable);
    }
    command
}

fn outcome(folder: &Path, arguments: &[&str]) -> Output {
    manduca(folder, arguments).output().unwrap()
}

fn folder_with(study: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("study.toml"), study).unwrap();
    folder
}

fn json(output: &Output) -> Value {
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}: {errors}", output.status);
    serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&output.stdout)))
}

#[test]
fn a_study_runs_to_its_answer_and_a_second_run_finds_it() {
    let folder = folder_with(STUDY);
    let run = ["run", "study.toml", "--slots", "2", "--json"];
    let first = json(&outcome(folder.path(), &run));
    assert_eq!(first["samples"]["succeeded"], 60);
    let optimum = &first["optimisations"][0];
    assert_eq!((&optimum["name"], &optimum["status"]), (&"case-I".into(), &"refined".into()), "{first}");
    assert!(optimum["parameters"]["frequency_hz"].as_f64().unwrap() >= 15.0);
    assert!(optimum["simulated"]["lift"]["mean"].is_number() && first["stages_s"]["sampling"].is_number());
    assert!(first["surrogate"]["rmse"]["lift"].is_number() && first["study"].is_string());

    let again = outcome(folder.path(), &run);
    assert!(String::from_utf8_lossy(&again.stderr).contains("already done"));
    assert_eq!(json(&again)["optimisations"], first["optimisations"]);

    let table = outcome(folder.path(), &["run", "study.toml"]);
    let text = String::from_utf8(table.stdout).unwrap();
    assert!(text.contains("rotation_shape") && text.contains("dataset latest"), "{text}");
}

#[cfg(unix)]
#[test]
fn an_interrupted_study_goes_on() {
    let folder = folder_with(&STUDY.replace("samples = 60", "samples = 20000"));
    let mut child =
        manduca(folder.path(), &["run", "study.toml"]).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
    let database = folder.path().join("manduca-data");
    while !database.exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended early");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    std::thread::sleep(std::time::Duration::from_secs(3));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{text}");
    assert!(text.contains("goes on"), "{text}");
}

#[test]
fn refused_input_is_code_2_with_file_and_field() {
    let folder = folder_with(&STUDY.replace("samples = 60", "samples = 6"));
    let output = outcome(folder.path(), &["run", "study.toml"]);
    assert_eq!(output.status.code(), Some(2));
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(text.contains("study.toml: /sampling/samples: 6 is outside"), "{text}");
    for arguments in [
        &["simulate", "--set", "colour=1"][..],
        &["simulate", "--spanwise-panels", "1000"],
        &["serve", "--listen", "0.0.0.0:0"],
        &["worker", "--coordinator", "ftp://localhost"],
        &["insects", "dragon"],
        // Nobody listens: what cannot be written is refused before anything is asked for.
        &["dataset", "latest", "-o", "samples.xlsx", "--coordinator", "http://127.0.0.1:9"],
        &["study", "model", "latest", "-o", "net.pt", "--coordinator", "http://127.0.0.1:9"],
        &["optimise", "latest", "--name", "a", "--set", "colour=1", "--coordinator", "http://127.0.0.1:9"],
        &["dance"],
    ] {
        let output = outcome(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn empty_variables_count_as_unset() {
    let folder = tempfile::tempdir().unwrap();
    let variables = [
        "MANDUCA_DATA",
        "MANDUCA_KEEP_DAYS",
        "MANDUCA_SLOTS",
        "MANDUCA_LISTEN",
        "MANDUCA_LOG",
        "MANDUCA_LOG_FORMAT",
        "MANDUCA_COORDINATOR",
        "MANDUCA_TOKEN",
        "MANDUCA_TOKEN_FILE",
        "MANDUCA_IDLE_EXIT",
        "MANDUCA_MAX_RUNTIME",
    ];
    let mut command = manduca(folder.path(), &["token", "create", "x", "--scope", "read", "--init"]);
    let output = command.envs(variables.map(|name| (name, ""))).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(folder.path().join("manduca-data/manduca.db").is_file());
    // Both fail for a reason of their own: no machine has the first address, none understands the second.
    for line in [&["serve", "--listen", "192.0.2.1:1"][..], &["worker", "--coordinator", "ftp://x"]] {
        let output = manduca(folder.path(), line).envs(variables.map(|name| (name, ""))).output().unwrap();
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && !text.contains("invalid value"), "{text}");
    }
}

#[cfg(unix)]
#[test]
fn a_study_may_come_through_a_pipe() {
    let folder = folder_with(STUDY);
    let output = manduca(folder.path(), &["study", "submit", "/dev/stdin", "--dry-run", "--json"])
        .stdin(fs::File::open(folder.path().join("study.toml")).unwrap())
        .output()
        .unwrap();
    assert_eq!(json(&output)["study"]["name"], "tiny");
    let utf16: Vec<u8> = STUDY.encode_utf16().flat_map(u16::to_le_bytes).collect();
    fs::write(folder.path().join("wide.toml"), [&[0xff, 0xfe][..], &utf16].concat()).unwrap();
    for name in ["wide.toml", "."] {
        let output = outcome(folder.path(), &["run", name]);
        assert_eq!(output.status.code(), Some(2), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn a_simulation_has_its_documented_shape() {
    let folder = tempfile::tempdir().unwrap();
    let flown = json(&outcome(folder.path(), &["simulate", "--model", "quasi-steady", "--json"]));
    assert_eq!((&flown["outcome"], &flown["reason"]), (&"ok".into(), &Value::Null));
    for name in ["lift_n", "drag_n", "pitch_moment_nm", "power_w"] {
        assert!(flown["means"][name]["mean"].is_number() && flown["means"][name]["se"].is_number(), "{name}");
    }
    for name in ["lift", "drag", "pitch_moment", "power"] {
        assert!(flown["scaled"][name]["mean"].is_number(), "{name}");
    }
    for name in ["power_per_lift_w_per_n", "strokes_averaged", "wall_s"] {
        assert!(flown[name].is_number(), "{name}");
    }
    assert_eq!(flown["parameters"].as_object().unwrap().len(), 10);
    let collision = ["simulate", "--set", "sweep_mean_deg=60", "--set", "sweep_amplitude_deg=90", "--json"];
    let refused = json(&outcome(folder.path(), &collision));
    assert_eq!(refused["outcome"], "infeasible");
    assert!(refused["reason"].is_string() && refused["means"].is_null());
}
