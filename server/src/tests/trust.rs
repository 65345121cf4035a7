//! Whom and what the coordinator stops trusting: endless attempts, broken
//! machines, results which are not reproduced.

use serde_json::{Value, json};
use sqlx::ConnectOptions;
use sqlx::sqlite::SqliteConnectOptions;

use super::answers::{completion, flown, result, study};
use super::bench::Bench;
use crate::Offline;

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

/// Gives a worker another token than it registered with.
async fn with_token(bench: &Bench, name: &str, token: &str) {
    change(bench, &format!("update workers set token = '{token}' where name = '{name}'")).await;
}

/// Changes the database beside the coordinator.
async fn change(bench: &Bench, statement: &str) {
    let options = SqliteConnectOptions::new().filename(bench.database());
    let mut database = options.connect().await.expect("opens beside the coordinator");
    sqlx::query(sqlx::AssertSqlSafe(statement.to_owned())).execute(&mut database).await.expect("changes");
}

#[tokio::test]
async fn audits_are_flown_by_another_worker_before_anything_is_learnt() {
    let bench = Bench::open().await;
    let study = bench.submit(&audited(1.0)).await;
    let (first, second) = (bench.worker("first").await, bench.worker("second").await);
    assert_eq!(bench.work_off(&first).await, 20, "not its own audits while another worker is there");
    let view = bench.view(&study).await;
    assert_eq!((view["state"].as_str(), view["audits"]["ready"].as_u64()), (Some("sampling"), Some(20)));
    let leases = bench.claim(&second, 5).await;
    assert_eq!(leases.len(), 5);
    let results: Vec<_> = leases.iter().map(|l| completion(l, result(l))).collect();
    bench.exchange(&second, json!({ "complete": results })).await;
    assert_eq!(bench.view(&study).await["audit_verdicts"]["not_independent"], 5);
    // With a third token about, only that one audits the rest.
    let third = bench.worker("third").await;
    with_token(&bench, "third", "elsewhere").await;
    assert!(bench.claim(&second, 5).await.is_empty());
    assert_eq!(bench.claim(&third, 5).await.len(), 5);
    bench.delete(&third).await;
    bench.delete(&second).await;
    // Nobody else is left: it does all the rest, that no study waits for ever.
    assert_eq!(bench.work_off(&first).await, 15 + 1, "the other audits and the training");
    let view = bench.view(&study).await;
    assert_eq!((view["state"].as_str(), view["audits"]["succeeded"].as_u64()), (Some("succeeded"), Some(20)));
    assert_eq!(
        view["audit_verdicts"],
        json!({ "independent": 0, "not_independent": 20, "disputed": 0, "undecided": 0 })
    );
    let rows = bench.get(&format!("{study}/dataset")).await.json();
    assert_eq!(rows.as_array().map(Vec::len), Some(20), "the dataset is the samples'");
    bench.check_counts().await;
}

#[tokio::test]
async fn cached_samples_are_audited_like_flown_ones() {
    let bench = Bench::open().await;
    let first = bench.worker("first").await;
    bench.submit(&study(20, &[])).await;
    bench.work_off(&first).await;
    let shared = bench.submit(&audited(1.0)).await;
    let view = bench.view(&shared).await;
    assert_eq!((view["state"].as_str(), view["samples"]["succeeded"].as_u64()), (Some("sampling"), Some(20)));
    let second = bench.worker("second").await;
    with_token(&bench, "second", "elsewhere").await;
    assert_eq!(bench.work_off(&second).await, 20 + 1);
    assert_eq!(bench.view(&shared).await["audit_verdicts"]["independent"], 20);
    bench.check_counts().await;
}

#[tokio::test]
async fn a_worker_set_aside_stays_so_until_it_is_readmitted() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    let worker = bench.worker("node").await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    assert_eq!(bench.post(&format!("{worker}/disown"), "").await.status, 204);
    let told = bench.complete(&worker, &lease, result(&lease)).await;
    assert_eq!(told.rejected.len(), 1, "its lease was taken away");
    let again = bench.worker("node").await;
    for worker in [&worker, &again] {
        assert!(bench.claim(worker, 1).await.is_empty());
    }
    let told = bench.get(&format!("/v1/jobs/{}/explain", lease.job)).await.json();
    assert!(told["because"].to_string().contains("set aside for wrong results until"), "{told}");
    assert_eq!(bench.claim(&bench.worker("other").await, 1).await.len(), 1);
    assert_eq!(bench.post(&format!("{again}/readmit"), "").await.status, 204);
    for worker in [&worker, &again] {
        assert_eq!(bench.claim(worker, 1).await.len(), 1);
    }
    let nobody = "/v1/workers/01920000-0000-7000-8000-000000000000";
    for verb in ["disown", "readmit"] {
        bench.post(&format!("{nobody}/{verb}"), "").await.problem(404, "unknown-worker");
    }
}

#[tokio::test]
async fn disowned_results_are_dropped_or_marked_and_shared_no_more() {
    let bench = Bench::open().await;
    let (liar, honest) = (bench.worker("liar").await, bench.worker("honest").await);
    let ended = bench.submit(&study(20, &[])).await;
    bench.work_off(&liar).await;
    let rows = bench.get(&format!("{ended}/dataset")).await.body;
    // Shares the first 20, and samples still.
    let running = bench.submit(&study(25, &[])).await;
    let leases = bench.claim(&liar, 3).await;
    for lease in &leases[..2] {
        bench.complete(&liar, lease, result(lease)).await;
    }
    assert_eq!(bench.view(&running).await["samples"]["succeeded"], 22);
    bench.post(&format!("{liar}/disown"), "").await;
    let view = bench.view(&running).await;
    assert_eq!((&view["samples"]["ready"], &view["state"]), (&json!(25), &json!("sampling")));
    assert_eq!((&view["distrusted"][0]["replaced"], view.get("disowned_results")), (&json!(22), None));
    let view = bench.view(&ended).await;
    assert_eq!((&view["state"], &view["disowned_results"]), (&json!("succeeded"), &json!(21)), "the training too");
    assert_eq!(bench.get(&format!("{ended}/surrogate")).await.json()["disowned_results"], 21);
    assert_eq!(bench.get(&format!("{ended}/optimum")).await.json()["disowned_results"], 21);
    assert_eq!(bench.get(&format!("{ended}/dataset")).await.body, rows, "it stays readable");
    let again = bench.submit(&study(20, &[])).await;
    assert_eq!(bench.view(&again).await["samples"]["succeeded"], 0, "nothing is shared");
    assert_eq!(bench.work_off(&honest).await, 25 + 20 + 2);
    for study in [&running, &again] {
        assert_eq!(bench.view(study).await["state"], "succeeded");
    }
    bench.post(&format!("{liar}/disown"), "").await;
    assert_eq!(bench.view(&ended).await["disowned_results"], 21, "twice is as good as once");
    bench.check_counts().await;
    let mut database = Offline::open(&bench.database()).await.expect("opens");
    assert!(database.check().await.expect("reads").is_well());
    assert!(database.disown("nobody").await.is_err());
    assert_eq!(database.disown("honest").await.expect("is known").len(), 1);
    assert_eq!(bench.view(&again).await["disowned_results"], 21);
}

#[tokio::test]
async fn a_result_handed_on_to_another_study_is_kept_there_alone() {
    let bench = Bench::open().await;
    let (liar, honest) = (bench.worker("liar").await, bench.worker("honest").await);
    // The larger study flies, the smaller one shares and goes on to its training.
    let running = bench.submit(&study(25, &[])).await;
    let leases = bench.claim(&liar, 20).await;
    let results: Vec<_> = leases.iter().map(|lease| completion(lease, result(lease))).collect();
    bench.exchange(&liar, json!({ "complete": results })).await;
    let trained = bench.submit(&study(20, &[])).await;
    assert_eq!(bench.view(&trained).await["state"], "training");
    let rows = bench.get(&format!("{trained}/dataset")).await.body;
    bench.post(&format!("{liar}/disown"), "").await;
    assert_eq!(bench.view(&running).await["samples"]["ready"], 25);
    assert_eq!(bench.view(&trained).await["disowned_results"], 20);
    assert_eq!(bench.get(&format!("{trained}/dataset")).await.body, rows);
    bench.work_off(&honest).await;
    let mut database = Offline::open(&bench.database()).await.expect("opens");
    let findings = database.check().await.expect("reads");
    assert!(findings.is_well(), "{findings:?}");
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
