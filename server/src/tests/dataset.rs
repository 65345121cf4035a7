//! The dataset in its formats.

use axum::body::Body;
use axum::http::Request;
use serde_json::{Value, json};

use super::answers::{completion, infeasible, result, study};
use super::bench::Bench;

async fn flown(order_reversed: bool) -> (Bench, String) {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let study = bench.submit(&study(20, &[])).await;
    let mut leases = bench.claim(&worker, 20).await;
    let first = leases[0].job;
    if order_reversed {
        leases.reverse();
    }
    for lease in &leases {
        let result = if lease.job == first { infeasible("the wings cross") } else { result(lease) };
        let mut completion = completion(lease, result);
        completion["provenance"]["wall_s"] = json!(if order_reversed { 1.0 } else { 2.0 });
        bench.exchange(&worker, json!({ "complete": [completion] })).await;
    }
    (bench, study)
}

#[tokio::test]
async fn every_format_has_every_row_in_order() {
    let (bench, study) = flown(false).await;
    let json = bench.get(&format!("{study}/dataset")).await;
    assert_eq!(json.header("content-type"), "application/json");
    let rows = json.json();
    let rows = rows.as_array().expect("an array");
    let indices: Vec<_> = rows.iter().filter_map(|r| r["sample"].as_u64()).collect();
    assert_eq!(indices, (0..20).collect::<Vec<_>>());
    assert_eq!((&rows[0]["outcome"], &rows[0]["reason"]), (&json!("infeasible"), &json!("the wings cross")));
    assert!(rows[1]["scaled"]["lift"]["mean"].is_number() && rows[1]["parameters"]["frequency_hz"].is_number());
    let lines = bench.get(&format!("{study}/dataset?format=ndjson")).await;
    let parsed: Vec<Value> = lines.body.split(|b| *b == b'\n').filter_map(|l| serde_json::from_slice(l).ok()).collect();
    assert_eq!(&parsed, rows);
    let request = Request::get(format!("{study}/dataset")).header("accept", "text/csv").body(Body::empty());
    let csv = bench.send(request.expect("a request")).await;
    assert!(csv.header("content-type").starts_with("text/csv"));
    let text = String::from_utf8(csv.body.to_vec()).expect("text");
    assert_eq!(text.lines().count(), 21);
    assert!(text.starts_with("sample,outcome,frequency_hz,") && text.contains("lift_n,lift_n_se"), "{text}");
}

#[tokio::test]
async fn the_same_study_flown_elsewhere_gives_the_same_bytes() {
    let ((here, study), (there, same)) = (flown(false).await, flown(true).await);
    for format in ["json", "ndjson", "csv"] {
        let a = here.get(&format!("{study}/dataset?format={format}")).await.body;
        let b = there.get(&format!("{same}/dataset?format={format}")).await.body;
        assert_eq!(a, b, "{format}");
    }
}

#[tokio::test]
async fn other_formats_are_refused() {
    let bench = Bench::open().await;
    let study = bench.submit(&study(20, &[])).await;
    assert_eq!(bench.get(&format!("{study}/dataset")).await.json(), json!([]));
    let pointers = bench.get(&format!("{study}/dataset?format=xml")).await.problem(400, "invalid-query");
    assert_eq!(pointers, ["/format"]);
    let request = Request::get(format!("{study}/dataset")).header("accept", "image/png").body(Body::empty());
    bench.send(request.expect("a request")).await.problem(406, "not-acceptable");
}
