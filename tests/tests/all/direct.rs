//! A genetic algorithm whose fitness is flown, by workers which die.

use std::fs;

use manduca_tests::coordinator::Coordinator;
use manduca_tests::program::manduca;
use manduca_tests::studies::{blades, direct};
use manduca_tests::wait_for;
use serde_json::{Value, json};

/// What a study answers.
fn answer(coordinator: &Coordinator, id: &str) -> Value {
    coordinator.get(&format!("/v1/studies/{id}/optimum"))["optimisations"].clone()
}

/// Its simulations for one purpose.
fn jobs(coordinator: &Coordinator, id: &str, role: &str) -> Vec<Value> {
    coordinator.jobs(id).into_iter().filter(|job| job["role"] == role).collect()
}

/// Waits until so many strokes of generations are flown.
fn wait_for_individuals(coordinator: &Coordinator, id: &str, least: u64) {
    wait_for("individuals", || {
        let view = coordinator.study(id);
        assert_ne!(view["state"], "failed", "{view}");
        (view["progress"]["done"].as_u64()? >= least).then_some(())
    });
}

#[test]
fn generations_outlive_a_worker_and_the_coordinator_to_the_same_optimum() {
    let study = direct("direct", 17);
    let mut coordinator = Coordinator::start();
    let mut doomed = coordinator.worker("doomed");
    let id = coordinator.submit(&study);
    wait_for_individuals(&coordinator, &id, 3);
    coordinator.wait_for_lease("doomed");
    doomed.kill();
    let _survivor = coordinator.worker("survivor");
    wait_for_individuals(&coordinator, &id, 10);
    coordinator.kill();
    coordinator.restart();
    let view = coordinator.wait_until_succeeded(&id);
    assert!(view["samples"]["succeeded"] == 0 && view["stages_s"]["training"].is_null(), "{view}");
    let again = coordinator.jobs(&id).iter().filter(|job| job["attempt"].as_u64().unwrap() > 1).count();
    assert!((1..=2).contains(&again), "{again} jobs were computed again");

    let flown = jobs(&coordinator, &id, "individual");
    assert!(flown.len() <= 8 + 7 + 7 && flown.len() > 12, "{}", flown.len());
    assert_eq!(jobs(&coordinator, &id, "generation").len(), 4);
    let disturbed = answer(&coordinator, &id);
    let optimum = &disturbed[0];
    assert_eq!((&optimum["status"], optimum["breeding"]["standing"]["rounds"].as_u64()), (&json!("refined"), Some(3)));
    assert!(optimum["refined"]["standing"]["prices"]["lift"].is_number(), "{optimum}");
    assert!(optimum["predicted"]["power"].is_number() && optimum["simulated"]["power"]["mean"].is_number());

    let calm = Coordinator::start();
    let _worker = calm.worker("calm");
    let same = calm.submit(&study);
    calm.wait_until_succeeded(&same);
    assert_eq!(answer(&calm, &same), disturbed);

    // Asked for once more, every stroke is known: nothing at all is flown.
    let third = calm.submit(&study);
    calm.wait_until_succeeded(&third);
    assert_eq!(answer(&calm, &third), disturbed);
    for role in ["individual", "verify", "probe"] {
        assert!(jobs(&calm, &third, role).iter().all(|job| job["cached"] == true), "{role} is flown twice");
    }
}

/// Where a network and the simulation can be compared, they find the same.
#[test]
fn the_optimum_flown_is_that_of_the_surrogate() {
    let coordinator = Coordinator::start();
    let _worker = coordinator.worker("only");
    let mut study = blades("both", 3, 400);
    let five = direct("five", 3);
    study["parameters"] = five["parameters"].clone();
    study["surrogate"] = json!({ "neurons": 30, "max_iterations": 100 });
    let mut flown = five["optimisations"][0].clone();
    flown["population"] = json!(60);
    flown["generations"] = json!(20);
    flown["refine_simulations"] = json!(150);
    study["optimisations"] = json!([{ "name": "network", "starts": 50 }, flown]);
    let id = coordinator.submit(&study);
    coordinator.wait_until_succeeded(&id);
    let optima = answer(&coordinator, &id);
    let power = |i: usize| {
        let refined = &optima[i]["refined"];
        assert_eq!(refined["converged"], true, "{refined}");
        refined["standing"]["trimmed_power"].as_f64().unwrap()
    };
    assert!((power(0) / power(1) - 1.0).abs() < 2e-3, "{} {}", power(0), power(1));

    // And `report five` sets the two beside the paper's Table 4.
    let folder = tempfile::tempdir().unwrap();
    let output = ["--output", folder.path().to_str().unwrap(), "--coordinator", &coordinator.url()].map(str::to_owned);
    let told = manduca(&["report", "five", &id, &id]).args(&output).output().unwrap();
    assert_eq!(told.status.code(), Some(0), "{}", String::from_utf8_lossy(&told.stderr));
    let page = fs::read_to_string(folder.path().join("five.md")).unwrap();
    let milliwatts = |i: usize| format!("{:.2}", 84.2 * power(i));
    for part in [&milliwatts(0), &milliwatts(1), "paper, direct", "20 generations", "| network | samples | 400 |"] {
        assert!(page.contains(part), "{part} in {page}");
    }
    let none = manduca(&["report", "five", &id, "no-such-study"]).args(&output).output().unwrap();
    assert_eq!(none.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&none.stderr).contains("no-such-study"), "{none:?}");
}

#[test]
fn a_direct_search_is_run_added_and_estimated_from_the_command_line() {
    let folder = tempfile::tempdir().unwrap();
    let study = toml::to_string(&direct("tiny", 5)).unwrap();
    fs::write(folder.path().join("tiny.toml"), study).unwrap();
    let outcome = |arguments: &[&str]| {
        let output = manduca(arguments).current_dir(folder.path()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(0), "{said}");
        (String::from_utf8(output.stdout).unwrap(), said)
    };
    let (told, _) = outcome(&["study", "submit", "tiny.toml", "--dry-run", "--json"]);
    let told: Value = serde_json::from_str(&told).unwrap();
    assert_eq!((&told["simulations"], &told["study_individuals"]), (&json!(23), &json!(22)));
    let (told, said) = outcome(&["run", "tiny.toml", "--data", "store"]);
    for part in ["five-direct beside", "generations'", "3 generations", "refined by"] {
        assert!(told.contains(part), "{part} in {told}");
    }
    assert!(!told.contains("0 flown") && said.contains("optimising"), "{told}\n{said}");

    let coordinator = Coordinator::start();
    let _worker = coordinator.worker("only");
    let id = coordinator.submit(&direct("tiny", 5));
    coordinator.wait_until_succeeded(&id);
    let url = coordinator.url();
    let line = ["optimise", &id, "--name", "more", "--method", "direct", "--population", "6", "--generations", "2"];
    let (told, _) = outcome(&[&line[..], &["--wait", "--json", "--coordinator", &url]].concat());
    let told: Value = serde_json::from_str(&told).unwrap();
    assert_eq!(
        (&told["optimisations"][1]["name"], &told["optimisations"][1]["status"]),
        (&json!("more"), &json!("refined"))
    );
    assert_eq!(told["optimisations"][1]["breeding"]["standing"]["rounds"], 2);
    let (shown, _) = outcome(&["study", "show", &id, "--coordinator", &url]);
    assert!(shown.contains("more: 2 generations"), "{shown}");
}
