//! Whom and what the coordinator stops trusting: endless attempts, broken
//! machines, results which are not reproduced.

use serde_json::{Value, json};

use super::answers::{completion, flown, result, study};
use super::bench::Bench;

#[tokio::test]
async fn an_attempt_beyond_its_run_limit_fails_however_often_it_is_renewed() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    let worker = bench.worker("stuck").await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    assert_eq!(lease.run_limit_s, 600.0);
    let renewal = json!({ "renew": [{ "job": lease.job, "attempt": 1 }] });
    for _ in 0..62 {
        bench.pass(10.0).await;
        assert!(bench.exchange(&worker, renewal.clone()).await.cancel.is_empty());
    }
    bench.pass(10.0).await;
    assert_eq!(bench.exchange(&worker, renewal).await.cancel, [lease.job]);
    let view = bench.get(&format!("/v1/jobs/{}", lease.job)).await.json();
    assert_eq!(view["state"], "delayed");
    assert!(view["reason"].as_str().is_some_and(|r| r.contains("run limit of 600 s")), "{view}");
    bench.check_counts().await;
}

async fn seen(bench: &Bench, name: &str) -> Value {
    let workers = bench.get("/v1/workers").await.json();
    workers.as_array().and_then(|all| all.iter().find(|w| w["name"] == name).cloned()).expect("is listed")
}

#[tokio::test]
async fn five_failures_in_a_row_set_a_worker_aside_and_a_success_clears_it() {
    let bench = Bench::open().await;
    bench.submit(&study(40, &[])).await;
    let worker = bench.worker("broken").await;
    let leases = bench.claim(&worker, 12).await;
    for lease in &leases[..4] {
        bench.fail(&worker, lease, "no numbers").await;
    }
    bench.complete(&worker, &leases[4], result(&leases[4])).await;
    assert_eq!(seen(&bench, "broken").await["strikes"], 0);
    // What cannot be used counts as a failure, a number which is none with it.
    let mut unusable = flown(1.0);
    unusable["solver_version"] = json!("0");
    bench.complete(&worker, &leases[5], unusable).await;
    for lease in &leases[6..10] {
        assert_eq!(seen(&bench, "broken").await["quarantined"], false);
        bench.fail(&worker, lease, "no numbers").await;
    }
    assert_eq!(seen(&bench, "broken").await["quarantined"], true);
    assert!(bench.claim(&worker, 1).await.is_empty());
    let other = bench.worker("sound").await;
    assert_eq!(bench.claim(&other, 1).await.len(), 1, "others go on");
    // What it still has is taken, but it waits out its time.
    bench.fail(&worker, &leases[10], "no numbers").await;
    bench.pass(301.0).await;
    // A job which it failed before counts once.
    let again = bench.claim(&worker, 20).await;
    assert!(again.iter().any(|lease| lease.job == leases[0].job));
    let other = again.iter().find(|lease| lease.attempt == 1).expect("a job nobody has failed");
    bench.fail(&worker, other, "no numbers").await;
    assert!(bench.claim(&worker, 1).await.is_empty(), "one more failure is enough then");
    bench.pass(301.0).await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    bench.complete(&worker, &lease, result(&lease)).await;
    assert_eq!(seen(&bench, "broken").await["strikes"], 0);
    assert_eq!(seen(&bench, "broken").await["failed"], 11);
}

#[tokio::test]
async fn a_drained_worker_is_told_even_while_it_waits_and_gets_nothing_more() {
    let bench = Bench::open().await;
    let worker = bench.worker("leaving").await;
    let waits = bench.exchange(&worker, json!({ "want": 1, "wait_s": 30 }));
    let drain = async {
        tokio::time::sleep(std::time::Duration::from_millis(50)).await;
        bench.post(&format!("{worker}/drain"), "").await
    };
    let (told, asked) = tokio::join!(waits, drain);
    assert_eq!(asked.status, 202);
    assert!(told.drain && told.jobs.is_empty());
    bench.submit(&study(20, &[])).await;
    let told = bench.exchange(&worker, json!({ "want": 1 })).await;
    assert!(told.drain && told.jobs.is_empty());
    assert_eq!(seen(&bench, "leaving").await["draining"], true);
    bench.delete(&worker).await;
    bench.post(&format!("{worker}/drain"), "").await.problem(404, "unknown-worker");
}

fn audited(share: f64) -> Value {
    let mut study = study(20, &[]);
    study["audit"] = json!(share);
    study
}

#[tokio::test]
async fn audits_are_flown_by_another_worker_and_do_not_hold_a_study_up() {
    let bench = Bench::open().await;
    let study = bench.submit(&audited(1.0)).await;
    let first = bench.worker("first").await;
    assert_eq!(bench.work_off(&first).await, 21, "20 samples and the training; not its own audits");
    let view = bench.view(&study).await;
    assert_eq!((view["state"].as_str(), view["audits"]["ready"].as_u64()), (Some("succeeded"), Some(20)));
    let second = bench.worker("second").await;
    let leases = bench.claim(&second, 100).await;
    assert_eq!(leases.len(), 20);
    let (agreeing, differing) = leases.split_at(18);
    let mut results: Vec<_> = agreeing.iter().map(|l| completion(l, result(l))).collect();
    results.push(completion(&differing[0], flown(-1.0)));
    let mut elsewhere = completion(&differing[1], flown(-2.0));
    elsewhere["provenance"]["level"] = json!("another level");
    results.push(elsewhere);
    let told = bench.exchange(&second, json!({ "complete": results })).await;
    assert_eq!(told.accepted.len(), 20, "an audit's own result is no fault: {:?}", told.rejected);
    assert_eq!((bench.evidence("nondeterminism").await, bench.evidence("refused").await), (1, 1));
    assert_eq!(bench.view(&study).await["audits"]["succeeded"], 20);
    let rows = bench.get(&format!("{study}/dataset")).await.json();
    assert_eq!(rows.as_array().map(Vec::len), Some(20), "the dataset is the samples'");
    bench.check_counts().await;
}

#[tokio::test]
async fn a_study_which_asks_for_none_has_no_audits_and_a_share_beyond_all_is_refused() {
    let bench = Bench::open().await;
    let study = bench.submit(&audited(0.0)).await;
    bench.work_off(&bench.worker("w").await).await;
    assert_eq!(bench.view(&study).await["audits"]["ready"], 0);
    let refused = bench.post("/v1/studies", audited(1.5).to_string()).await;
    assert_eq!(refused.problem(422, "invalid-study"), ["/audit"]);
}
