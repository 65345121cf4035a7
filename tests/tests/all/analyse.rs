//! What a study's surrogate is asked from the command line.

use manduca_tests::coordinator::Coordinator;
use manduca_tests::program::manduca;
use manduca_tests::studies::blades;
use serde_json::{Value, json};

/// Exit code, answer, and what was said beside it.
fn outcome(coordinator: &Coordinator, line: &str) -> (Option<i32>, String, String) {
    let url = coordinator.url();
    let arguments: Vec<&str> = line.split(' ').chain(["--coordinator", &url]).collect();
    let output = manduca(&arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code(), text(output.stdout), text(output.stderr))
}

fn analyse(coordinator: &Coordinator, line: &str) -> String {
    let (code, told, said) = outcome(coordinator, &format!("analyse {line}"));
    assert_eq!(code, Some(0), "{said}");
    told
}

/// The rows of an answer.
fn rows(coordinator: &Coordinator, line: &str) -> Vec<Value> {
    let answer: Value = serde_json::from_str(&analyse(coordinator, &format!("{line} --json"))).unwrap();
    answer["rows"].as_array().unwrap().clone()
}

fn number(row: &Value, name: &str) -> f64 {
    row[name].as_f64().unwrap_or_else(|| panic!("no {name} in {row}"))
}

/// A study whose surrogate knows strokes in trim.
fn study() -> Value {
    let mut study = blades("analysed", 3, 400);
    study["parameters"] = json!({
        "stroke_plane_deg": 0.0, "elevation_mean_deg": 0.0, "elevation_amplitude_deg": 0.0,
        "sweep_shape": 0.0, "rotation_shape": 0.0,
    });
    study["surrogate"] = json!({ "neurons": 30, "max_iterations": 100 });
    study["optimisations"] = json!([{ "name": "network", "starts": 50, "refine_simulations": 0 }]);
    study
}

#[test]
fn a_finished_studys_surrogate_answers_for_its_optimum() {
    let coordinator = Coordinator::start();
    let _worker = coordinator.worker("only");
    let id = coordinator.submit(&study());
    let (code, _, said) = outcome(&coordinator, "analyse sobol latest");
    assert!(code == Some(2) && said.contains("no network yet"), "{code:?} {said}");
    coordinator.wait_until_succeeded(&id);
    let optimum = coordinator.get(&format!("/v1/studies/{id}/optimum"))["optimisations"][0].clone();
    let (least, here) = (number(&optimum["predicted"], "power"), number(&optimum["parameters"], "frequency_hz"));

    // At the optimum's own value a bound costs nothing, beyond it more and more.
    let limits: Vec<String> = [0.0, 0.4, 0.8].map(|more| (here + more).to_string()).into();
    let line = format!("front latest --optimisation network --quantity frequency-hz --limits {}", limits.join(","));
    let front = rows(&coordinator, &line);
    let powers: Vec<f64> = front.iter().map(|row| number(row, "power")).collect();
    assert!((powers[0] - least).abs() < 1e-6 && powers[0] < powers[1] && powers[1] < powers[2], "{powers:?} {least}");
    assert!((number(&front[2], "frequency_hz") - here - 0.8).abs() < 1e-6 && front[2]["side"] == "at-least");
    // The price is the slope of the front.
    let slope = (powers[2] - powers[1]) / 0.4;
    let (low, high) = (number(&front[1], "price"), number(&front[2], "price"));
    assert!(low <= slope * 1.02 && slope <= high * 1.02 && low > 0.0, "{low} {slope} {high}");

    let csv = analyse(&coordinator, &format!("{line} --csv"));
    let mut lines = csv.lines();
    assert!(lines.next().unwrap().starts_with("limit,side,power,power_w,price,frequency_hz,"), "{csv}");
    assert_eq!(lines.nth(1).unwrap().split(',').nth(2).unwrap().parse::<f64>().unwrap(), powers[1]);

    let indices = rows(&coordinator, "sobol latest --base 2048");
    let of = |name: &str| indices.iter().find(|row| row["parameter"] == name).unwrap().clone();
    assert_eq!(number(&of("stroke_plane_deg"), "total_power"), 0.0);
    assert!(number(&of("frequency_hz"), "total_power") > 0.2, "{indices:?}");
    assert_eq!(indices, rows(&coordinator, &format!("sobol {id} --base 2048 --seed 3")));

    let swept = rows(&coordinator, "sweep latest --weights 5,50 --population 300 --generations 60");
    assert!(swept.iter().all(|row| number(row, "above_the_optimum") > -1e-6), "{swept:?}");
    let bred = rows(&coordinator, "population latest --populations 50,1000 --runs 2 --generations 60");
    assert!(number(&bred[1], "least") <= number(&bred[1], "seed_4") && number(&bred[1], "mean") >= least - 1e-6);
    assert!(number(&bred[1], "mean") < number(&bred[0], "mean"), "{bred:?}");

    for (line, told) in [
        ("front latest --quantity stroke_plane_deg", "is held at 0"),
        ("front latest --quantity frequency_hz --limits 10", "outside 15 to 40"),
        ("sobol latest --optimisation other", "no optimisation `other`"),
    ] {
        let (code, _, said) = outcome(&coordinator, &format!("analyse {line}"));
        assert!(code == Some(2) && said.contains(told), "{line}: {code:?} {said}");
    }
}

/// Trained, searched, refined and asked like networks.
#[test]
fn a_gaussian_process_takes_the_place_of_networks() {
    let coordinator = Coordinator::start();
    let _worker = coordinator.worker("only");
    let mut study = study();
    study["sampling"] = json!({ "samples": 200 });
    study["surrogate"] = json!({ "kind": "gaussian-process" });
    study["optimisations"][0]["refine_simulations"] = json!(60);
    let id = coordinator.submit(&study);
    let view = coordinator.wait_until_succeeded(&id);
    assert!(view["surrogate"]["rmse"]["lift"].as_f64().unwrap() < 0.02, "{view}");
    let surrogate = coordinator.get(&format!("/v1/studies/{id}/surrogate"));
    assert_eq!((&surrogate["kind"], &surrogate["neurons"]), (&json!("gaussian-process"), &json!(0)));
    assert_eq!((surrogate["stops"].as_array().unwrap().len(), &surrogate["curve"]), (4, &json!([])));
    let model = coordinator.get(&format!("/v1/studies/{id}/surrogate/model"));
    assert!(model["process"]["points"].as_array().unwrap().len() == 180 && model["networks"].is_null());

    let optimum = coordinator.get(&format!("/v1/studies/{id}/optimum"))["optimisations"][0].clone();
    assert_eq!((&optimum["status"], &optimum["refined"]["converged"]), (&json!("refined"), &json!(true)), "{optimum}");
    let asked = json!({ "points": [optimum["parameters"]] });
    let told = coordinator.post(&format!("/v1/studies/{id}/surrogate/predictions"), &asked).expect(200);
    assert_eq!(told["predictions"][0], optimum["predicted"]);
    let front = rows(&coordinator, "front latest --quantity frequency_hz --limits 30,32");
    assert!(number(&front[0], "power") < number(&front[1], "power"), "{front:?}");
}
