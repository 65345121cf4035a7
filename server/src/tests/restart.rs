//! The coordinator stops and starts.

use std::time::Duration;

use manduca_numerics::simulation::SOLVER_VERSION;
use serde_json::{Value, json};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, SqliteConnection};

use super::answers::{result, study};
use super::bench::Bench;

#[tokio::test]
async fn leases_have_a_full_new_term_after_a_restart() {
    let bench = Bench::open().await;
    let study = bench.submit(&study(20, &[])).await;
    let worker = bench.worker("w").await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    let bench = bench.restart(Duration::from_secs(3600)).await;
    bench.pass(14.0).await;
    let renewal = json!({ "renew": [{ "job": lease.job, "attempt": 1 }] });
    assert!(bench.exchange(&worker, renewal).await.cancel.is_empty());
    bench.pass(14.0).await;
    assert_eq!(bench.complete(&worker, &lease, result(&lease)).await.accepted, [lease.job]);
    assert_eq!(bench.view(&study).await["samples"]["succeeded"], 1);
    bench.check_counts().await;
}

#[tokio::test]
async fn a_closed_store_answers_with_a_problem() {
    let bench = Bench::open().await;
    bench.state.close().await;
    let answer = bench.post("/v1/studies", study(20, &[]).to_string()).await;
    answer.problem(503, "unavailable");
    assert_eq!(answer.header("retry-after"), "1");
    bench.get("/readyz").await.problem(503, "unavailable");
    assert_eq!(bench.get("/healthz").await.status, 200);
}

/// As if an earlier program had begun and done all this.
async fn made_earlier(bench: &Bench, version: Option<&str>) {
    let options = SqliteConnectOptions::new().filename(bench.database());
    let mut database: SqliteConnection = options.connect().await.expect("opens beside the coordinator");
    for set in ["update studies set solver_version = ?", "update workers set solver_version = ?"] {
        sqlx::query(set).bind(version).execute(&mut database).await.expect("writes");
    }
}

#[tokio::test]
async fn a_study_begun_with_other_numbers_goes_no_further() {
    let bench = Bench::open().await;
    let (running, paused) = (bench.submit(&study(20, &[])).await, bench.submit(&study(21, &[])).await);
    bench.post(&format!("{paused}/pause"), String::new()).await;
    let worker = bench.worker("w").await;
    let leases = bench.claim(&worker, 2).await;
    assert_eq!(bench.complete(&worker, &leases[0], result(&leases[0])).await.accepted, [leases[0].job]);
    made_earlier(&bench, Some("3")).await;
    let bench = bench.restart(Duration::from_secs(1)).await;
    let view = bench.view(&running).await;
    assert_eq!((&view["state"], &view["samples"]["succeeded"]), (&json!("failed"), &json!(1)));
    let told = |why: &Value| why.as_str().is_some_and(|why| why.contains("version 3") && why.contains("not mixed"));
    assert!(told(&view["failure"]), "{view}");
    for action in [format!("{running}/retry-failed"), format!("{paused}/resume")] {
        let refused = bench.post(&action, String::new()).await;
        refused.problem(409, "wrong-state");
        assert!(told(&refused.json()["detail"]), "{:?}", refused.body);
    }
    // Its worker is of that version too, and has to say so again.
    let unknown = bench.post(&format!("{worker}/exchange"), json!({ "want": 1 }).to_string()).await;
    unknown.problem(404, "unknown-worker");
    let worker = bench.worker("new").await;
    assert!(bench.claim(&worker, 5).await.is_empty(), "nothing of theirs is given out");
    let new = bench.submit(&study(22, &[])).await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    assert!(new.ends_with(&lease.study.to_string()), "{new}");
    bench.check_counts().await;
}

#[tokio::test]
async fn a_study_from_before_versions_were_kept_has_the_version_of_then() {
    let bench = Bench::open().await;
    let study = bench.submit(&study(20, &[])).await;
    made_earlier(&bench, None).await;
    let bench = bench.restart(Duration::from_secs(1)).await;
    let view = bench.view(&study).await;
    assert_eq!(view["solver_version"], "4");
    // Whoever changes the numbers next turns this around.
    assert_eq!(view["state"], if SOLVER_VERSION == "4" { "sampling" } else { "failed" });
}

#[tokio::test]
async fn what_was_flown_with_other_numbers_is_not_audited() {
    let bench = Bench::open().await;
    let mut spec = study(20, &[]);
    spec["audit"] = json!(1.0);
    let study = bench.submit(&spec).await;
    let first = bench.worker("first").await;
    // While there is another worker, no worker audits itself.
    bench.worker("second").await;
    bench.work_off(&first).await;
    assert_eq!(bench.view(&study).await["audits"]["ready"], 20);
    made_earlier(&bench, Some("3")).await;
    let bench = bench.restart(Duration::from_secs(1)).await;
    let view = bench.view(&study).await;
    assert_eq!((&view["state"], &view["solver_version"]), (&json!("failed"), &json!("3")));
    assert_eq!(view["audits"]["ready"], 0, "{view}");
    assert!(bench.claim(&bench.worker("third").await, 5).await.is_empty());
    bench.check_counts().await;
}
