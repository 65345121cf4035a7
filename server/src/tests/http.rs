//! Requests and their refusals.

use axum::body::Body;
use axum::http::Request;
use serde_json::{Value, json};

use super::answers::{registration, study};
use super::bench::{Answer, Bench};

async fn submit_with_key(bench: &Bench, key: &str, spec: &Value) -> Answer {
    let request = Request::post("/v1/studies")
        .header("content-type", "application/json; charset=utf-8")
        .header("idempotency-key", key)
        .body(Body::from(spec.to_string()));
    bench.send(request.expect("a request")).await
}

#[tokio::test]
async fn a_submission_repeated_under_its_key_finds_the_first() {
    let bench = Bench::open().await;
    let first = submit_with_key(&bench, "k1", &study(20, &[])).await;
    let again = submit_with_key(&bench, "k1", &study(20, &[])).await;
    assert_eq!((first.status.as_u16(), again.status.as_u16()), (201, 200));
    assert_eq!(first.json()["id"], again.json()["id"]);
    let pointers = submit_with_key(&bench, "k1", &study(21, &[])).await.problem(422, "idempotency-key-reused");
    assert_eq!(pointers, ["/headers/idempotency-key"]);
    assert_eq!(submit_with_key(&bench, "k2", &study(20, &[])).await.status, 201);
    submit_with_key(&bench, "", &study(20, &[])).await.problem(422, "invalid-request");
}

fn lattice(solver: Value) -> Value {
    json!({ "model": { "solver": solver } })
}

#[tokio::test]
async fn what_is_wrong_with_a_study_is_named_and_nothing_is_stored() {
    let bench = Bench::open().await;
    let cases = [
        (json!({ "sampling": { "samples": 1e9 as u64 } }), "/sampling/samples"),
        (json!({ "parameters": { "frequency_hz": [30.0, 20.0] } }), "/parameters/frequency_hz"),
        (json!({ "parameters": { "wing_count": 2 } }), "/parameters/wing_count"),
        (json!({ "model": { "insect": "mosquito" } }), "/model/insect"),
        (json!({ "colour": "red" }), "/colour"),
        (json!({ "seed": "x" }), "/seed"),
        (json!({ "sampling": { "samples": 30, "clearance_margin_mm": 900.0 } }), "/parameters"),
        // What training, the lattice or the clock would refuse later is refused now.
        (json!({ "surrogate": { "train_share": 0.94, "validation_share": 0.01 } }), "/surrogate/validation_share"),
        (json!({ "surrogate": { "train_share": 0.9, "validation_share": 0.1 } }), "/surrogate/train_share"),
        (lattice(json!({ "strokes": 1, "strokes_dropped": 0, "strokes_most": 1 })), "/model/solver/strokes_dropped"),
        (lattice(json!({ "bound_core": 0.1 })), "/model/solver/bound_core"),
        (
            lattice(json!({ "steps_per_stroke": 720, "spanwise_panels": 48, "chordwise_panels": 32, "strokes": 100 })),
            "/model/solver/steps_per_stroke",
        ),
        (json!({ "parameters": { "beta": [0.0, 30.0] } }), "/parameters/beta"),
    ];
    for (changes, pointer) in cases {
        let mut spec = study(20, &[]);
        for (name, value) in changes.as_object().expect("an object") {
            spec[name] = value.clone();
        }
        let pointers = bench.post("/v1/studies", spec.to_string()).await.problem(422, "invalid-study");
        assert_eq!(pointers, [pointer]);
        let dry = bench.post("/v1/studies?dry_run=true", spec.to_string()).await;
        assert_eq!((dry.status.as_u16(), &dry.json()["errors"][0]["pointer"]), (200, &json!(pointer)));
    }
    for text in ["", "{", r#"{"name":"a","seed":NaN}"#, r#"{"name":"a","sampling":{"samples":1e999}}"#] {
        bench.post("/v1/studies", text).await.problem(400, "malformed-json");
    }
    let fine = bench.post("/v1/studies?dry_run=true", study(20, &["a"]).to_string()).await.json();
    assert_eq!(fine, json!({ "simulations": 21, "errors": [] }));
    assert_eq!(bench.get("/v1/studies").await.json()["items"], json!([]));
}

#[tokio::test]
async fn every_refusal_is_a_problem() {
    let bench = Bench::open().await;
    let study = bench.submit(&study(20, &[])).await;
    bench.get("/nowhere").await.problem(404, "no-route");
    bench.delete("/v1/studies").await.problem(405, "method-not-allowed");
    bench.get("/v1/studies/no-id").await.problem(404, "unknown-study");
    bench.get("/v1/studies/0190a000-0000-7000-8000-000000000000/dataset").await.problem(404, "unknown-study");
    bench.get("/v1/jobs/99").await.problem(404, "unknown-job");
    bench.get("/v1/jobs/x/task").await.problem(404, "unknown-job");
    assert_eq!(bench.get("/v1/studies?limit=0").await.problem(400, "invalid-query"), ["/limit"]);
    assert_eq!(bench.get("/v1/studies?limit=ten").await.problem(400, "invalid-query"), ["/limit"]);
    assert_eq!(bench.get("/v1/studies?cursor=zz").await.problem(400, "invalid-query"), ["/cursor"]);
    bench.get(&format!("{study}/jobs?state=lost")).await.problem(400, "invalid-query");
    bench.get(&format!("{study}/jobs?colour=red")).await.problem(400, "invalid-query");
    let plain = Request::post("/v1/studies").header("content-type", "text/plain").body(Body::from("{}"));
    bench.send(plain.expect("a request")).await.problem(415, "unsupported-media-type");
    let large = " ".repeat((10 << 20) + 1);
    bench.post("/v1/studies", large).await.problem(413, "body-too-large");
    let points = vec![super::answers::optimised()["parameters"].clone(); 1001];
    let answer = bench.post(&format!("{study}/surrogate/predictions"), json!({ "points": points }).to_string()).await;
    assert_eq!(answer.problem(422, "invalid-request"), ["/points"]);
}

#[tokio::test]
async fn only_workers_of_the_same_kind_are_taken() {
    let bench = Bench::open().await;
    let cases = [
        ("protocol_version", json!(0), 426, "protocol-version"),
        ("solver_version", json!("0"), 409, "solver-version"),
        ("slots", json!(0), 422, "invalid-request"),
        ("name", json!(""), 422, "invalid-request"),
    ];
    for (field, value, status, slug) in cases {
        let mut request = registration("w");
        request[field] = value;
        let pointers = bench.post("/v1/workers", request.to_string()).await.problem(status, slug);
        assert_eq!(pointers, [format!("/{field}")]);
    }
    let worker = bench.worker("w").await;
    let answer = bench.post(&format!("{worker}/exchange"), json!({ "want": 1001, "wait_s": -1 }).to_string()).await;
    assert_eq!(answer.problem(422, "invalid-request"), ["/want", "/wait_s"]);
    bench.pass(100.0).await;
    assert_eq!(bench.get("/v1/workers").await.json()[0]["alive"], false);
}

#[tokio::test]
async fn a_study_unchanged_is_not_sent_again() {
    let bench = Bench::open().await;
    let study = bench.submit(&study(20, &[])).await;
    let tag = bench.get(&study).await.header("etag").to_owned();
    let ask = |tag: &str| Request::get(&study).header("if-none-match", tag).body(Body::empty()).expect("a request");
    bench.pass(5.0).await;
    let unchanged = bench.send(ask(&tag)).await;
    assert_eq!((unchanged.status.as_u16(), unchanged.body.len()), (304, 0));
    bench.post(&format!("{study}/pause"), "").await;
    assert_eq!(bench.send(ask(&tag)).await.status, 200);
}

#[tokio::test]
async fn lists_go_on_where_the_page_ended() {
    let bench = Bench::open().await;
    let mut studies = Vec::new();
    for _ in 0..3 {
        studies.push(bench.submit(&study(20, &[])).await);
    }
    let page = bench.get("/v1/studies?limit=2").await.json();
    assert!(studies[2].ends_with(page["items"][0]["id"].as_str().expect("an id")), "the newest comes first");
    let cursor = page["next_cursor"].as_str().expect("a cursor");
    let rest = bench.get(&format!("/v1/studies?limit=2&cursor={cursor}")).await.json();
    assert_eq!((rest["items"].as_array().map(Vec::len), &rest["next_cursor"]), (Some(1), &Value::Null));
    let (mut seen, mut cursor) = (Vec::new(), String::new());
    loop {
        let page = bench.get(&format!("{}/jobs?kind=simulate&state=ready&limit=7{cursor}", studies[0])).await.json();
        seen.extend(page["items"].as_array().expect("items").iter().filter_map(|job| job["ordinal"].as_u64()));
        let Some(next) = page["next_cursor"].as_str() else { break };
        cursor = format!("&cursor={next}");
    }
    assert_eq!(seen, (0..20).collect::<Vec<_>>());
    assert_eq!(bench.get("/v1/studies?state=paused").await.json()["items"], json!([]));
    assert_eq!(bench.get("/v1/studies?state=sampling").await.json()["items"].as_array().map(Vec::len), Some(3));
}

#[tokio::test]
async fn the_document_lists_the_routes() {
    let bench = Bench::open().await;
    let document = bench.get("/openapi.json").await.json();
    let paths = document["paths"].as_object().expect("paths");
    assert_eq!(paths.len(), 36, "{:?}", paths.keys());
    for (path, item) in paths {
        for (method, operation) in item.as_object().expect("methods") {
            assert!(operation["responses"].as_object().is_some_and(|r| !r.is_empty()), "{method} {path}");
        }
    }
    for status in ["401", "403", "413", "503"] {
        let refusal = &paths["/v1/studies"]["post"]["responses"][status]["content"]["application/problem+json"];
        assert_eq!(refusal["schema"]["$ref"], "#/components/schemas/Problem", "{status}");
    }
    assert_eq!(document["components"]["securitySchemes"]["token"]["scheme"], "bearer");
    for schema in ["Problem", "StudySpec", "StudyView", "ExchangeRequest", "Task", "DatasetRow"] {
        assert!(document["components"]["schemas"][schema].is_object(), "{schema}");
    }
}

/// The page asks nobody else for anything.
#[tokio::test]
async fn the_page_of_the_routes_is_whole() {
    let bench = Bench::open().await;
    let page = bench.get("/docs").await;
    assert!(page.header("content-type").starts_with("text/html"));
    let text = String::from_utf8(page.body.to_vec()).expect("text");
    let parts: Vec<_> = text.split(['"']).filter(|part| part.starts_with("docs/")).collect();
    assert_eq!(parts.len(), 3, "{text}");
    for part in parts {
        let answer = bench.get(&format!("/{part}")).await;
        assert_eq!(answer.status, 200, "{part}");
        assert!(answer.header("content-type").starts_with("text/") && !answer.body.is_empty(), "{part}");
        assert_eq!(answer.header("content-encoding") == "gzip", answer.body.starts_with(&[0x1f, 0x8b]), "{part}");
    }
    assert!(!text.contains("http"), "{text}");
}
