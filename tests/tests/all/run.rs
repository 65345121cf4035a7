//! `manduca run` and `manduca simulate` as a user types them.

use std::fs;
use std::path::Path;
use std::process::Output;

use manduca_tests::program::manduca;
use manduca_tests::studies::lattice;
use serde_json::Value;

const OUTPUTS: [&str; 4] = ["lift", "drag", "pitch_moment", "power"];

/// Runs the program to its end in a folder.
fn outcome(folder: &Path, arguments: &[&str]) -> Output {
    manduca(arguments).current_dir(folder).output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Standard output of a success: one JSON object and nothing else.
fn one_object(output: &Output) -> Value {
    assert_eq!(output.status.code(), Some(0), "{}", stderr(output));
    let mut values = serde_json::Deserializer::from_slice(&output.stdout).into_iter::<Value>();
    let value = values.next().expect("something is printed").unwrap();
    assert!(values.next().is_none(), "more than one value is printed");
    assert!(value.is_object());
    value
}

/// Fails unless all these places, such as `/samples/dead`, are in a document.
fn assert_has(document: &Value, pointers: &[&str]) {
    for pointer in pointers {
        assert!(document.pointer(pointer).is_some(), "{pointer} is missing in {document}");
    }
}

#[test]
fn run_prints_one_object_and_a_second_run_finds_it() {
    let folder = tempfile::tempdir().unwrap();
    let study = toml::to_string(&lattice("tiny", 41, 30)).unwrap();
    fs::write(folder.path().join("tiny.toml"), study).unwrap();
    let command = ["run", "tiny.toml", "--data", "store", "--json"];

    let first = one_object(&outcome(folder.path(), &command));
    assert_has(&first, &["/study", "/samples/succeeded", "/samples/infeasible", "/samples/dead"]);
    assert_has(&first, &["/stages_s/sampling", "/stages_s/training", "/stages_s/optimising", "/stages_s/verifying"]);
    assert_has(&first, &["/stages_s/refining", "/optimisations/0/refined/ended"]);
    let flown = first["optimisations"][0]["refined"]["standing"]["simulations"].as_u64();
    assert!(flown.is_some_and(|flown| (1..=30).contains(&flown)), "{first}");
    assert_has(&first, &["/optimisations/0/name", "/optimisations/0/power_per_lift_w_per_n"]);
    assert_eq!(first["optimisations"][0]["parameters"].as_object().unwrap().len(), 10);
    for name in OUTPUTS {
        assert!(first["surrogate"]["rmse"][name].is_number(), "{name} in {first}");
        assert!(first["optimisations"][0]["predicted"][name].is_number(), "{name} in {first}");
        let simulated = &first["optimisations"][0]["simulated"][name];
        assert!(simulated["mean"].is_number() && simulated["se"].is_number(), "{name} in {first}");
    }
    assert_eq!(first["samples"]["succeeded"], 30);
    assert!(folder.path().join("store").is_dir());

    // Everything, the wall times of the stages too, is the first run's: nothing was computed again.
    let again = outcome(folder.path(), &command);
    assert_eq!(one_object(&again), first);
    assert!(stderr(&again).contains("already done"), "{}", stderr(&again));
    let quietly = outcome(folder.path(), &[&command[..], &["--quiet"]].concat());
    assert_eq!((one_object(&quietly), stderr(&quietly)), (first, String::new()));
}

/// `manduca run quick --data quick`, twice: what a first run left is not the study.
#[test]
fn a_folder_of_the_name_of_a_built_in_study_is_no_study() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("quick")).unwrap();
    let checked = outcome(folder.path(), &["study", "submit", "quick", "--dry-run", "--json"]);
    assert_eq!(checked.status.code(), Some(0), "{}", stderr(&checked));
}

#[test]
fn a_broken_study_is_refused_with_file_field_and_reason() {
    let folder = tempfile::tempdir().unwrap();
    let good = toml::to_string(&lattice("tiny", 41, 30)).unwrap();
    let cases = [
        ("samples = 30", "samples = 3", "/sampling/samples", "outside"),
        ("steps_per_stroke = 12", "steps_per_stroke = 12.5", "/model/solver/steps_per_stroke", "whole number"),
        ("neurons = 6", "neurones = 6", "/surrogate", "unknown field `neurones`"),
        ("seed = 41", "seed = 41\nparameters = { frequency_hz = [30, 20] }", "/parameters/frequency_hz", "above"),
        ("name = \"tiny\"", "name = \"tiny", "broken.toml:", "invalid"),
    ];
    for (right, wrong, field, reason) in cases {
        let broken = good.replace(right, wrong);
        assert_ne!(broken, good, "{right} is not in {good}");
        fs::write(folder.path().join("broken.toml"), broken).unwrap();
        let output = outcome(folder.path(), &["run", "broken.toml", "--data", "store", "--json"]);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{wrong}: {text}");
        assert!(output.stdout.is_empty(), "{wrong}");
        for part in ["broken.toml", field, reason] {
            assert!(text.contains(part), "{wrong}: no `{part}` in {text}");
        }
    }
    assert!(!folder.path().join("store").exists(), "a refused study leaves something behind");
}

/// `simulate` on a lattice which takes no time.
fn simulate(more: &[&str]) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let mut arguments = vec!["simulate", "--case", "reference", "--json", "--chordwise-panels", "3"];
    arguments.extend(["--spanwise-panels", "4", "--steps-per-stroke", "12", "--strokes", "3", "--strokes-most", "3"]);
    arguments.extend(["--strokes-dropped", "1", "--wake-strokes", "0.75"]);
    arguments.extend(more);
    one_object(&outcome(folder.path(), &arguments))
}

#[test]
fn simulate_prints_the_documented_shape() {
    let flown = simulate(&[]);
    assert_eq!((&flown["outcome"], &flown["reason"]), (&"ok".into(), &Value::Null));
    assert_eq!(flown["parameters"].as_object().unwrap().len(), 10);
    assert_eq!(flown["strokes_averaged"], 2);
    for (scaled, si) in OUTPUTS.iter().zip(["lift_n", "drag_n", "pitch_moment_nm", "power_w"]) {
        for estimate in [&flown["scaled"][scaled], &flown["means"][si]] {
            assert!(estimate["mean"].is_number() && estimate["se"].is_number(), "{scaled} in {flown}");
        }
    }
    assert!(flown["power_per_lift_w_per_n"].is_number() && flown["wall_s"].is_number(), "{flown}");
    assert!(flown["solver_version"].is_string(), "{flown}");
}

#[test]
fn an_infeasible_stroke_is_an_answer() {
    let refused = simulate(&["--set", "sweep_mean_deg=60", "--set", "sweep_amplitude_deg=90"]);
    assert_eq!(refused["outcome"], "infeasible");
    assert!(refused["reason"].as_str().unwrap().contains("plane of symmetry"), "{refused}");
    for name in ["means", "scaled", "power_per_lift_w_per_n", "strokes_averaged"] {
        assert!(refused[name].is_null(), "{name} in {refused}");
    }
    assert_eq!(refused["parameters"]["sweep_amplitude_deg"], 90.0);
}
