//! Strokes flown for who looks at them.

use std::time::Duration;

use manduca_numerics::cases::CASES;
use manduca_protocol::point::ParameterValues;
use serde_json::{Value, json};
use tokio::task::JoinSet;

use super::answers::study;
use super::bench::{Answer, Bench};
use crate::turn::QUEUE;

/// A flight of a moment: at most 4 strokes of 40 steps.
fn tiny() -> Value {
    json!({ "solver": {
        "chordwise_panels": 2, "spanwise_panels": 3, "steps_per_stroke": 40, "strokes": 2, "strokes_dropped": 1,
        "strokes_most": 4, "wake_strokes": 0.5,
    }})
}

/// A flight which ends when it is told to, or after a minute; just within the limit.
fn long() -> Value {
    json!({ "solver": { "steps_per_stroke": 144, "strokes": 16, "strokes_most": 16 } })
}

fn stroke(frequency_hz: f64) -> Value {
    let mut point = CASES[0].parameters;
    point[0] = frequency_hz;
    serde_json::to_value(ParameterValues(point)).expect("a stroke")
}

async fn look(bench: &Bench, request: &Value) -> Answer {
    bench.post("/v1/simulations", request.to_string()).await
}

#[tokio::test]
async fn a_stroke_is_flown_and_its_last_stroke_shown() {
    let bench = Bench::open().await;
    let request = json!({ "model": tiny(), "parameters": stroke(26.0), "wake": "stroke" });
    let answer = look(&bench, &request).await;
    assert_eq!(answer.status, 200, "{:?}", answer.body);
    let view = answer.json();
    assert_eq!((&view["outcome"], &view["strokes_dropped"]), (&json!("ok"), &json!(1)));
    assert!(view["means"]["lift_n"]["se"].is_number() && view["scaled"]["power"]["mean"].is_number(), "{view}");
    assert_eq!((&view["model"]["solver"]["strokes_most"], &view["parameters"]), (&json!(4.0), &request["parameters"]));
    let history = view["history"].as_array().expect("rows");
    let steps: Vec<_> = history.iter().filter_map(|row| row["step"].as_u64()).collect();
    assert_eq!(steps, (0..40).collect::<Vec<_>>());
    assert!(history.iter().all(|row| row["stroke"] == history[0]["stroke"] && row["lift_n"].is_number()));
    let wake = view["wake"].as_array().expect("steps");
    let steps: Vec<_> = wake.iter().filter_map(|step| step["step"].as_u64()).collect();
    assert_eq!(steps, (0..20).map(|i| 2 * i).collect::<Vec<_>>(), "thinned to at most 32");
    assert_eq!(wake[0]["stroke"], history[0]["stroke"]);
    assert_eq!((&wake[0]["wing_rows"], wake[0]["nodes"][0].as_array().map(Vec::len)), (&json!(3), Some(4)));
    assert!(wake[0]["circulation_m2_s"][0][0].is_number());
    // Asked for again, as a part of it, and with nothing said of the wake.
    assert_eq!(look(&bench, &request).await.body, answer.body);
    let last = look(&bench, &json!({ "model": tiny(), "parameters": stroke(26.0), "wake": "last" })).await.json();
    assert_eq!((last["wake"].as_array().map(Vec::len), &last["wake"][0]["step"]), (Some(1), &json!(39)));
    let bare = look(&bench, &json!({ "model": tiny(), "parameters": stroke(26.0) })).await.json();
    assert_eq!((&bare["wake"], &bare["means"]), (&json!([]), &view["means"]));
}

#[tokio::test]
async fn the_model_is_a_study_s_or_the_default() {
    let bench = Bench::open().await;
    let mut spec = study(20, &[]);
    spec["model"] = json!({ "kind": "quasi-steady", "elastic_storage": 0.5 });
    let path = bench.submit(&spec).await;
    let id = path.trim_start_matches("/v1/studies/");
    let view = look(&bench, &json!({ "study": id, "parameters": stroke(26.0) })).await.json();
    assert_eq!((&view["model"]["kind"], &view["model"]["elastic_storage"]), (&json!("quasi-steady"), &json!(0.5)));
    assert!(view["history"].as_array().is_some_and(|rows| !rows.is_empty()));
    let refused = look(&bench, &json!({ "study": id, "parameters": stroke(26.0), "wake": "last" })).await;
    assert_eq!(refused.problem(422, "invalid-request"), ["/wake"]);
}

#[tokio::test]
async fn a_stroke_which_cannot_be_flown_is_an_answer() {
    let bench = Bench::open().await;
    let mut parameters = stroke(26.0);
    (parameters["sweep_mean_deg"], parameters["sweep_amplitude_deg"]) = (json!(60.0), json!(90.0));
    let answer = look(&bench, &json!({ "parameters": parameters, "wake": "stroke" })).await;
    let view = answer.json();
    assert_eq!((answer.status.as_u16(), &view["outcome"]), (200, &json!("infeasible")), "{view}");
    assert!(view["reason"].as_str().is_some_and(|r| r.contains("cross")), "{view}");
    assert_eq!((&view["history"], &view["wake"]), (&json!([]), &json!([])));
}

#[tokio::test]
async fn what_is_wrong_with_a_request_is_named() {
    let bench = Bench::open().await;
    let nobody = "0190a000-0000-7000-8000-000000000000";
    let huge = json!({ "solver": { "chordwise_panels": 16, "spanwise_panels": 24, "steps_per_stroke": 200 } });
    let cases = [
        (json!({ "study": nobody }), "/study"),
        (json!({ "study": "latest" }), "/study"),
        (json!({ "study": nobody, "model": {} }), "/model"),
        (json!({ "model": { "insect": "mosquito" } }), "/model/insect"),
        (json!({ "model": huge }), "/model"),
        (json!({ "wake": "all" }), "/wake"),
        (json!({ "colour": "red" }), "/colour"),
        (json!({ "parameters": stroke(1e6) }), "/parameters/frequency_hz"),
        (json!({ "parameters": {} }), "/parameters/frequency_hz"),
    ];
    for (changes, pointer) in cases {
        let mut request = json!({ "parameters": stroke(26.0) });
        for (name, value) in changes.as_object().expect("an object") {
            request[name] = value.clone();
        }
        assert_eq!(look(&bench, &request).await.problem(422, "invalid-request"), [pointer], "{request}");
    }
}

/// One flies, some wait, one more is refused; who hangs up makes room.
#[tokio::test]
async fn so_many_wait_and_who_hangs_up_makes_room() {
    let bench = std::sync::Arc::new(Bench::open().await);
    let mut waiting = JoinSet::new();
    for i in 0..QUEUE + 2 {
        let bench = bench.clone();
        let request = json!({ "model": long(), "parameters": stroke(20.0 + i as f64) });
        waiting.spawn(async move { look(&bench, &request).await });
    }
    let refused = waiting.join_next().await.expect("one of them").expect("an answer");
    assert_eq!(refused.problem(429, "busy"), Vec::<String>::new());
    assert_eq!(refused.header("retry-after"), "1");
    assert_eq!(waiting.len(), QUEUE + 1);
    waiting.shutdown().await;
    let quick = json!({ "model": tiny(), "parameters": stroke(26.0) });
    loop {
        let answer = look(&bench, &quick).await;
        if answer.status == 200 {
            break;
        }
        answer.problem(429, "busy");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

#[tokio::test]
async fn a_coordinator_which_stops_waits_for_no_flight() {
    let bench = std::sync::Arc::new(Bench::open().await);
    let mut waiting = JoinSet::new();
    for i in 0..3 {
        let bench = bench.clone();
        let request = json!({ "model": long(), "parameters": stroke(20.0 + f64::from(i)) });
        waiting.spawn(async move { look(&bench, &request).await });
    }
    tokio::time::sleep(Duration::from_millis(50)).await;
    bench.state.stopping().cancel();
    for answer in waiting.join_all().await {
        answer.problem(503, "unavailable");
        assert_eq!(answer.header("retry-after"), "1");
    }
}
