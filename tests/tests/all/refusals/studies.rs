//! Refused studies, and refused questions about studies.

use manduca_tests::studies::blades;
use serde_json::{Map, Value, json};

use super::{JSON, Refusal, study};

const STUDIES: &str = "/v1/studies";
const NO_ONE: &str = "00000000-0000-7000-8000-000000000000";

/// A setting twice, with one value.
const TWICE: &str = r#"{"strokes": 8, "strokes": 8}"#;

/// A good study with a literal put in by hand, for what [`Value`] cannot hold.
fn with(mark: &str, literal: &str) -> String {
    let text = study(|s| s["model"][mark] = json!("HERE"));
    text.replace("\"HERE\"", literal)
}

fn malformed(what: &'static str, body: impl Into<String>, pointer: &'static str) -> Refusal {
    Refusal::body(what, STUDIES, body, 400, "malformed-json").at(pointer)
}

/// What is no study at all.
pub fn syntax() -> Vec<Refusal> {
    let good = study(|_| ());
    let large = study(|s| s["description"] = json!("x".repeat(11 << 20)));
    vec![
        malformed("a NaN literal", with("elastic_storage", "NaN"), "/model/elastic_storage"),
        malformed("an Infinity literal", with("elastic_storage", "-Infinity"), "/model/elastic_storage"),
        malformed("a number no double holds", with("elastic_storage", "1e999"), "/model/elastic_storage"),
        malformed("an empty body", "", ""),
        malformed("no JSON", "name = \"toml\"", ""),
        malformed("a body broken off", &good[..good.len() - 1], ""),
        malformed("something after the study", format!("{good} {{}}"), ""),
        malformed("bytes which are no text", "{\"name\": \"\u{1}\"}", "/name"),
        Refusal::study("an empty object", "{}", "/name"),
        Refusal::study("an array", "[]", ""),
        Refusal::study("a study by position", r#"["x", "", 1, {}, {}, { "samples": 30 }, {}, []]"#, ""),
        Refusal::study("a sampling by position", study(|s| s["sampling"] = json!([30, 0])), "/sampling"),
        Refusal::study("a model by position", study(|s| s["model"] = json!(["uvlm"])), "/model"),
        Refusal::study("a network by position", study(|s| s["surrogate"] = json!([6, 30])), "/surrogate"),
        Refusal::study(
            "an optimisation by position",
            study(|s| s["optimisations"] = json!([["x"]])),
            "/optimisations/0",
        ),
        Refusal::study("a setting given twice", with("solver", TWICE), "/model/solver/strokes"),
        Refusal::study("a list of studies", format!("[{good}]"), ""),
        Refusal::study("null", "null", ""),
        Refusal::study("a number", "17", ""),
        Refusal::study("a name given twice", good.replacen('{', "{\"name\":\"twice\",", 1), "/name"),
        Refusal::body("a body of 11 MB", STUDIES, large, 413, "body-too-large"),
        Refusal {
            body: Some(("text/plain", good.clone())),
            ..Refusal::body("another content type", STUDIES, "", 415, "unsupported-media-type")
        },
        Refusal {
            body: Some(("application/yaml", good)),
            ..Refusal::body("another content type", STUDIES, "", 415, "unsupported-media-type")
        },
    ]
}

/// Parameters outside what the model carries.
pub fn bounds() -> Vec<Refusal> {
    let with = |name: &'static str, range: Value| study(|s| s["parameters"] = json!({ name: range }));
    let held: Map<String, Value> = [
        "frequency_hz",
        "stroke_plane_deg",
        "sweep_mean_deg",
        "elevation_mean_deg",
        "rotation_mean_deg",
        "sweep_amplitude_deg",
        "elevation_amplitude_deg",
        "rotation_amplitude_deg",
        "sweep_shape",
        "rotation_shape",
    ]
    .map(|name| (name.to_owned(), json!(if name == "frequency_hz" { 26 } else { 0 })))
    .into_iter()
    .collect();
    let collide = json!({ "sweep_mean_deg": 60, "sweep_amplitude_deg": 90 });
    vec![
        Refusal::study("revolutions per minute", with("frequency_hz", json!([3000, 4000])), "/parameters/frequency_hz"),
        Refusal::study("inverted bounds", with("frequency_hz", json!([40, 15])), "/parameters/frequency_hz"),
        Refusal::study("one bound", with("frequency_hz", json!([15])), "/parameters/frequency_hz"),
        Refusal::study("three bounds", with("frequency_hz", json!([15, 20, 40])), "/parameters/frequency_hz"),
        Refusal::study("bounds in words", with("frequency_hz", json!("fast")), "/parameters/frequency_hz"),
        Refusal::study("a held value of null", with("frequency_hz", Value::Null), "/parameters/frequency_hz"),
        Refusal::study("an unknown parameter", with("frequency_khz", json!(0.03)), "/parameters/frequency_khz"),
        Refusal::study("a name to be escaped", with("f/~", json!(1)), "/parameters/f~1~0"),
        Refusal::study("all parameters held", study(|s| s["parameters"] = Value::Object(held)), "/parameters"),
        Refusal::study("wings which always collide", study(|s| s["parameters"] = collide.clone()), "/parameters"),
        // However many samples are wanted: finding none must not take minutes.
        Refusal::study(
            "a great many collisions",
            study(|s| {
                s["parameters"] = collide.clone();
                s["sampling"]["samples"] = json!(200_000);
            }),
            "/parameters",
        ),
        Refusal::study(
            "a clearance no wing has",
            study(|s| s["sampling"]["clearance_margin_mm"] = json!(900)),
            "/parameters",
        ),
    ]
}

/// Numbers of samples, seeds, settings of solver, insect and network.
pub fn settings() -> Vec<Refusal> {
    let at = |pointer: &'static str, value: Value| {
        study(|s| {
            s["model"] = json!({ "kind": "uvlm", "solver": {}, "insect_changes": {} });
            let (object, field) = pointer.rsplit_once('/').unwrap();
            s.pointer_mut(object).unwrap()[field] = value;
        })
    };
    let refused = |what, pointer, value| Refusal::study(what, at(pointer, value), pointer);
    let heavy = study(|s| {
        s["sampling"]["samples"] = json!(20_000);
        s["surrogate"]["kind"] = json!("gaussian-process");
    });
    vec![
        Refusal::study("a gaussian process of too many samples", heavy, "/surrogate/kind"),
        refused("an unknown field", "/colour", json!("red")),
        refused("an unknown field below", "/sampling/colour", json!("red")),
        refused("no name", "/name", json!("")),
        refused("a name too long", "/name", json!("n".repeat(101))),
        refused("a name of two lines", "/name", json!("two\nlines")),
        refused("a description too long", "/description", json!("d".repeat(10_001))),
        refused("a seed not every reader holds", "/seed", json!(1_u64 << 53)),
        refused("a negative seed", "/seed", json!(-1)),
        refused("no samples", "/sampling/samples", json!(0)),
        refused("a thousand million samples", "/sampling/samples", json!(1_000_000_000)),
        refused("more samples than a number holds", "/sampling/samples", json!(1_u64 << 40)),
        refused("samples in words", "/sampling/samples", json!("many")),
        refused("half a sample", "/sampling/samples", json!(30.5)),
        refused("no panels", "/model/solver/chordwise_panels", json!(0)),
        refused("half a panel", "/model/solver/chordwise_panels", json!(3.5)),
        refused("all strokes dropped", "/model/solver/strokes_dropped", json!(100)),
        refused("an unknown solver setting", "/model/solver/panels", json!(6)),
        refused("an unknown model", "/model/kind", json!("cfd")),
        refused("an unknown preset", "/model/insect", json!("dragon")),
        refused("an unknown part of an insect", "/model/insect_changes/feathers", json!(2)),
        refused("a wing of negative length", "/model/insect_changes/wing_length_m", json!(-0.05)),
        refused("a spring which returns double", "/model/elastic_storage", json!(2)),
        refused("negative neurons", "/surrogate/neurons", json!(-6)),
        refused("no neurons", "/surrogate/neurons", json!(0)),
        refused("an unknown surrogate", "/surrogate/kind", json!("forest")),
        refused("nothing to test with", "/surrogate/train_share", json!(0.95)),
    ]
}

/// Optimisations.
pub fn optimisations() -> Vec<Refusal> {
    let with = |field: &'static str, value: Value| study(|s| s["optimisations"][0][field] = value);
    let twice = study(|s| s["optimisations"] = json!([{ "name": "same" }, { "name": "same" }]));
    let many = study(|s| s["optimisations"] = (0..33).map(|i| json!({ "name": i.to_string() })).collect());
    let wider = study(|s| {
        s["parameters"] = json!({ "frequency_hz": [20, 30] });
        s["optimisations"][0]["parameters"] = json!({ "frequency_hz": [15, 30] });
    });
    vec![
        Refusal::study("one name for two", twice, "/optimisations/1/name"),
        Refusal::study("too many", many, "/optimisations"),
        Refusal::study("bounds outside the study's", wider, "/optimisations/0/parameters/frequency_hz"),
        Refusal::study("no name", study(|s| s["optimisations"] = json!([{}])), "/optimisations/0/name"),
        Refusal::study("an unknown field", with("colour", json!(1)), "/optimisations/0/colour"),
        Refusal::study("no start", with("starts", json!(0)), "/optimisations/0/starts"),
        Refusal::study("an unknown method", with("method", json!("guess")), "/optimisations/0/method"),
        Refusal::study("nobody", with("population", json!(0)), "/optimisations/0/population"),
        Refusal::study("a negative penalty", with("penalty_r", json!(-1)), "/optimisations/0/penalty_r"),
        Refusal::study("too few strokes", with("verify_strokes", json!(1)), "/optimisations/0/verify_strokes"),
        Refusal::study(
            "too much refining",
            with("refine_simulations", json!(100_000)),
            "/optimisations/0/refine_simulations",
        ),
    ]
}

/// Lists, ids and methods.
pub fn places() -> Vec<Refusal> {
    let query = |path, pointer| Refusal::of("GET", path, 400, "invalid-query").at(pointer);
    let mut refusals = vec![
        query("/v1/studies?limit=0", "/limit"),
        query("/v1/studies?limit=1001", "/limit"),
        query("/v1/studies?limit=ten", "/limit"),
        query("/v1/studies?cursor=nonsense", "/cursor"),
        query("/v1/studies?cursor=7a7a", "/cursor"),
        query("/v1/studies?state=happy", "/state"),
        Refusal::of("GET", "/v1/studies?colour=red", 400, "invalid-query"),
        Refusal::of("GET", "/v1/nothing", 404, "no-route"),
        Refusal::of("GET", "/assets/nothing.js", 404, "no-route"),
        Refusal::of("GET", "/assets/%FF", 404, "no-route"),
        Refusal::of("GET", "/v1/studies/%FF", 404, "no-route"),
        Refusal::of("GET", "/v1/jobs/17", 404, "unknown-job"),
        Refusal::of("GET", "/v1/jobs/none", 404, "unknown-job"),
        Refusal::of("GET", "/v1/jobs/17/task", 404, "unknown-job"),
        Refusal::of("PUT", "/v1/studies", 405, "method-not-allowed"),
        Refusal::of("DELETE", "/healthz", 405, "method-not-allowed"),
        Refusal::of("GET", &format!("/v1/workers/{NO_ONE}/exchange"), 405, "method-not-allowed"),
    ];
    for id in [NO_ONE, "17", "a%2Fb"] {
        for part in ["", "/jobs", "/dataset", "/surrogate", "/optimum"] {
            refusals.push(Refusal::of("GET", &format!("/v1/studies/{id}{part}"), 404, "unknown-study"));
        }
        for action in ["pause", "resume", "cancel", "retry-failed"] {
            refusals.push(Refusal::of("POST", &format!("/v1/studies/{id}/{action}"), 404, "unknown-study"));
        }
    }
    refusals
}

/// What a study which still samples is asked in vain.
pub fn too_early(at: &str) -> Vec<Refusal> {
    let predictions = format!("{at}/surrogate/predictions");
    let point = json!({
        "frequency_hz": 26, "stroke_plane_deg": 15, "sweep_mean_deg": 0, "elevation_mean_deg": 0,
        "rotation_mean_deg": 0, "sweep_amplitude_deg": 55, "elevation_amplitude_deg": 5,
        "rotation_amplitude_deg": 50, "sweep_shape": 0.5, "rotation_shape": 2,
    });
    let points = |change: &dyn Fn(&mut Value)| {
        let mut point = point.clone();
        change(&mut point);
        json!({ "points": [point] }).to_string()
    };
    let invalid =
        |what, body: String, pointer| Refusal::body(what, &predictions, body, 422, "invalid-request").at(pointer);
    let missing = points(&|p| drop(p.as_object_mut().unwrap().remove("sweep_shape")));
    vec![
        Refusal::of("GET", &format!("{at}/surrogate"), 404, "not-yet"),
        Refusal::body("no network yet", &predictions, points(&|_| ()), 404, "not-yet"),
        invalid("a missing parameter", missing, "/points/0/sweep_shape"),
        invalid("an unknown parameter", points(&|p| p["colour"] = json!(1)), "/points/0/colour"),
        invalid("a stroke no model carries", points(&|p| p["frequency_hz"] = json!(4000)), "/points/0/frequency_hz"),
        invalid("an unknown field", json!({ "points": [], "colour": 1 }).to_string(), "/colour"),
        invalid("no points at all", "{}".into(), "/points"),
        invalid("too many points", json!({ "points": vec![point.clone(); 1001] }).to_string(), "/points"),
        Refusal::of("GET", &format!("{at}/dataset?format=xlsx"), 400, "invalid-query").at("/format"),
        Refusal::of("GET", &format!("{at}/jobs?state=lost"), 400, "invalid-query").at("/state"),
        Refusal::of("GET", &format!("{at}/jobs?cursor=00"), 400, "invalid-query").at("/cursor"),
        Refusal {
            body: Some((JSON, blades("x", 1, 30).to_string())),
            ..Refusal::of("POST", at, 405, "method-not-allowed")
        },
    ]
}
