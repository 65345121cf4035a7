//! The dataset in its formats.

use std::time::Duration;

use arrow_array::RecordBatch;
use arrow_array::cast::AsArray;
use arrow_array::types::{Float64Type, Int64Type};
use arrow_schema::DataType;
use axum::body::Body;
use axum::http::Request;
use futures_util::StreamExt;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use serde_json::{Value, json};
use tower::ServiceExt;

use super::answers::{completion, infeasible, result, study};
use super::bench::Bench;
use crate::store::{Prune, Pruned};

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
async fn provenance_names_who_computed_each_row_in_every_format() {
    let (bench, study) = flown(false).await;
    let rows = bench.get(&format!("{study}/dataset?provenance=true")).await.json();
    let by = &rows[3]["computed_by"];
    assert_eq!((&by["worker_name"], &by["job"], by.get("token")), (&json!("w"), &json!(4), None), "{by}");
    assert_eq!(rows[3]["provenance"], json!({ "wall_s": 2.0, "level": "test" }));
    let csv = bench.get(&format!("{study}/dataset?provenance=true&format=csv")).await;
    let text = String::from_utf8(csv.body.to_vec()).expect("text");
    let lines: Vec<_> = text.lines().collect();
    assert!(lines[0].ends_with(",solver_version,computed_job,worker,worker_name,token,level,wall_s"), "{}", lines[0]);
    let worker = by["worker"].as_str().expect("an id");
    assert!(lines[4].ends_with(&format!(",4,{worker},w,,test,2.0")), "{}", lines[4]);
    let (plain, told) = (parquet(&bench, &study, "").await, parquet(&bench, &study, "&provenance=true").await);
    assert_eq!(told.0.schema().fields().len(), plain.0.schema().fields().len() + 6);
    let names = told.0.column_by_name("worker_name").expect("a column").as_string::<i32>();
    assert!(names.iter().all(|name| name == Some("w")));
    assert_eq!(told.1, plain.1, "the digest is of the numbers");
}

/// The rows of a Parquet dataset, and the digest it says.
async fn parquet(bench: &Bench, study: &str, query: &str) -> (RecordBatch, Option<String>) {
    let answer = bench.get(&format!("{study}/dataset?format=parquet{query}")).await;
    let reader = ParquetRecordBatchReaderBuilder::try_new(answer.body).expect("a Parquet file");
    let facts = reader.metadata().file_metadata().key_value_metadata().cloned().unwrap_or_default();
    let digest = facts.into_iter().find(|fact| fact.key == "manduca.dataset_blake3").and_then(|fact| fact.value);
    (reader.build().expect("reads").next().expect("rows").expect("a batch"), digest)
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

/// Every number of the table is that of the CSV, to the last bit; texts are texts.
#[tokio::test]
async fn a_table_says_what_the_text_says_with_units_and_provenance() {
    let (bench, study) = flown(false).await;
    let request = Request::get(format!("{study}/dataset")).header("accept", "application/vnd.apache.parquet");
    let answer = bench.send(request.body(Body::empty()).expect("a request")).await;
    assert_eq!(answer.header("content-type"), "application/vnd.apache.parquet");
    let reader = ParquetRecordBatchReaderBuilder::try_new(answer.body).expect("a table");
    let (schema, file) = (reader.schema().clone(), reader.metadata().file_metadata().clone());
    let batches: Vec<_> = reader.build().expect("reads").collect::<Result<_, _>>().expect("batches");
    let csv = bench.get(&format!("{study}/dataset?format=csv")).await.body;
    let text = String::from_utf8(csv.to_vec()).expect("text");
    let mut lines = text.split_terminator("\r\n").map(|line| line.split(',').collect::<Vec<_>>());
    let names = lines.next().expect("a header");
    assert_eq!(schema.fields().iter().map(|f| f.name().as_str()).collect::<Vec<_>>(), names);
    assert_eq!(batches.iter().map(RecordBatch::num_rows).sum::<usize>(), 20);
    for (row, line) in lines.enumerate() {
        for (column, cell) in batches[0].columns().iter().zip(line) {
            match column.data_type() {
                DataType::Float64 if cell.is_empty() => assert!(column.is_null(row)),
                DataType::Float64 => {
                    assert_eq!(column.as_primitive::<Float64Type>().value(row), cell.parse::<f64>().expect("a number"));
                }
                DataType::Int64 => assert_eq!(column.as_primitive::<Int64Type>().value(row).to_string(), cell),
                _ if column.is_null(row) => assert_eq!(cell, ""),
                _ => assert_eq!(column.as_string::<i32>().value(row), cell),
            }
        }
    }
    let unit = |name: &str| schema.field_with_name(name).expect("a column").metadata()["unit"].clone();
    assert_eq!(["frequency_hz", "sweep_shape", "pitch_moment_nm_se", "lift"].map(unit), ["Hz", "1", "N m", "1"]);
    let facts: Vec<_> = file.key_value_metadata().cloned().unwrap_or_default();
    let fact = |key: &str| facts.iter().find(|f| f.key == format!("manduca.{key}")).and_then(|f| f.value.clone());
    assert!(fact("study").is_some_and(|id| study.ends_with(&id)) && fact("model").is_some_and(|m| m.contains("uvlm")));
    assert_eq!((fact("seed").as_deref(), fact("rows").as_deref()), (Some("5"), Some("20")));
    assert_eq!(fact("dataset_blake3"), Some(blake3::hash(&csv).to_hex().to_string()));
}

/// A finished study of so many samples.
async fn finished(samples: u32) -> (Bench, String) {
    let bench = Bench::open_with(|config| config.keep = Some(Duration::from_secs(60))).await;
    let path = bench.submit(&study(samples, &[])).await;
    bench.work_off(&bench.worker("w").await).await;
    assert_eq!(bench.view(&path).await["state"], "succeeded");
    (bench, path)
}

/// Removes the finished study, its time being over.
async fn remove(bench: &Bench) {
    bench.pass(100.0).await;
    let began = bench.state.now_ms();
    assert_eq!(bench.state.store().run(Prune { began }).await.expect("removes"), Pruned::One);
}

#[tokio::test]
async fn a_dataset_whose_study_is_removed_meanwhile_breaks_off() {
    for format in ["json", "ndjson", "csv", "parquet"] {
        let (bench, path) = finished(1200).await;
        let request = Request::get(format!("{path}/dataset?format={format}")).body(Body::empty());
        let response = bench.router.clone().oneshot(request.expect("a request")).await.expect("answers");
        assert_eq!(
            (response.status().as_u16(), &response.headers()["manduca-rows"]),
            (200, &"1200".parse().expect("a header"))
        );
        let mut body = response.into_body().into_data_stream();
        if format != "parquet" {
            // Of a table nothing is sent before its first row group is full.
            assert!(body.next().await.is_some_and(|part| part.is_ok()), "{format}");
        }
        remove(&bench).await;
        // Its number is given to the next study, whose rows are none of this dataset.
        let next = bench.submit(&study(1500, &[])).await;
        bench.work_off(&bench.worker("another").await).await;
        assert_eq!(bench.view(&next).await["state"], "succeeded");
        let parts: Vec<_> = body.collect().await;
        assert!(parts.last().is_some_and(Result::is_err), "{format}: a dataset cut short looks whole");
    }
}

#[tokio::test]
async fn a_whole_dataset_has_the_rows_it_announces() {
    let (bench, path) = finished(600).await;
    let answer = bench.get(&format!("{path}/dataset?format=ndjson")).await;
    let lines = answer.body.iter().filter(|byte| **byte == b'\n').count();
    assert_eq!((answer.header("manduca-rows"), lines), ("600", 600));
}

#[tokio::test]
async fn other_formats_are_refused() {
    let bench = Bench::open().await;
    let study = bench.submit(&study(20, &[])).await;
    assert_eq!(bench.get(&format!("{study}/dataset")).await.json(), json!([]));
    let empty = bench.get(&format!("{study}/dataset?format=parquet")).await;
    assert!(ParquetRecordBatchReaderBuilder::try_new(empty.body).is_ok_and(|r| r.schema().fields().len() == 30));
    let pointers = bench.get(&format!("{study}/dataset?format=xml")).await.problem(400, "invalid-query");
    assert_eq!(pointers, ["/format"]);
    let request = Request::get(format!("{study}/dataset")).header("accept", "image/png").body(Body::empty());
    bench.send(request.expect("a request")).await.problem(406, "not-acceptable");
}
