//! What a study would cost, asked without a coordinator.

use serde_json::{Value, json as literal};

use super::{STUDY, folder_with, json, outcome};

/// Its estimate is samples x seconds / cores.
fn assert_estimate(report: &Value, samples: u32) {
    let number = |name: &str| report[name].as_f64().unwrap_or_else(|| panic!("no {name} in {report}"));
    assert!(number("production_sample_s") > 0.0 && number("cores") >= 1.0, "{report}");
    assert_eq!(number("study_samples"), f64::from(samples));
    let expected = f64::from(samples) * number("production_sample_s") / number("cores");
    assert!((number("study_estimate_s") / expected - 1.0).abs() < 1e-12, "{report}");
}

#[test]
fn a_dry_run_shows_every_setting_and_needs_no_coordinator() {
    let folder = folder_with(STUDY);
    // Nothing listens there, and nothing is asked.
    let line = ["study", "submit", "study.toml", "--dry-run", "--coordinator", "http://127.0.0.1:1"];
    let report = json(&outcome(folder.path(), &[&line[..], &["--json"]].concat()));
    assert_eq!((&report["simulations"], &report["errors"]), (&literal!(61), &literal!([])));
    assert_eq!(report["settings"]["parameters"]["frequency_hz"], literal!([15.0, 40.0]));
    assert_eq!(report["settings"]["solver"]["blade_elements"], literal!(60.0));
    assert_eq!(report["settings"]["insect"]["wing_length_m"], literal!(0.0485));
    assert_eq!(report["study"]["surrogate"]["patience"], literal!(6));
    assert_estimate(&report, 60);

    let text = String::from_utf8(outcome(folder.path(), &line).stdout).unwrap();
    for words in
        ["would be accepted", "frequency_hz", "blade_elements", "wing_length_m", "61 simulations", "cores: 60 x"]
    {
        assert!(text.contains(words), "{words} in {text}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is stored");
}

#[test]
fn a_dry_run_refuses_what_the_coordinator_refuses() {
    let bad = STUDY.replace("samples = 60", "samples = 6").replace("neurons = 6", "neurons = 0");
    let collide = format!("{STUDY}\n[parameters]\nsweep_mean_deg = 60\nsweep_amplitude_deg = 90\n");
    for (study, told) in [
        (bad, &["/sampling/samples: 6 is outside", "/surrogate/neurons: 0 is outside"][..]),
        (collide, &["/parameters: too few strokes within these bounds"]),
    ] {
        let folder = folder_with(&study);
        let output = outcome(folder.path(), &["study", "submit", "study.toml", "--dry-run"]);
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert!(told.iter().all(|words| text.contains(words)), "{text}");
        assert!(output.stdout.is_empty());
    }
}

#[test]
fn the_bench_has_the_same_estimate_and_shows_memory_and_growth() {
    let folder = tempfile::tempdir().unwrap();
    let report = json(&outcome(folder.path(), &["bench", "solver", "--samples", "40", "--scaling", "--json"]));
    assert_estimate(&report, 40);
    if cfg!(target_os = "linux") {
        for flight in ["case_8x16", "production_sample"] {
            let peak = report["slot_peak_rss_mb"][flight].as_f64().unwrap();
            // A process that computes has a megabyte at the least, and this one is no large one.
            assert!((1.0..1000.0).contains(&peak), "{flight}: {peak} MB");
        }
    }
    let rows = report["scaling"].as_array().unwrap();
    let work = |i: usize| rows[i]["interactions"].as_f64().unwrap() / rows[0]["interactions"].as_f64().unwrap();
    assert_eq!(rows.len(), 8);
    assert!(rows.iter().all(|row| row["seconds"].as_f64().unwrap() > 0.0));
    assert!((2.0..3.0).contains(&work(3)), "twice the strokes: {}", work(3));
    // Of a wake as many strokes long: twice the rows as well.
    assert!((5.0..8.0).contains(&work(5)), "twice the steps: {}", work(5));
    assert!((1..8).all(|i| work(i) > 1.0) && work(7) > work(6));
}
