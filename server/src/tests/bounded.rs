//! What one request may cost: bodies are bounded before anything is made of them, answers are, and
//! what takes long waits its turn.

use axum::body::Body;
use axum::http::Request;
use serde_json::{Value, json};

use super::answers::{completion, result, study, trained};
use super::bench::{Answer, Bench};
use crate::heavy::HEAVY;

/// Routes which are answered at once: what they read does not grow with a study.
const LIGHT: [&str; 14] = [
    "/v1/studies/{study}",
    "/v1/studies/{study}/wing",
    "/v1/jobs/{job}",
    "/v1/jobs/{job}/explain",
    "/v1/reference",
    "/v1/scaling",
    "/v1/events",
    "/metrics",
    "/healthz",
    "/readyz",
    // These take turns by themselves.
    "/v1/studies/{study}/dataset",
    "/v1/studies/{study}/surrogate/front",
    "/v1/studies/{study}/surrogate/predictions",
    "/v1/simulations",
];

async fn toml(bench: &Bench, path: &str, text: String) -> Answer {
    let request = Request::post(path).header("content-type", "application/toml").body(Body::from(text));
    bench.send(request.expect("a request")).await
}

fn detail(answer: &Answer) -> String {
    answer.json()["errors"][0]["detail"].as_str().unwrap_or_default().to_owned()
}

#[tokio::test]
async fn a_study_of_many_keys_is_refused_before_it_is_parsed() {
    let bench = Bench::open().await;
    let line = |i: usize, steps: usize| format!("b{i}{}=1\n", ".a".repeat(steps));
    let large: String = (0..60_000).map(|i| line(i, 78)).collect();
    for path in ["/v1/studies", "/v1/studies?dry_run=true"] {
        toml(&bench, path, large.clone()).await.problem(413, "body-too-large");
    }
    let most = bench.state.config().study_limit;
    let fits: String = (0..).map(|i| line(i, 78)).take(most / 165).collect();
    assert!(fits.len() <= most);
    let told = toml(&bench, "/v1/studies", fits.clone()).await;
    assert_eq!(told.problem(422, "invalid-study"), [""]);
    assert!(detail(&told).contains("keys, tables and items"), "{}", detail(&told));
    let dry = toml(&bench, "/v1/studies?dry_run=true", fits).await;
    assert_eq!((dry.status.as_u16(), dry.json()["errors"].as_array().map(Vec::len)), (200, Some(1)));
    for (body, expected) in [
        (format!(r#"{{"name":{}1{}}}"#, "[".repeat(100), "]".repeat(100)), "nested"),
        (format!(r#"{{"name":"a","sampling":{{"samples":20}},"x":[{}1]}}"#, "1,".repeat(20_000)), "values"),
    ] {
        let told = bench.post("/v1/studies", body).await;
        assert_eq!(told.problem(422, "invalid-study"), [""]);
        assert!(detail(&told).contains(expected), "{}", detail(&told));
    }
}

/// The largest study there can be, every character of its description escaped.
fn largest_study() -> Value {
    let ranges = |low: f64| {
        let names = manduca_numerics::parameters::TABLE.iter().map(|p| p.name);
        names.map(|name| (name.to_owned(), json!([low, 1.234_567_890_123_456_7]))).collect::<serde_json::Map<_, _>>()
    };
    let optimisation = |i: usize| {
        json!({ "name": format!("{i:0>100}"), "method": "direct", "parameters": ranges(0.1), "starts": 100_000,
            "penalty_r": 1.234_567_890_123_456_7, "penalty_s": 1.234_567_890_123_456_7, "population": 1000,
            "generations": 900, "tolerance": 1.234_567_890_123_456_7e-5, "simplex_tolerance": 1.234_567_890_123_456_7e-5,
            "clearance_margin_mm": 1.234_567_890_123_456_7, "verify_strokes": 200, "refine_simulations": 5000 })
    };
    let mut study = study(200_000, &[]);
    study["description"] = json!("D".repeat(10_000));
    study["parameters"] = Value::Object(ranges(0.1));
    study["optimisations"] = (0..32).map(optimisation).collect();
    study
}

#[tokio::test]
async fn the_largest_study_there_can_be_fits() {
    let bench = Bench::open().await;
    let study = serde_json::to_string_pretty(&largest_study()).expect("is JSON");
    let study = study.replace('D', "\\ud83e\\udd8b");
    let answer = bench.post("/v1/studies?dry_run=true", study.clone()).await;
    assert_eq!(answer.status, 200, "{} bytes: {:?}", study.len(), answer.body);
    let pointers: Vec<_> = answer.json()["errors"].as_array().cloned().unwrap_or_default();
    assert!(pointers.iter().all(|fault| fault["pointer"] != ""), "it was read: {pointers:?}");
}

#[tokio::test]
async fn faults_are_told_up_to_a_hundred() {
    let bench = Bench::open().await;
    let unknown: serde_json::Map<_, _> = (0..5000).map(|i| (format!("b{i}"), json!(1))).collect();
    let mut asked = study(20, &[]);
    asked["parameters"] = Value::Object(unknown);
    let told = bench.post("/v1/studies", asked.to_string()).await;
    let pointers = told.problem(422, "invalid-study");
    assert_eq!((pointers.len(), pointers[0].as_str(), pointers[100].as_str()), (101, "/parameters/b0", ""));
    assert_eq!(told.json()["errors"][100]["detail"], "and 4900 more");
    let dry = bench.post("/v1/studies?dry_run=true", asked.to_string()).await;
    assert_eq!(dry.json()["errors"].as_array().map(Vec::len), Some(101));
    let long = json!({ "name": "x", "sampling": { "samples": 20 }, "c".repeat(200_000): 1 });
    let told = bench.post("/v1/studies", long.to_string()).await;
    assert_eq!(told.status, 422);
    assert!(told.body.len() < 3000, "{} bytes", told.body.len());
    let study = bench.submit(&study(20, &[])).await;
    bench.work_off(&bench.worker("w").await).await;
    let mut point = serde_json::Map::new();
    manduca_numerics::parameters::TABLE.iter().for_each(|p| drop(point.insert(p.name.into(), json!(1e9))));
    let points = json!({ "points": vec![Value::Object(point); 1000] }).to_string();
    let told = bench.post(&format!("{study}/surrogate/predictions"), points).await;
    assert_eq!(told.problem(422, "invalid-request").len(), 101);
    assert!(told.body.len() < 50_000);
}

#[tokio::test]
async fn only_a_worker_with_a_training_may_send_much() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    bench.submit(&study(20, &[])).await;
    let config = bench.state.config();
    let exchange = |bytes: usize| " ".repeat(bytes - 2) + "{}";
    let path = format!("{worker}/exchange");
    assert_eq!(bench.post(&path, exchange(config.exchange_limit)).await.status, 200);
    bench.post(&path, exchange(config.exchange_limit + 1)).await.problem(413, "body-too-large");
    let leases = bench.claim(&worker, 20).await;
    bench.post(&path, exchange(config.exchange_limit + 1)).await.problem(413, "body-too-large");
    let results: Vec<_> = leases.iter().map(|l| completion(l, result(l))).collect();
    bench.exchange(&worker, json!({ "complete": results })).await;
    let training = bench.claim(&worker, 1).await.remove(0);
    assert_eq!(bench.post(&path, exchange(config.large_limit)).await.status, 200);
    bench.post(&path, exchange(config.large_limit + 1)).await.problem(413, "body-too-large");
    let other = bench.worker("other").await;
    bench.post(&format!("{other}/exchange"), exchange(config.exchange_limit + 1)).await.problem(413, "body-too-large");
    // Its answer lost, it sends the result again, and is not refused.
    let body = json!({ "complete": [completion(&training, trained())] }).to_string();
    let body = " ".repeat(config.exchange_limit) + &body;
    for _ in 0..2 {
        let told = bench.post(&path, body.clone()).await;
        assert_eq!(told.json()["accepted"], json!([training.job]));
    }
}

#[tokio::test]
async fn fields_nobody_knows_are_refused_where_they_stand() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    bench.submit(&study(20, &[])).await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    let mut junk = completion(&lease, result(&lease));
    junk["result"]["junk"] = json!([{ "": 0 }]);
    let told = bench.post(&format!("{worker}/exchange"), json!({ "complete": [junk] }).to_string()).await;
    told.problem(422, "invalid-request");
    assert!(detail(&told).contains("unknown field `junk`"), "{}", detail(&told));
    let mut deep = completion(&lease, result(&lease));
    deep["result"]["means"] = (0..40).fold(json!(1), |inner, _| json!([inner]));
    let told = bench.post(&format!("{worker}/exchange"), json!({ "complete": [deep] }).to_string()).await;
    assert_eq!(told.problem(422, "invalid-request"), [""]);
    let many = format!(r#"{{"have":[{}1]}}"#, "1,".repeat(300_000));
    let told = bench.post(&format!("{worker}/exchange"), many).await;
    assert!(detail(&told).contains("values"), "{}", detail(&told));
    let repeated = format!(r#"{{{}"want":1}}"#, r#""want":1,"#.repeat(1000));
    let told = bench.post(&format!("{worker}/exchange"), repeated).await;
    assert!(detail(&told).contains("duplicate field"), "{}", detail(&told));
}

#[test]
fn every_route_which_reads_is_known_to_be_short_or_waits_its_turn() {
    let document = serde_json::to_value(crate::openapi()).expect("is JSON");
    let paths = document["paths"].as_object().expect("paths");
    let reads = paths.iter().filter(|(_, methods)| methods["get"].is_object());
    for (path, _) in reads {
        let known = [HEAVY.contains(&path.as_str()), LIGHT.contains(&path.as_str())];
        assert!(known[0] != known[1], "{path}: does it read much?");
    }
    assert!(HEAVY.iter().chain(&LIGHT).all(|path| paths.contains_key(*path)));
}

#[tokio::test]
async fn an_answer_is_kept_until_its_study_changes() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let study = bench.submit(&study(20, &[])).await;
    let asked = format!("{study}/throughput?intervals=5");
    let total = |answer: Answer| {
        let results = answer.json()["results"].as_array().cloned().unwrap_or_default();
        results.iter().filter_map(Value::as_u64).sum::<u64>()
    };
    assert_eq!(total(bench.get(&asked).await), 0);
    for done in 1..=3 {
        let lease = bench.claim(&worker, 1).await.remove(0);
        bench.complete(&worker, &lease, result(&lease)).await;
        for _ in 0..3 {
            assert_eq!(total(bench.get(&asked).await), done);
        }
    }
    bench.get(&format!("{study}/throughput?intervals=0")).await.problem(400, "invalid-query");
}

#[tokio::test]
async fn a_training_is_sent_all_its_samples_in_parts() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    bench.submit(&study(40, &[])).await;
    let results: Vec<_> = bench.claim(&worker, 40).await.iter().map(|l| completion(l, result(l))).collect();
    bench.exchange(&worker, json!({ "complete": results })).await;
    let training = bench.claim(&worker, 1).await.remove(0);
    let task = bench.get(&format!("/v1/jobs/{}/task", training.job)).await;
    assert_eq!(task.header("content-type"), "application/json");
    let task: manduca_protocol::task::Task = serde_json::from_slice(&task.body).expect("a task");
    let manduca_protocol::task::Task::Train(task) = task else { panic!("not a training") };
    assert_eq!(task.dataset.len(), 40);
    assert!(task.dataset.iter().all(|sample| sample.y[0] == sample.x[0] / 25.0));
}
