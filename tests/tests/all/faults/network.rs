//! A network which loses answers, repeats and delays requests, and is cut for a while.

use std::thread::sleep;
use std::time::{Duration, Instant};

use manduca_tests::coordinator::Coordinator;
use manduca_tests::proxy::{Proxy, Weather};
use manduca_tests::studies::lattice;
use manduca_tests::wait_for;
use serde_json::json;

use super::{assert_once, times, undisturbed};

/// Samples which have a result.
fn flown(coordinator: &Coordinator, id: &str) -> u64 {
    coordinator.study(id)["samples"]["succeeded"].as_u64().unwrap()
}

#[test]
fn a_bad_network_loses_and_repeats_nothing() {
    let (lease, cut) = (times(2, 15), times(4, 60));
    let coordinator = Coordinator::start_serving(&["--lease", &lease.to_string()]);
    let delay = Duration::from_secs(times(1, 30));
    let proxy = Proxy::start(&coordinator.url(), 5, Weather { lost: 20, repeated: 10, delayed: 10, delay });
    let samples = u32::try_from(times(60, 300)).unwrap();
    let study = lattice("storm", 31, samples);
    let id = coordinator.submit(&study);
    let workers = [0, 1].map(|i| coordinator.worker_by(&proxy.url(), &format!("far-{i}")));
    coordinator.wait_for_samples(&id, u64::from(samples / 3));

    proxy.cut(true);
    let before = flown(&coordinator, &id);
    sleep(Duration::from_secs(cut));
    let during = flown(&coordinator, &id);
    // Requests which had passed before the cut may still be answered; nothing is got through it.
    assert!(during - before <= 4, "the line was not cut: {before} results became {during}");
    proxy.cut(false);
    let healed = Instant::now();
    wait_for("results after the cut", || (flown(&coordinator, &id) > during).then_some(()));
    let recovered = healed.elapsed();

    coordinator.wait_until_succeeded(&id);
    let done = proxy.done();
    println!(
        "{} calls: {} answers lost, {} repeated, {} delayed by up to {} s; cut for {cut} s, the next result {:.2} s after",
        done.calls,
        done.lost,
        done.repeated,
        done.delayed,
        delay.as_secs(),
        recovered.as_secs_f64()
    );
    assert!(done.lost > 0 && done.repeated > 0 && done.delayed > 0, "{done:?}");
    assert_once(&coordinator, &id);
    assert_eq!(coordinator.get("/v1/evidence?class=nondeterminism"), json!([]));
    assert_eq!([coordinator.dataset(&id, "text/csv")], *undisturbed(&[study]));
    drop(workers);
}
