//! A clock far ahead removes nothing.

use manduca_tests::coordinator::Coordinator;
use manduca_tests::program::manduca;
use manduca_tests::shim::Shim;
use manduca_tests::studies::blades;
use manduca_tests::wait_for;

use super::stderr;

#[test]
fn a_clock_far_ahead_removes_nothing() {
    let shim = |folder: &std::path::Path| Shim::new(&folder.join("data"), folder);
    let mut coordinator =
        Coordinator::start_serving_with(&["--keep-days", "90"], |folder| shim(folder).environment(false));
    let shim = Shim::new(&coordinator.folder().join("data"), coordinator.folder());
    let id = coordinator.submit(&blades("kept", 1, 30));
    coordinator.steer(&id, "cancel");
    coordinator.kill();
    shim.set("clock 34560000");
    coordinator.restart();
    wait_for("a word about the clock", || coordinator.said().contains("No study is removed").then_some(()));
    assert_eq!(coordinator.study(&id)["state"], "cancelled");
    // By hand it asks, too.
    let data = coordinator.data();
    let prune = |more: &[&str]| {
        let arguments = [&["db", "prune", "--older-than-days", "90", "--data", &data][..], more].concat();
        manduca(&arguments).envs(shim.environment(false)).output().unwrap()
    };
    let refused = prune(&[]);
    assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
    assert!(stderr(&refused).contains("--force"), "{}", stderr(&refused));
    let counted = String::from_utf8(prune(&["--dry-run"]).stdout).unwrap();
    assert!(counted.contains("1 study with 30 jobs would be removed"), "{counted}");
    assert_eq!(coordinator.study(&id)["state"], "cancelled");
    // The right time again: all goes on as if nothing had been, and nothing is old enough.
    coordinator.kill();
    shim.set("");
    coordinator.restart();
    assert_eq!(coordinator.study(&id)["state"], "cancelled");
    assert!(!coordinator.said().contains("No study is removed"), "{}", coordinator.said());
    shim.set("clock 34560000");
    let forced = prune(&["--force"]);
    assert!(forced.status.success(), "{}", stderr(&forced));
    assert_eq!(coordinator.ask(&format!("/v1/studies/{id}")).status, 404);
}
