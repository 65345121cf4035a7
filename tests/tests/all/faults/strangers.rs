//! A proxy which answers in the coordinator's place for a while.

use std::thread::sleep;
use std::time::Duration;

use manduca_tests::coordinator::Coordinator;
use manduca_tests::proxy::{Proxy, Weather, strangers};
use manduca_tests::studies::lattice;
use manduca_tests::wait_for;
use serde_json::json;

use super::{assert_once, times, undisturbed};

#[test]
fn answers_of_others_lose_no_result_and_end_no_worker() {
    let coordinator = Coordinator::start();
    let proxy = Proxy::start(&coordinator.url(), 6, Weather::CALM);
    // A worker which begins while something else answers waits until it is the coordinator.
    proxy.answer(Some(strangers().remove(0).1));
    let mut workers = [0, 1].map(|i| coordinator.worker_by(&proxy.url(), &format!("far-{i}")));
    wait_for("both to have asked", || (proxy.intercepted() >= 6).then_some(()));
    proxy.answer(None);

    let study = lattice("strangers", 61, u32::try_from(times(200, 2000)).unwrap());
    let id = coordinator.submit(&study);
    let mut met = Vec::new();
    for (name, answer) in strangers() {
        let before = coordinator.study(&id)["samples"]["succeeded"].as_u64().unwrap();
        wait_for("results", || (coordinator.study(&id)["samples"]["succeeded"].as_u64()? > before).then_some(()));
        if coordinator.study(&id)["state"] != "sampling" {
            break;
        }
        let calls = proxy.intercepted();
        proxy.answer(Some(answer));
        sleep(Duration::from_secs(times(1, 5)));
        wait_for("calls which others answer", || (proxy.intercepted() > calls + 2).then_some(()));
        proxy.answer(None);
        met.push(name);
        for worker in &mut workers {
            assert!(worker.ended().is_none(), "a worker ended by {name}: {}", worker.said());
        }
    }
    assert!(met.len() >= 8, "the study ended too early to show much: {met:?}");
    coordinator.wait_until_succeeded(&id);
    println!("{} calls answered by others: {met:?}; nothing lost", proxy.intercepted());
    for job in coordinator.jobs(&id) {
        assert_eq!(job["attempt"], 1, "{job}");
    }
    assert_once(&coordinator, &id);
    assert_eq!(coordinator.get("/v1/evidence"), json!([]));
    assert_eq!([coordinator.dataset(&id, "text/csv")], *undisturbed(&[study]));
    for worker in &mut workers {
        worker.terminate();
        assert_eq!(worker.exit_code(), Some(0));
        let said = worker.said();
        assert!(said.contains("0 attempts failed, 0 results refused") && said.contains("not from a manduca"), "{said}");
        assert!(!said.contains("lost"), "{said}");
    }
}
