//! Histories and wakes, read back as a user reads them.

use std::fs;
use std::path::Path;

use serde_json::Value;

use super::{json, outcome};

/// A flight of a moment: 3 strokes of 12 steps, a wake of one stroke.
const TINY: [&str; 20] = [
    "simulate",
    "--json",
    "--chordwise-panels",
    "2",
    "--spanwise-panels",
    "3",
    "--steps-per-stroke",
    "12",
    "--strokes",
    "3",
    "--strokes-most",
    "3",
    "--strokes-dropped",
    "1",
    "--wake-joined-after",
    "20",
    "--wake-strokes",
    "1",
    "--elastic-storage",
    "0.2",
];

fn tiny<'a>(more: &[&'a str]) -> Vec<&'a str> {
    TINY.iter().chain(more).copied().collect()
}

fn read(folder: &Path, name: &str) -> Value {
    serde_json::from_slice(&fs::read(folder.join(name)).unwrap()).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// The rows of a CSV file as objects.
fn rows(text: &str) -> Vec<Value> {
    let mut lines = text.lines();
    let names: Vec<_> = lines.next().unwrap().split(',').collect();
    let object = |line: &str| {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        assert_eq!(cells.len(), names.len(), "{line}");
        names.iter().zip(cells).map(|(name, cell)| ((*name).to_owned(), Value::from(cell))).collect()
    };
    lines.map(object).collect()
}

#[test]
fn a_history_has_a_row_per_step_and_the_means_of_the_flight() {
    let folder = tempfile::tempdir().unwrap();
    let flown = json(&outcome(folder.path(), &tiny(&["--history", "h.csv"])));
    let rows = rows(&fs::read_to_string(folder.path().join("h.csv")).unwrap());
    assert_eq!(rows.len(), 36);
    assert_eq!((number(&rows[13]["stroke"]), number(&rows[13]["step"])), (2.0, 1.0));
    let kept = &rows[12..];
    for (name, mean) in [("lift_n", "lift_n"), ("drag_n", "drag_n"), ("pitch_moment_nm", "pitch_moment_nm")] {
        let values: Vec<f64> = kept.iter().map(|row| number(&row[name])).collect();
        let scale = values.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        // Two strokes are kept; the shares of each add up to one.
        let averaged = kept.iter().zip(&values).map(|(row, v)| number(&row["share"]) * v).sum::<f64>() / 2.0;
        assert!((averaged - number(&flown["means"][mean]["mean"])).abs() <= 1e-12 * scale, "{name}");
    }
    let sweep = kept.iter().map(|row| number(&row["share"]) * number(&row["sweep_required_w"])).sum::<f64>() / 2.0;
    // The mean is of instants between the steps too, and twelve steps are few.
    let ratio = sweep / number(&flown["joints"]["sweep"]["required_w"]);
    assert!((0.8..1.25).contains(&ratio), "{ratio}");
}

#[test]
fn the_three_formats_say_the_same() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["h.csv", "h.json", "h.ndjson"] {
        json(&outcome(folder.path(), &tiny(&["--history", name])));
    }
    let whole = read(folder.path(), "h.json");
    assert_eq!(whole["strokes_dropped"], 1);
    assert_eq!(whole["parameters"].as_object().unwrap().len(), 10);
    let objects = whole["rows"].as_array().unwrap();
    let lines = fs::read_to_string(folder.path().join("h.ndjson")).unwrap();
    let lines: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(&lines, objects);
    let csv = rows(&fs::read_to_string(folder.path().join("h.csv")).unwrap());
    for (row, object) in csv.iter().zip(objects) {
        assert_eq!(row.as_object().unwrap().len(), object.as_object().unwrap().len());
        for (name, value) in object.as_object().unwrap() {
            assert_eq!(number(&row[name]), number(value), "{name}");
        }
    }
}

#[test]
fn a_wake_has_its_rings_and_says_how_to_read_them() {
    let folder = tempfile::tempdir().unwrap();
    json(&outcome(folder.path(), &tiny(&["--wake", "w.json", "--wake-steps", "2:3,last"])));
    let wake = read(folder.path(), "w.json");
    for (name, word) in [("axes", "earth"), ("side", "mirror image"), ("circulation", "m2/s")] {
        assert!(wake[name].as_str().unwrap().contains(word), "{name}: {wake}");
    }
    let steps = wake["steps"].as_array().unwrap();
    assert_eq!(steps.len(), 2);
    assert_eq!((&steps[0]["stroke"], &steps[0]["step"]), (&2.into(), &3.into()));
    assert_eq!((&steps[1]["stroke"], &steps[1]["step"]), (&3.into(), &11.into()));
    for step in steps {
        let (nodes, rings) = (step["nodes"].as_array().unwrap(), step["circulation_m2_s"].as_array().unwrap());
        // Three rows on the wing and a stroke of wake.
        assert_eq!((&step["wing_rows"], nodes.len(), rings.len()), (&3.into(), 3 + 12, 2 + 12));
        assert!(nodes.iter().all(|row| row.as_array().unwrap().len() == 4));
        assert!(rings.iter().all(|row| row.as_array().unwrap().len() == 3));
        assert!(nodes[0][0].as_array().unwrap().iter().all(Value::is_number));
    }
}

#[test]
fn every_case_has_files_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let all = tiny(&["--case", "all", "--history", "h.csv", "--wake", "w.json"]);
    let flown = json(&outcome(folder.path(), &all));
    assert_eq!(flown["cases"].as_array().unwrap().len(), 5);
    for case in ["reference", "optimum-1", "optimum-2", "five-direct", "five-ann"] {
        assert_eq!(rows(&fs::read_to_string(folder.path().join(format!("h-{case}.csv"))).unwrap()).len(), 36);
        assert_eq!(read(folder.path(), &format!("w-{case}.json"))["steps"].as_array().unwrap().len(), 1);
    }
    assert!(!folder.path().join("h.csv").exists());
}

#[test]
fn a_flight_is_written_for_paraview() {
    let folder = tempfile::tempdir().unwrap();
    json(&outcome(folder.path(), &tiny(&["--vtk", "flight", "--wake", "w.json"])));
    let listed = fs::read_to_string(folder.path().join("flight/flight.pvd")).unwrap();
    assert_eq!(listed.matches("<DataSet").count(), 2 * 12, "{listed}");
    // Of both what is asked for: all steps of the last stroke, unless others are chosen.
    assert_eq!(read(folder.path(), "w.json")["steps"].as_array().unwrap().len(), 12);
    let wing = fs::read_to_string(folder.path().join("flight/wing-0011.vtp")).unwrap();
    assert!(wing.contains(r#"NumberOfPoints="24" NumberOfPolys="12""#), "{wing}");
    assert!(folder.path().join("flight/wake-0000.vtp").is_file());
}

#[test]
fn what_cannot_be_recorded_is_refused_before_the_flight() {
    let folder = tempfile::tempdir().unwrap();
    for (more, told) in [
        (&["--wake", "w.json", "--wake-steps", "4:0"][..], "there are strokes 1 to 3"),
        (&["--wake", "w.json", "--wake-steps", "3:12"], "a stroke has steps 0 to 11"),
        (&["--wake", "w.json", "--wake-steps", "seven"], "expected last, all, all/N, or STROKE:STEP"),
        (&["--wake-steps", "last"], "--vtk DIR"),
        (&["--model", "quasi-steady", "--vtk", "flight"], "no wake"),
        (&["--wake", "w.csv"], "must end in .json"),
        (&["--history", "h.xlsx"], ".csv, .ndjson, .jsonl or .json"),
        (&["--model", "quasi-steady", "--wake", "w.json"], "no wake"),
    ] {
        // Blade elements refuse the lattice's settings.
        let line = if more[0] == "--model" { [&["simulate"], more].concat() } else { tiny(more) };
        let output = outcome(folder.path(), &line);
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{more:?}: {text}");
        assert!(text.contains(told), "{more:?}: {text}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is written");
}

#[test]
fn a_stroke_which_is_not_flown_leaves_an_empty_history_with_its_reason() {
    let folder = tempfile::tempdir().unwrap();
    let collision = ["--set", "sweep_mean_deg=60", "--set", "sweep_amplitude_deg=90", "--history", "h.json"];
    json(&outcome(folder.path(), &tiny(&collision)));
    let history = read(folder.path(), "h.json");
    assert!(history["infeasible"].as_str().unwrap().contains("plane of symmetry"));
    assert_eq!(history["rows"].as_array().unwrap().len(), 0);
}
