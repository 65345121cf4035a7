//! Rows that cannot be read: their study fails by itself, the others go on, and a check names each.

use serde_json::json;
use sqlx::ConnectOptions;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};

use super::answers::{result, study};
use super::bench::Bench;
use crate::Offline;

/// The database in the hands of somebody who heeds no rule.
async fn by_hand(bench: &Bench) -> SqliteConnection {
    let options = SqliteConnectOptions::new()
        .filename(bench.database())
        .foreign_keys(false)
        .pragma("ignore_check_constraints", "on");
    options.connect().await.expect("opens beside the coordinator")
}

async fn spoil(bench: &Bench, statement: &'static str) {
    let done = sqlx::query(statement).execute(&mut by_hand(bench).await).await.expect("spoils");
    assert!(done.rows_affected() > 0, "{statement} changes nothing");
}

/// Two studies of which the first is spoilt: the second must be worked off, the first must say why it is not,
/// and must be to be cancelled.
async fn the_other_goes_on(statement: &'static str, why: &str) {
    let bench = Bench::open().await;
    let (spoilt, whole) = (bench.submit(&study(20, &[])).await, bench.submit(&study(21, &[])).await);
    let worker = bench.worker("w").await;
    spoil(&bench, statement).await;
    bench.work_off(&worker).await;
    assert_eq!(bench.view(&whole).await["state"], "succeeded", "{statement}");
    let view = bench.view(&spoilt).await;
    assert_eq!(view["state"], "failed", "{statement}: {view}");
    let failure = view["failure"].as_str().expect("a reason");
    assert!(failure.contains(why) && failure.contains("damaged"), "{statement}: {failure}");
    assert_eq!(bench.get("/readyz").await.status, 200);
    assert_eq!(bench.get("/v1/studies").await.json()["items"].as_array().expect("a list").len(), 2);
    let cancelled = bench.post(&format!("{spoilt}/cancel"), String::new()).await;
    assert_eq!((cancelled.status.as_u16(), &cancelled.json()["state"]), (200, &json!("cancelled")));
    bench.check_counts().await;
    let bench = bench.restart(std::time::Duration::from_secs(1)).await;
    assert_eq!(bench.view(&whole).await["state"], "succeeded", "it starts, too");
}

#[tokio::test]
async fn a_study_that_cannot_be_read_fails_alone() {
    the_other_goes_on("update studies set spec = '{' || substr(spec, 3) where study = 1", "specification").await;
    the_other_goes_on("update studies set spec = cast(x'ff7b7d' as text) where study = 1", "specification").await;
    the_other_goes_on("update jobs set parameters = '[31.0' where study = 1 and ordinal = 3", "parameters").await;
}

#[tokio::test]
async fn a_study_that_becomes_unreadable_while_it_runs_fails_alone() {
    let bench = Bench::open().await;
    let (spoilt, whole) = (bench.submit(&study(20, &[])).await, bench.submit(&study(21, &[])).await);
    let worker = bench.worker("w").await;
    let leases = bench.claim(&worker, 20).await;
    let bench = bench.restart(std::time::Duration::from_secs(1)).await;
    spoil(&bench, "update studies set spec = '[]' where study = 1").await;
    for lease in &leases {
        assert_eq!(bench.complete(&worker, lease, result(lease)).await.accepted, [lease.job]);
    }
    bench.work_off(&worker).await;
    assert_eq!(bench.view(&spoilt).await["state"], "failed");
    assert_eq!(bench.view(&whole).await["state"], "succeeded");
}

#[tokio::test]
async fn a_coordinator_starts_on_a_damaged_study() {
    let bench = Bench::open().await;
    let (spoilt, whole) = (bench.submit(&study(20, &[])).await, bench.submit(&study(21, &[])).await);
    spoil(&bench, "update studies set stage = 'sampling?' where study = 1").await;
    let bench = bench.restart(std::time::Duration::from_secs(1)).await;
    bench.work_off(&bench.worker("w").await).await;
    assert_eq!(bench.view(&whole).await["state"], "succeeded");
    let cancelled = bench.post(&format!("{spoilt}/cancel"), String::new()).await;
    assert_eq!((cancelled.status.as_u16(), &cancelled.json()["state"]), (200, &json!("cancelled")));
    assert_eq!(bench.get("/v1/studies").await.json()["items"].as_array().expect("a list").len(), 2);
}

/// What is spoilt, and the words by which a check names it.
const SPOILT: [(&str, &str); 40] = [
    ("update studies set id = zeroblob(16) where study = 1", "studies have an id"),
    ("update studies set name = 'nane' where study = 1", "studies have a name"),
    ("update studies set spec = replace(spec, '\"seed\":', '\"seeD\":') where study = 1", "studies have a spec"),
    ("update studies set spec = replace(spec, ':', ': ') where study = 1", "spec that differs from its digest"),
    ("update studies set spec_digest = zeroblob(32) where study = 1", "spec that differs from its digest"),
    ("update studies set stage = 'training?' where study = 1", "studies have a stage"),
    ("update studies set condition = 'suceeded' where study = 1", "studies have a condition"),
    ("update studies set samples = samples + 1, next_sample = next_sample + 1 where study = 1", "other samples"),
    ("update studies set next_sample = 1 where study = 1", "next_sample"),
    ("update studies set optimisations = 7 where study = 1", "other optimisations"),
    ("update study_stages set stage = 'rest' where study = 1 and stage = 'sampling'", "study_stages have a stage"),
    ("update study_stages set ended_ms = started_ms - 1 where study = 1 and stage = 'sampling'", "end before"),
    ("update jobs set parameters = replace(parameters, '1', '2') where job = 3", "key that is not that of"),
    ("update jobs set parameters = '' where job = 3", "parameters that cannot be read"),
    ("update jobs set parameters = null where job = 3", "parameters that cannot be read"),
    ("update jobs set key = zeroblob(32) where job = 3", "key that is not that of"),
    ("update jobs set key = null where job = 3", "lack their key"),
    ("update jobs set role = 'sanple' where job = 3", "jobs have a role"),
    ("update jobs set state = 'suceeded' where job = 3", "jobs have a state"),
    ("update jobs set ordinal = -3 where job = 3", "jobs have an ordinal"),
    ("update jobs set attempt = -1 where job = 3", "jobs have an ordinal, attempt"),
    ("update jobs set failures = -1 where job = 3", "jobs have an ordinal, attempt"),
    ("update jobs set losses = -1 where job = 3", "jobs have an ordinal, attempt"),
    ("update jobs set worker = x'00' where job = 3", "jobs have a worker"),
    ("update jobs set result_of = 4 where job = 3", "jobs share the result of another"),
    ("update jobs set progress = '{' where job = 3", "jobs have a progress"),
    ("update results set body = cast(replace(cast(body as text), '1', '2') as blob) where job = 3", "digest"),
    ("update results set digest = zeroblob(32) where job = 3", "digest"),
    ("update results set summary = '{' where job = 21", "summary"),
    ("update results set wall_s = -1.0 where job = 3", "wall_s"),
    ("update results set level = '' where job = 3", "level"),
    ("update results set attempt = 0 where job = 3", "results have an attempt"),
    ("update results set worker = zeroblob(16) where job = 3", "results have a worker"),
    ("update workers set name = '' where name = 'w'", "workers have a name"),
    ("update workers set level = '' where name = 'w'", "workers have a name, level"),
    ("update study_counts set n = n + 1 where study = 1 and role = 'sample' and state = 'succeeded'", "counters"),
    ("update tokens set scopes = 'reed'", "tokens have scopes"),
    ("update tokens set name = ''", "tokens have a name"),
    ("update checkpoints set body = x'7b'", "checkpoints have a body"),
    ("update refused_results set body = x'7b'", "refused_results have a body"),
];

#[tokio::test]
async fn a_check_names_what_is_spoilt() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    let worker = bench.worker("w").await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    bench.complete(&worker, &lease, result(&lease)).await;
    // Evidence: another result for the same job.
    let mut other = result(&lease);
    other["strokes_averaged"] = json!(77);
    bench.complete(&worker, &lease, other).await;
    bench.work_off(&worker).await;
    let mut database = Offline::open(&bench.database()).await.expect("opens beside the coordinator");
    database.create_token("ada", [crate::Scope::Read].into_iter().collect()).await.expect("is made");
    bench.state.close().await;
    let checkpoint = "insert into checkpoints (job, attempt, body, saved_ms) values (3, 1, x'7b7d', 1)";
    for statement in ["pragma ignore_check_constraints = on", "pragma foreign_keys = off", checkpoint] {
        sqlx::query(statement).execute(database.file.db()).await.expect("is done");
    }
    let before = database.check().await.expect("reads");
    assert!(before.damage.is_empty() && before.results > 20 && before.keys == 20, "{before:?}");
    assert_eq!(before.breaches, ["1 checkpoints have a body that cannot be read (the first: job 3)"]);
    sqlx::query("delete from checkpoints").execute(database.file.db()).await.expect("is undone");
    for (statement, named) in SPOILT {
        sqlx::query("savepoint before").execute(database.file.db()).await.expect("begins");
        if statement.contains("checkpoints") {
            sqlx::query(checkpoint).execute(database.file.db()).await.expect("is inserted");
        }
        let done = sqlx::query(statement).execute(database.file.db()).await.expect(statement);
        assert!(done.rows_affected() > 0, "{statement} changes nothing");
        let found = database.check().await.expect("reads");
        let words = found.breaches.join("; ");
        assert!(words.contains(named), "{statement}: {found:?}");
        sqlx::query("rollback to before").execute(database.file.db()).await.expect("is undone");
        sqlx::query("release before").execute(database.file.db()).await.expect("is undone");
    }
    assert!(database.check().await.expect("reads").is_well());
}

/// How many items a list has.
async fn listed(bench: &Bench, path: &str) -> usize {
    let answer = bench.get(path).await;
    assert_eq!(answer.status, 200, "{path}: {:?}", answer.body);
    let list = answer.json();
    list.as_array().or(list["items"].as_array()).expect("a list").len()
}

#[tokio::test]
async fn a_list_of_studies_shows_what_can_be_read() {
    let bench = Bench::open().await;
    let mut studies = Vec::new();
    for samples in 20..23 {
        studies.push(bench.submit(&study(samples, &[])).await);
    }
    bench.work_off(&bench.worker("w").await).await;
    spoil(&bench, "update study_counts set n = -1 where study = 1 and state = 'succeeded'").await;
    assert_eq!(listed(&bench, "/v1/studies").await, 3);
    assert_eq!(bench.get("/v1/studies").await.json()["items"][2]["samples_succeeded"], 0);
    spoil(&bench, "update studies set samples = -1 where study = 2").await;
    assert_eq!(listed(&bench, "/v1/studies").await, 2);
    spoil(&bench, "update studies set samples = 21, id = x'00' where study = 2").await;
    assert_eq!(listed(&bench, "/v1/studies").await, 2);
    // The page goes on behind the one left out.
    let first = bench.get("/v1/studies?limit=1").await.json();
    let cursor = first["next_cursor"].as_str().expect("a cursor");
    let last = bench.get(&format!("/v1/studies?limit=1&cursor={cursor}")).await.json();
    for (page, path) in [(&first, &studies[2]), (&last, &studies[0])] {
        assert!(path.ends_with(page["items"][0]["id"].as_str().expect("an id")), "{path}: {page}");
    }
    assert!(last["next_cursor"].is_null(), "{last}");
    spoil(&bench, "update study_counts set n = 9223372036854775807").await;
    for path in ["/metrics", "/v1/scaling", "/v1/studies"] {
        assert_eq!(bench.get(path).await.status, 200, "{path}");
    }
}

#[tokio::test]
async fn lists_of_workers_and_evidence_show_what_can_be_read() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    let worker = bench.worker("w").await;
    bench.worker("v").await;
    for lease in bench.claim(&worker, 2).await {
        bench.complete(&worker, &lease, result(&lease)).await;
        let mut other = result(&lease);
        other["strokes_averaged"] = json!(77);
        bench.complete(&worker, &lease, other).await;
    }
    assert_eq!(listed(&bench, "/v1/evidence").await, 2);
    spoil(&bench, "update refused_results set attempt = -1 where refused = 1").await;
    assert_eq!(listed(&bench, "/v1/evidence").await, 1);
    for (statement, left) in [
        ("update workers set completed = -1, failed = -1, strikes = -1 where name = 'w'", 2),
        ("update workers set slots = -1 where name = 'w'", 1),
        ("update workers set slots = 2, id = x'00' where name = 'w'", 1),
    ] {
        spoil(&bench, statement).await;
        for path in ["/v1/workers", "/v1/workers?limit=1000"] {
            assert_eq!(listed(&bench, path).await, left, "{path} after {statement}");
        }
    }
    let page = bench.get("/v1/workers?limit=1").await.json();
    assert_eq!((&page["items"][0]["name"], page["next_cursor"].is_null()), (&json!("v"), true), "{page}");
    spoil(&bench, "update workers set slots = 9223372036854775807").await;
    assert_eq!(bench.get("/metrics").await.status, 200);
}

#[tokio::test]
async fn a_check_names_a_secret_that_is_cut_and_numbers_that_are_none() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    bench.worker("w").await;
    for (statement, named) in [
        ("update studies set secret = x'' where study = 1", "studies have a secret"),
        ("update studies set secret = null where study = 1", "studies have a secret"),
        ("update study_counts set n = -1 where study = 1", "counters are negative"),
        ("update workers set strikes = -1 where name = 'w'", "workers have a number"),
        ("update workers set slots = 4294967296 where name = 'w'", "workers have a number"),
    ] {
        spoil(&bench, statement).await;
        let mut database = Offline::open(&bench.database()).await.expect("opens beside the coordinator");
        let found = database.check().await.expect("reads");
        assert!(found.breaches.join("; ").contains(named), "{statement}: {found:?}");
    }
}
