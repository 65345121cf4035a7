//! A coordinator which is stopped for longer than a lease and goes on.

use std::thread::sleep;
use std::time::Duration;

use manduca_tests::coordinator::Coordinator;
use manduca_tests::studies::endless;
use manduca_tests::{is_long, wait_for};
use serde_json::Value;

use super::times;

/// The jobs under way, by the names of their workers.
fn held(coordinator: &Coordinator, id: &str, names: &[&str]) -> Vec<(Value, Value)> {
    let jobs = names.iter().flat_map(|name| coordinator.held_by(id, name));
    jobs.map(|job| (job["id"].clone(), job["attempt"].clone())).collect()
}

#[test]
fn a_stopped_coordinator_ends_no_lease_of_a_live_worker() {
    let lease = times(4, 15);
    let coordinator = Coordinator::start_serving(&["--lease", &lease.to_string()]);
    let id = coordinator.submit(&endless("paused"));
    let names = ["steady-0", "steady-1"];
    let mut workers = names.map(|name| coordinator.worker(name));
    names.iter().for_each(|name| coordinator.wait_for_lease(name));
    let before = held(&coordinator, &id, &names);
    assert_eq!(before.len(), 2);
    for pause in if is_long() { [20, 60] } else { [6, 12] } {
        coordinator.pause();
        sleep(Duration::from_secs(pause));
        coordinator.resume();
        // Longer than a lease: what had run out by then would be given away.
        sleep(Duration::from_secs(lease + 1));
        assert_eq!(held(&coordinator, &id, &names), before, "after {pause} s: {}", coordinator.said());
        for worker in &workers {
            assert!(!worker.said().contains("job taken away"), "{}", worker.said());
        }
    }
    assert!(coordinator.said().contains("No renewals could be taken for a while"), "{}", coordinator.said());

    // What a worker had which is gone is free for others all the same.
    coordinator.pause();
    workers[0].kill();
    sleep(Duration::from_secs(lease + 2));
    coordinator.resume();
    wait_for("the job of the dead worker to be free", || {
        let job = coordinator.get(&format!("/v1/jobs/{}", before[0].0));
        (job["state"] == "ready").then_some(())
    });
}
