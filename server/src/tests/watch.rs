//! What those are told who watch, scale and ask why; copies, checks, removals.

use std::time::Duration;

use manduca_protocol::worker::{OLDEST_PROTOCOL_VERSION, PROTOCOL_VERSION};
use serde_json::{Value, json};

use super::answers::{flown, result, study};
use super::bench::Bench;
use crate::Offline;
use crate::store::{Prune, Pruned};

async fn because(bench: &Bench, job: &Value) -> (String, String) {
    let told = bench.get(&format!("/v1/jobs/{job}/explain")).await.json();
    let sentences: Vec<_> = told["because"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    (told["state"].as_str().unwrap_or_default().to_owned(), sentences.join("; "))
}

#[tokio::test]
async fn every_state_of_a_job_is_explained() {
    let bench = Bench::open().await;
    let study = bench.submit(&study(20, &[])).await;
    let jobs = bench.get(&format!("{study}/jobs")).await.json();
    let last = jobs["items"][19]["id"].clone();
    let (state, why) = because(&bench, &last).await;
    assert!(state == "ready" && why.contains("no worker") && why.contains("19 ready jobs"), "{why}");
    let worker = bench.worker("busy").await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    let id = json!(lease.job);
    let (state, why) = because(&bench, &id).await;
    assert!(state == "leased" && why.contains("`busy`") && why.contains("at most 600 s"), "{why}");
    bench.post(&format!("{study}/pause"), "").await;
    let (_, why) = because(&bench, &last).await;
    assert!(why.contains("paused") && why.contains("18 ready jobs") && !why.contains("no worker"), "{why}");
    bench.post(&format!("{study}/resume"), "").await;
    bench.fail(&worker, &lease, "it burns").await;
    let (state, why) = because(&bench, &id).await;
    assert!(state == "delayed" && why.contains("attempt 1 of 3") && why.contains("it burns"), "{why}");
    bench.pass(1.0).await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    bench.complete(&worker, &lease, result(&lease)).await;
    assert_eq!(because(&bench, &id).await, ("succeeded".into(), "it is done: computed by worker `busy`".into()));
    bench.get("/v1/jobs/999/explain").await.problem(404, "unknown-job");
}

#[tokio::test]
async fn metrics_and_scaling_follow_what_happens() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    assert_eq!(bench.get("/v1/scaling").await.json()["wanted_slots"], 20);
    let worker = bench.worker("w").await;
    let leases = bench.claim(&worker, 2).await;
    bench.complete(&worker, &leases[0], result(&leases[0])).await;
    let told = bench.get("/v1/scaling").await.json();
    let expected = json!({ "ready_jobs": 18, "delayed_jobs": 0, "leased_jobs": 1, "workers": 1, "slots": 2,
        "idle_slots": 1, "wanted_slots": 19 });
    assert_eq!(told, expected);
    bench.pass(15.0).await;
    let answer = bench.get("/metrics").await;
    assert!(answer.header("content-type").starts_with("application/openmetrics-text"));
    let text = String::from_utf8(answer.body.to_vec()).expect("text");
    for line in [
        "manduca_jobs{role=\"sample\",state=\"ready\"} 19",
        "manduca_workers{state=\"alive\"} 1",
        "manduca_slots 2",
        "manduca_decisions_total{decision=\"lease_expired\"} 1",
        "manduca_jobs_leased_total 2",
        "manduca_jobs_completed_total{role=\"sample\",outcome=\"succeeded\"} 1",
        "manduca_job_wall_seconds_count{role=\"sample\"} 1",
        "manduca_http_answers_total{status=\"200\"}",
        "manduca_store_failing 0",
    ] {
        assert!(text.contains(line), "{line} is not in\n{text}");
    }
    assert!(text.ends_with("# EOF\n"));
}

#[tokio::test]
async fn evidence_is_listed_by_class() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    let worker = bench.worker("w").await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    bench.complete(&worker, &lease, result(&lease)).await;
    bench.complete(&worker, &lease, flown(-1.0)).await;
    let all = bench.get("/v1/evidence").await.json();
    assert_eq!((all[0]["class"].as_str(), all[0]["job"].clone()), (Some("nondeterminism"), json!(lease.job)));
    assert_eq!(bench.get("/v1/evidence?class=refused").await.json(), json!([]));
    assert_eq!(bench.get("/v1/evidence?class=x").await.problem(400, "invalid-query"), ["/class"]);
}

#[tokio::test]
async fn a_copy_of_a_running_store_is_whole_and_a_change_by_another_hand_is_found() {
    let bench = Bench::open().await;
    let study = bench.submit(&study(20, &[])).await;
    bench.work_off(&bench.worker("w").await).await;
    let copy = bench.database().with_file_name("copy.db");
    let mut database = Offline::open(&bench.database()).await.expect("opens beside the coordinator");
    database.backup(&copy).await.expect("is written");
    assert!(database.backup(&copy).await.is_err(), "nothing is written over");
    let mut copied = Offline::open(&copy).await.expect("opens");
    let findings = copied.check().await.expect("reads");
    assert!(findings.is_well() && findings.results == 21, "{findings:?}");
    for (spoil, found) in [
        ("update study_counts set n = n + 1 where state = 'succeeded' and role = 'sample'", "counters"),
        ("update results set digest = zeroblob(32) where job = 3", "digest"),
        ("delete from results where job = 4", "no result"),
    ] {
        sqlx::query(spoil).execute(copied.file.db()).await.expect("spoils");
        let breaches = copied.check().await.expect("reads").breaches;
        assert!(breaches.iter().any(|b| b.starts_with('1') && b.contains(found)), "{found}: {breaches:?}");
    }
    assert_eq!(bench.view(&study).await["state"], "succeeded");
}

#[tokio::test]
async fn old_studies_go_and_results_others_share_stay() {
    let bench = Bench::open_with(|config| config.keep = Some(Duration::from_secs(3600))).await;
    let spec = study(20, &[]);
    let old = bench.submit(&spec).await;
    bench.work_off(&bench.worker("w").await).await;
    let rows = bench.get(&format!("{old}/dataset")).await.body;
    bench.pass(3000.0).await;
    let new = bench.submit(&spec).await;
    bench.work_off(&bench.worker("w").await).await;
    let running = bench.submit(&study(25, &[])).await;
    let prune = || bench.state.store().run(Prune { began: bench.state.now_ms() });
    assert_eq!(prune().await.expect("looks"), Pruned::None, "nothing is old enough");
    bench.pass(1000.0).await;
    assert_eq!(prune().await.expect("removes"), Pruned::One);
    assert_eq!(prune().await.expect("looks"), Pruned::None);
    bench.get(&old).await.problem(404, "unknown-study");
    assert_eq!(bench.get(&format!("{new}/dataset")).await.body, rows);
    assert_eq!(bench.view(&running).await["samples"]["succeeded"], 20, "still shared");
    let mut database = Offline::open(&bench.database()).await.expect("opens beside the coordinator");
    let findings = database.check().await.expect("reads");
    assert!(findings.is_well(), "{findings:?}");
    bench.check_counts().await;
}

#[tokio::test]
async fn workers_come_in_pages_and_are_found_by_name_and_id() {
    let bench = Bench::open().await;
    let mut paths = Vec::new();
    for i in 0..5 {
        paths.push(bench.worker(if i == 4 { "zzz" } else { "node" }).await);
    }
    let (mut seen, mut query) = (Vec::new(), String::from("limit=2"));
    loop {
        let page = bench.get(&format!("/v1/workers?{query}")).await.json();
        let items = page["items"].as_array().expect("items").clone();
        assert!(items.len() <= 2);
        seen.extend(items.iter().filter_map(|w| w["id"].as_str()).map(|id| format!("/v1/workers/{id}")));
        let Some(cursor) = page["next_cursor"].as_str() else { break };
        query = format!("limit=2&cursor={cursor}");
    }
    assert_eq!((seen.len(), seen.iter().all(|path| paths.contains(path))), (5, true));
    let found = bench.get("/v1/workers?find=zzz").await.json();
    assert_eq!((found["items"].as_array().map(Vec::len), &found["items"][0]["name"]), (Some(1), &json!("zzz")));
    let id = paths[0].rsplit('/').next().expect("an id");
    assert_eq!(bench.get(&format!("/v1/workers?find={id}")).await.json()["items"][0]["id"], id);
    assert_eq!(bench.get("/v1/workers?cursor=zz").await.problem(400, "invalid-query"), ["/cursor"]);
    assert_eq!(bench.get("/v1/workers").await.json().as_array().map(Vec::len), Some(5), "as before");
}

#[tokio::test]
async fn workers_long_gone_are_removed_unless_something_names_them() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    let (idle, done, refused, silent) = (
        bench.worker("idle").await,
        bench.worker("done").await,
        bench.worker("refused").await,
        bench.worker("silent").await,
    );
    let lease = bench.claim(&done, 1).await.remove(0);
    bench.complete(&done, &lease, result(&lease)).await;
    bench.complete(&refused, &lease, result(&lease)).await;
    for worker in [&idle, &done, &refused] {
        bench.delete(worker).await;
    }
    let forget = async || bench.state.store().forget_workers(bench.state.now_ms()).await.expect("looks");
    assert_eq!(forget().await, 0);
    bench.pass(25.0 * 3600.0).await;
    assert_eq!(forget().await, 1);
    bench.delete(&idle).await.problem(404, "unknown-worker");
    assert_eq!(bench.exchange(&silent, json!({})).await.jobs.len(), 0, "not gone yet");
    bench.pass(8.0 * 24.0 * 3600.0).await;
    assert_eq!(forget().await, 1);
    let mut database = Offline::open(&bench.database()).await.expect("opens beside the coordinator");
    let findings = database.check().await.expect("reads");
    assert!(findings.is_well(), "{findings:?}");
}

#[tokio::test]
async fn only_workers_of_a_known_version_of_the_exchange_are_taken() {
    let bench = Bench::open().await;
    for version in [OLDEST_PROTOCOL_VERSION - 1, PROTOCOL_VERSION + 1, u32::MAX] {
        let mut registration = super::answers::registration("w");
        registration["protocol_version"] = json!(version);
        let answer = bench.post("/v1/workers", registration.to_string()).await;
        assert_eq!(answer.problem(426, "protocol-version"), ["/protocol_version"]);
        let detail = answer.json()["detail"].as_str().expect("a sentence").to_owned();
        assert!(detail.contains(&format!("version {version} ")) && detail.contains("1 to 4"), "{detail}");
        assert_eq!(answer.header("upgrade"), "manduca-exchange/4");
    }
    let health = bench.get("/healthz").await.json();
    assert_eq!((health["oldest_protocol_version"].as_u64(), health["protocol_version"].as_u64()), (Some(1), Some(4)));
}
