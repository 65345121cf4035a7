//! Faults of machines, disks and clocks, on real processes.
//!
//! The short form is part of every test run. `MANDUCA_FAULTS=long cargo test --release -p
//! manduca-tests faults` is the long one, whose figures are in docs/reliability.md.

#[cfg(target_os = "linux")]
#[path = "faults/clients.rs"]
mod clients;
#[path = "faults/network.rs"]
mod network;
#[path = "faults/pauses.rs"]
mod pauses;
#[path = "faults/strangers.rs"]
mod strangers;
#[path = "faults/workers.rs"]
mod workers;

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use manduca_tests::chance::Chance;
use manduca_tests::coordinator::Coordinator;
use manduca_tests::crowd::{Crowd, Ledger};
use manduca_tests::program::manduca;
use manduca_tests::shim::Shim;
use manduca_tests::studies::{blades, endless};
use manduca_tests::{is_long, wait_for};
use serde_json::{Value, json};

/// How often something is done, in the short and in the long form.
fn times(short: u64, long: u64) -> u64 {
    if is_long() { long } else { short }
}

/// The datasets of studies which one worker does and nobody disturbs.
fn undisturbed(studies: &[Value]) -> Vec<String> {
    let coordinator = Coordinator::start();
    let _worker = coordinator.worker("calm");
    let done = studies.iter().map(|study| {
        let id = coordinator.submit(study);
        coordinator.wait_until_succeeded(&id);
        coordinator.dataset(&id, "text/csv")
    });
    done.collect()
}

/// Every job has one end, and no sample has two results.
fn assert_once(coordinator: &Coordinator, id: &str) {
    let jobs = coordinator.jobs(id);
    let places: BTreeSet<_> = jobs.iter().map(|job| (job["role"].to_string(), job["ordinal"].as_u64())).collect();
    assert_eq!(places.len(), jobs.len(), "a job is listed twice");
    for job in &jobs {
        assert!(job["state"] == "succeeded" || job["state"] == "infeasible", "{job}");
    }
    let rows = coordinator.get(&format!("/v1/studies/{id}/dataset"));
    let rows = rows.as_array().unwrap();
    let distinct: BTreeSet<_> = rows.iter().map(|row| row["sample"].as_u64().unwrap()).collect();
    assert_eq!(distinct.len(), rows.len(), "a sample has two results");
}

/// Nothing acknowledged was lost, and the file is whole.
fn assert_kept(coordinator: &mut Coordinator, ledger: &Ledger) {
    assert_eq!(ledger.lost.len(), 0, "acknowledged results were asked for again: {:?}", ledger.lost);
    // All there are: a study whose submission was answered into the void has acknowledged results too.
    let page = coordinator.get("/v1/studies?limit=1000");
    let there: BTreeSet<_> = page["items"].as_array().unwrap().iter().map(|s| s["id"].as_str().unwrap()).collect();
    let missing: Vec<_> = ledger.studies.iter().filter(|id| !there.contains(id.as_str())).collect();
    assert!(missing.is_empty(), "acknowledged studies are not there: {missing:?}");
    let mut succeeded = BTreeSet::new();
    for id in there {
        let page = coordinator.get(&format!("/v1/studies/{id}/jobs?state=succeeded&limit=1000"));
        succeeded.extend(page["items"].as_array().unwrap().iter().filter_map(|job| job["id"].as_i64()));
    }
    let missing: Vec<_> = ledger.results.difference(&succeeded).collect();
    assert!(missing.is_empty(), "acknowledged results are not there: {missing:?}");
    coordinator.leave();
    let data = coordinator.folder().join("data");
    let checked = manduca(&["db", "check", "--data", data.to_str().unwrap()]).output().unwrap();
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stdout));
}

#[test]
fn a_coordinator_killed_at_random_times_loses_nothing_it_acknowledged() {
    let mut coordinator = Coordinator::start();
    let crowd = Crowd::start(&coordinator.url(), 8);
    let (mut chance, mut slowest) = (Chance::new(2024), Duration::ZERO);
    let kills = times(5, 200);
    for _ in 0..kills {
        let before = crowd.acknowledged();
        wait_for("work to go on", || (crowd.acknowledged() > before).then_some(()));
        std::thread::sleep(Duration::from_millis(chance.next() % 500));
        coordinator.kill();
        let down = Instant::now();
        coordinator.restart();
        slowest = slowest.max(down.elapsed());
    }
    let ledger = crowd.end();
    println!(
        "{kills} kills, {} studies and {} results acknowledged, serving again within {:.2} s",
        ledger.studies.len(),
        ledger.results.len(),
        slowest.as_secs_f64()
    );
    assert_kept(&mut coordinator, &ledger);
}

/// Works under a disk whose power is cut; gives the coordinator started on what the cut left.
fn after_power_cuts(cuts: u64, lying: bool) -> Option<(Coordinator, Ledger)> {
    let mut coordinator = Coordinator::start_with(|folder| Shim::new(&folder.join("data"), folder).environment(true));
    let shim = Shim::new(&coordinator.folder().join("data"), coordinator.folder());
    let (mut chance, mut base) = (Chance::new(7), std::collections::BTreeMap::new());
    let mut ledger = Ledger::default();
    for _ in 0..cuts {
        let crowd = Crowd::start(&coordinator.url(), 8);
        wait_for("some results", || (crowd.acknowledged() > 200).then_some(()));
        std::thread::sleep(Duration::from_millis(chance.next() % 300));
        coordinator.kill();
        let seen = crowd.end();
        ledger.results.extend(seen.results);
        ledger.studies.extend(seen.studies);
        ledger.lost.extend(seen.lost);
        shim.cut_power(std::mem::take(&mut base), lying, || chance.next() % 2 == 0);
        base = shim.base();
        if !coordinator.try_restart() {
            return None;
        }
    }
    Some((coordinator, ledger))
}

#[test]
fn a_power_cut_loses_nothing_acknowledged() {
    let cuts = times(3, 200);
    let (mut coordinator, ledger) = after_power_cuts(cuts, false).expect("it starts on what a power cut left");
    println!("{cuts} power cuts, {} results acknowledged", ledger.results.len());
    assert_kept(&mut coordinator, &ledger);
}

/// The counter-test: on a disk which does not sync (as with `synchronous=OFF`), the test above must see a loss.
#[test]
fn a_disk_which_lies_about_syncs_is_found_out() {
    let Some((coordinator, ledger)) = after_power_cuts(1, true) else { return };
    let known = coordinator.get("/v1/studies?limit=1000");
    let known = known["items"].as_array().map_or(0, Vec::len);
    assert!(known < ledger.studies.len(), "nothing was lost, so the test of power cuts shows nothing");
}

#[test]
fn a_full_disk_and_a_failing_sync_are_refusals_and_pass() {
    let coordinator = Coordinator::start_with(|folder| Shim::new(&folder.join("data"), folder).environment(false));
    let shim = Shim::new(&coordinator.folder().join("data"), coordinator.folder());
    let first = coordinator.submit(&blades("before", 1, 30));
    for (i, order) in ["full", "sync"].into_iter().enumerate() {
        shim.set(order);
        let study = blades("during", 10 + i as u64, 30);
        for _ in 0..3 {
            let refused = coordinator.post("/v1/studies", &study);
            assert_eq!(refused.status, 503, "{order}: {}", refused.body);
            assert_eq!(refused.json()["type"], "urn:manduca:problem:unavailable");
            assert!(!refused.header("retry-after").is_empty());
        }
        assert_eq!(coordinator.ask("/readyz").status, 503);
        assert_eq!(coordinator.ask("/healthz").status, 200);
        assert_eq!(coordinator.study(&first)["state"], "sampling", "what is there can be read");
        let listed = coordinator.get("/v1/studies");
        assert_eq!(listed["items"].as_array().unwrap().len(), 1 + i, "a refused study is not there");
        shim.set("");
        wait_for("a coordinator which takes writes again", || (coordinator.ask("/readyz").status == 200).then_some(()));
        coordinator.submit(&study);
    }
    let mut coordinator = coordinator;
    coordinator.restart();
    assert_eq!(coordinator.get("/v1/studies")["items"].as_array().unwrap().len(), 3);
    assert_kept(&mut coordinator, &Ledger::default());
}

#[test]
fn steps_of_the_wall_clock_end_no_lease() {
    let coordinator = Coordinator::start_with(|folder| Shim::new(&folder.join("data"), folder).environment(false));
    let shim = Shim::new(&coordinator.folder().join("data"), coordinator.folder());
    let id = coordinator.submit(&endless("clock"));
    let _worker = coordinator.worker("steady");
    coordinator.wait_for_lease("steady");
    for order in ["clock 600", "clock -600", "clock 3600", ""] {
        shim.set(order);
        std::thread::sleep(Duration::from_millis(times(1500, 20_000)));
        let worker = coordinator.worker_view("steady").unwrap();
        assert!(worker["alive"] == true && worker["last_seen_s"].as_f64().unwrap() < 60.0, "{order}: {worker}");
        let leased: Vec<_> = coordinator.jobs(&id).into_iter().filter(|job| job["state"] == "leased").collect();
        assert!(leased.len() == 1 && leased[0]["attempt"] == 1, "{order}: {leased:?}");
        let told = coordinator.get(&format!("/v1/jobs/{}/explain", leased[0]["id"]));
        let lease = &told["lease"];
        assert!(lease["expires_s"].as_f64().unwrap() <= 15.0 && lease["running_s"].as_f64().unwrap() < 300.0, "{told}");
    }
}

#[test]
fn an_endless_job_is_given_up_and_its_worker_lives_on() {
    let coordinator = Coordinator::start_serving(&["--run-limit", "0.3"]);
    // Its strokes never settle as asked, which nobody can know before they are flown.
    let mut study = endless("poison");
    study["model"] = json!({ "solver": {
        "chordwise_panels": 4, "spanwise_panels": 6, "steps_per_stroke": 100, "wake_strokes": 0.5,
        "strokes": 4, "strokes_dropped": 1, "strokes_most": 400, "standard_error": 1e-12,
    }});
    let id = coordinator.submit(&study);
    let _worker = coordinator.worker("patient");
    let failed = wait_for("attempts which fail", || {
        let jobs = coordinator.jobs(&id);
        let failed: Vec<_> = jobs.into_iter().filter(|job| !job["reason"].is_null()).collect();
        (failed.len() >= 8).then_some(failed)
    });
    for job in failed {
        assert!(job["reason"].as_str().unwrap().contains("run limit of 0.3 s"), "{job}");
    }
    // The tasks are to blame, and another study goes on.
    let worker = coordinator.worker_view("patient").expect("it is there");
    assert_eq!((&worker["quarantined"], &worker["strikes"]), (&json!(false), &json!(0)), "{worker}");
    let innocent = coordinator.submit(&blades("innocent", 7, 20));
    coordinator.wait_for_samples(&innocent, 20);
}
