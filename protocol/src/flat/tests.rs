use serde_json::{Value, json};

use super::*;

fn infeasible() -> Value {
    json!({ "reason": "too slow", "outcome": "infeasible", "solver_version": "9", "kind": "simulate" })
}

#[test]
fn the_tag_may_come_last_and_comes_back() {
    let result: JobResult =
        serde_json::from_str(r#"{"reason":"too slow","outcome":"infeasible","solver_version":"9","kind":"simulate"}"#)
            .unwrap();
    assert_eq!(serde_json::to_value(&result).unwrap(), infeasible());
    let frame = json!({ "arm": [0.1, 0.2], "features": "physical", "mirror": true, "reference_hz": 25.0 });
    let frame: FrameMessage = serde_json::from_value(frame).unwrap();
    assert!(matches!(frame, FrameMessage::Physical { sharpness: false, mirror: true, .. }));
    for state in [SearchState::Breed(BreedState::default()), SearchState::Refine(RefineState::first(Vec::new()))] {
        let json = serde_json::to_value(&state).unwrap();
        assert_eq!(serde_json::from_value::<SearchState>(json).unwrap(), state);
    }
    for next in [
        SearchNext::Done { reason: "x".into(), converged: true },
        SearchNext::Fly {
            state: Box::new(SearchState::Breed(BreedState::default())),
            strokes: vec![ParameterValues([1.0; 10])],
        },
    ] {
        let json = serde_json::to_value(&next).unwrap();
        assert_eq!(serde_json::from_value::<SearchNext>(json).unwrap(), next);
    }
}

#[test]
fn fields_nobody_knows_or_of_another_kind_are_refused_where_they_stand() {
    let told = |result: Value| serde_json::from_value::<JobResult>(result).unwrap_err().to_string();
    let with = |name: &str, value: Value| {
        let mut result = infeasible();
        result[name] = value;
        result
    };
    for (result, expected) in [
        (with("colour", json!([{ "": 0 }])), "unknown field `colour`"),
        (with("stops", json!(["x"])), "unknown field `stops`"),
        (with("strokes_averaged", json!(3)), "unknown field `strokes_averaged`"),
        (with("kind", json!("dream")), "unknown variant `dream`"),
        (with("kind", json!("search")), "unknown field `outcome`"),
        (with("reason", Value::Null), "missing field `reason`"),
        (json!({ "kind": "train", "solver_version": "9" }), "missing field `surrogate`"),
        (json!({ "kind": "train" }), "missing field `solver_version`"),
    ] {
        let told = told(result.clone());
        assert!(told.contains(expected), "{result}: {told}");
    }
}

#[test]
fn lists_of_small_values_are_bounded_while_they_are_read() {
    let stops = format!(r#"{{"kind":"train","stops":[{}]}}"#, r#""","#.repeat(1_000_000));
    let told = serde_json::from_str::<JobResult>(&stops).unwrap_err().to_string();
    assert!(told.contains("more than 64 items"), "{told}");
    let elite = format!(r#"{{"search":"breed","elite":[{}0]}}"#, "0,".repeat(1_000_000));
    let told = serde_json::from_str::<SearchState>(&elite).unwrap_err().to_string();
    assert!(told.contains("more than"), "{told}");
}
