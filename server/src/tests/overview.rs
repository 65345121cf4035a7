//! What pages about a study are drawn from, the page itself, and the stream of changes.

use std::time::Duration;

use axum::body::Body;
use axum::http::Request;
use futures_util::StreamExt;
use serde_json::{Value, json};
use tower::ServiceExt;

use super::answers::{completion, infeasible, result, study};
use super::bench::Bench;

/// A study with 20 samples flown, after two which cannot be.
async fn sampled(bench: &Bench, worker: &str) -> String {
    let study = bench.submit(&study(20, &[])).await;
    let first = bench.claim(worker, 100).await;
    let answer = |(i, lease)| completion(lease, if i < 2 { infeasible("by 1.5 mm") } else { result(lease) });
    let results: Vec<_> = first.iter().enumerate().map(answer).collect();
    bench.exchange(worker, json!({ "complete": results })).await;
    bench.pass(9.5).await;
    let further = bench.claim(worker, 100).await;
    assert_eq!(further.len(), 2);
    let results: Vec<_> = further.iter().map(|lease| completion(lease, result(lease))).collect();
    bench.exchange(worker, json!({ "complete": results })).await;
    study
}

#[tokio::test]
async fn points_are_thinned_and_know_their_share() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let study = sampled(&bench, &worker).await;
    let all = bench.get(&format!("{study}/points")).await.json();
    assert_eq!((all["total"].as_u64(), all["samples"].as_array().map(Vec::len)), (Some(20), Some(20)));
    assert_eq!((&all["samples"][0], all.get("predicted"), all.get("shares")), (&json!(2), None, None));
    assert_eq!(all["parameters"][0].as_array().map(Vec::len), Some(10));
    let (lift, frequency) = (all["simulated"][3][0].as_f64(), all["parameters"][3][0].as_f64());
    assert!((lift.unwrap() * 25.0 / frequency.unwrap() - 1.0).abs() < 1e-4, "{lift:?} at {frequency:?}");
    let few = bench.get(&format!("{study}/points?limit=5")).await.json();
    assert_eq!((few["total"].as_u64(), &few["samples"]), (Some(20), &json!([2, 6, 10, 14, 18])));
    bench.get(&format!("{study}/points?share=test")).await.problem(404, "not-yet");
    assert_eq!(bench.get(&format!("{study}/points?limit=2001")).await.problem(400, "invalid-query"), ["/limit"]);

    bench.work_off(&worker).await;
    let mut seen = Vec::new();
    for (share, count) in [("train", 16), ("validation", 2), ("test", 2)] {
        let of = bench.get(&format!("{study}/points?share={share}")).await.json();
        assert_eq!(
            (of["total"].as_u64(), of["predicted"].as_array().map(Vec::len)),
            (Some(count), Some(count as usize))
        );
        assert!(of["shares"].as_array().expect("shares").iter().all(|s| s == share), "{of}");
        seen.extend(of["samples"].as_array().expect("samples").iter().filter_map(Value::as_u64));
    }
    seen.sort_unstable();
    assert_eq!(seen, (2..22).collect::<Vec<_>>());
}

#[tokio::test]
async fn results_are_counted_by_time_and_failures_by_reason() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let study = sampled(&bench, &worker).await;
    let told = bench.get(&format!("{study}/throughput")).await.json();
    assert_eq!(
        (told["interval_s"].as_f64(), &told["results"][0], &told["results"][9]),
        (Some(1.0), &json!(20), &json!(2))
    );
    let told = bench.get(&format!("{study}/throughput?intervals=2")).await.json();
    assert_eq!((told["interval_s"].as_f64(), &told["results"]), (Some(5.0), &json!([20, 2])));
    let groups = bench.get(&format!("{study}/failures")).await.json();
    assert_eq!(groups.as_array().map(Vec::len), Some(1));
    let group = &groups[0];
    assert_eq!((&group["state"], &group["role"], &group["jobs"]), (&json!("infeasible"), &json!("sample"), &json!(2)));
    assert_eq!((&group["reason"], &group["example_reason"]), (&json!("by … mm"), &json!("by 1.5 mm")));
    for path in ["points", "throughput", "failures", "wing"] {
        let nowhere = format!("/v1/studies/01920000-0000-7000-8000-000000000000/{path}");
        bench.get(&nowhere).await.problem(404, "unknown-study");
    }
}

#[tokio::test]
async fn the_wing_and_the_tables_are_those_of_the_numerics() {
    let bench = Bench::open().await;
    let mut spec = study(20, &[]);
    spec["model"] = json!({ "insect_changes": { "hinge_offset_m": 0.01 }, "elevation_phase": "minus" });
    let study = bench.submit(&spec).await;
    let wing = bench.get(&format!("{study}/wing")).await.json();
    assert_eq!((wing["hinge_offset_m"].as_f64(), &wing["elevation_phase"]), (Some(0.01), &json!("minus")));
    let stations = wing["stations"].as_array().expect("stations");
    let tip = stations.last().and_then(|s| s[0].as_f64()).expect("a tip");
    assert!((tip - wing["wing_length_m"].as_f64().expect("a length")).abs() < 1e-12);
    assert!(stations[9][1].as_f64() > Some(0.0) && stations[9][2].as_f64() < Some(0.0), "{}", stations[9]);
    let reference = bench.get("/v1/reference").await.json();
    assert_eq!(
        (&reference["parameters"][0]["name"], &reference["outputs"][3]["symbol"]),
        (&json!("frequency_hz"), &json!("P+"))
    );
    assert_eq!(reference["cases"].as_array().map(Vec::len), Some(5));
}

#[tokio::test]
async fn the_page_and_its_files_are_served() {
    let bench = Bench::open().await;
    let page = bench.get("/").await;
    assert_eq!((page.status.as_u16(), page.header("content-type")), (200, "text/html; charset=utf-8"));
    assert!(page.header("content-security-policy").starts_with("default-src 'self';"));
    let text = String::from_utf8(page.body.to_vec()).expect("text");
    let mut files: Vec<&str> = text.split('"').filter(|part| part.starts_with("/assets/")).collect();
    files.push("/assets/vendor/plotly-strict-4.1.1.min.js.gz");
    files.push("/assets/studies/quick.toml");
    for file in files {
        let answer = bench.get(file).await;
        assert!(answer.status == 200 && !answer.body.is_empty(), "{file}");
        let again = Request::get(file).header("if-none-match", answer.header("etag")).body(Body::empty());
        assert_eq!(bench.send(again.expect("a request")).await.status, 304, "{file}");
    }
    let library = bench.get("/assets/vendor/plotly-strict-4.1.1.min.js.gz").await;
    assert_eq!(
        (library.header("content-encoding"), library.header("content-type")),
        ("gzip", "text/javascript; charset=utf-8")
    );
    assert!(library.header("cache-control").contains("immutable") && library.body.starts_with(&[0x1f, 0x8b]));
    bench.get("/assets/../Cargo.toml").await.problem(404, "no-route");
}

#[tokio::test]
async fn every_file_a_script_imports_is_there_and_of_this_coordinator() {
    let bench = Bench::open().await;
    let (mut seen, mut next) = (Vec::new(), vec!["main.js".to_owned()]);
    while let Some(name) = next.pop() {
        if seen.contains(&name) {
            continue;
        }
        let answer = bench.get(&format!("/assets/{name}")).await;
        assert_eq!(answer.status, 200, "{name}");
        let script = String::from_utf8(answer.body.to_vec()).expect("text");
        assert!(!script.contains("http://") && !script.contains("https://"), "{name} names another host");
        assert!(script.lines().count() <= 450, "{name} is too long");
        next.extend(script.split("from \"./").skip(1).filter_map(|rest| Some(rest.split_once('"')?.0.to_owned())));
        seen.push(name);
    }
    assert!(seen.len() > 10, "{seen:?}");
}

#[tokio::test]
async fn changes_are_told_as_they_happen_until_the_coordinator_stops() {
    let bench = Bench::open_with(|config| config.watchers = 1).await;
    let first = bench.submit(&study(20, &[])).await;
    let id = first.rsplit('/').next().expect("an id").to_owned();
    let request = Request::get(format!("/v1/events?study={id}")).body(Body::empty()).expect("a request");
    let answer = bench.router.clone().oneshot(request).await.expect("answers");
    assert_eq!(answer.headers()["content-type"], "text/event-stream");
    let mut events = answer.into_body().into_data_stream();
    let hello = events.next().await.expect("an event").expect("bytes");
    assert!(hello.starts_with(b"event: changed\ndata: {") && contains(&hello, "\"everything\":true"));
    let refused = bench.get("/v1/events").await;
    refused.problem(503, "too-many-watchers");
    assert_eq!(refused.header("retry-after"), "10");

    bench.submit(&study(21, &[])).await;
    bench.post(&format!("{first}/pause"), "").await;
    let told = tokio::time::timeout(Duration::from_secs(20), events.next()).await.expect("in time");
    let told = told.expect("an event").expect("bytes");
    assert!(contains(&told, &format!("\"studies\":[\"{id}\"]")) && contains(&told, "\"everything\":false"));
    bench.state.stopping().cancel();
    let end = tokio::time::timeout(Duration::from_secs(20), events.next()).await.expect("in time");
    assert!(end.is_none(), "the stream ends with the coordinator");
    drop(events);
    bench.get("/v1/events?study=01920000-0000-7000-8000-000000000000").await.problem(404, "unknown-study");
    assert_eq!(bench.get("/v1/events?colour=1").await.status, 400);
}

fn contains(bytes: &[u8], text: &str) -> bool {
    String::from_utf8_lossy(bytes).contains(text)
}

#[tokio::test]
async fn a_study_may_be_sent_as_toml() {
    let bench = Bench::open().await;
    let send = |text: &'static str, query: &str| {
        let request = Request::post(format!("/v1/studies{query}")).header("content-type", "application/toml");
        bench.send(request.body(Body::from(text)).expect("a request"))
    };
    let text = "name = \"t\"\n[sampling]\nsamples = 20\n[parameters]\nfrequency_hz = [20, 30]\n";
    assert_eq!(send(text, "?dry_run=true").await.json(), json!({ "simulations": 20, "errors": [] }));
    let answer = send(text, "").await;
    assert_eq!((answer.status.as_u16(), &answer.json()["spec"]["name"]), (201, &json!("t")));
    let pointers = send("name = \"t\"\n[sampling]\nsamples = 3\n", "").await.problem(422, "invalid-study");
    assert_eq!(pointers, ["/sampling/samples"]);
    assert_eq!(send("name = ", "").await.problem(400, "malformed-toml"), [""]);
    let worker = Request::post("/v1/workers").header("content-type", "application/toml").body(Body::from("a = 1"));
    bench.send(worker.expect("a request")).await.problem(415, "unsupported-media-type");
}
