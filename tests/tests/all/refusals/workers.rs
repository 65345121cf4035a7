//! Refused workers and refused exchanges.

use serde_json::{Value, json};

use super::Refusal;

const WORKERS: &str = "/v1/workers";
const NO_ONE: &str = "00000000-0000-7000-8000-000000000000";

/// A worker as it introduces itself.
pub fn registration() -> Value {
    json!({ "name": "test", "slots": 1, "protocol_version": 1, "solver_version": solver_version(), "level": "portable" })
}

/// The version this repository's coordinator wants.
fn solver_version() -> &'static str {
    manduca_tests::SOLVER_VERSION
}

/// Workers which are not taken.
pub fn registrations() -> Vec<Refusal> {
    let with = |field: &str, value: Value| {
        let mut body = registration();
        body[field] = value;
        body.to_string()
    };
    let body = |what, body: String, status, kind| Refusal::body(what, WORKERS, body, status, kind);
    let invalid =
        |what, field: &'static str, value, pointer| body(what, with(field, value), 422, "invalid-request").at(pointer);
    let exchange = |id: &str| format!("/v1/workers/{id}/exchange");
    vec![
        body("another exchange", with("protocol_version", json!(99)), 426, "protocol-version").at("/protocol_version"),
        body("other numbers", with("solver_version", json!("0")), 409, "solver-version").at("/solver_version"),
        body("no JSON", "worker".into(), 400, "malformed-json").at(""),
        body("an empty body", String::new(), 400, "malformed-json").at(""),
        invalid("no name", "name", json!(""), "/name"),
        invalid("a name of two lines", "name", json!("two\nlines"), "/name"),
        invalid("no slots", "slots", json!(0), "/slots"),
        invalid("a host of slots", "slots", json!(1_000_000), "/slots"),
        invalid("negative slots", "slots", json!(-1), "/slots"),
        invalid("an unknown field", "colour", json!(1), "/colour"),
        Refusal::body("nobody's exchange", &exchange(NO_ONE), "{}", 404, "unknown-worker"),
        Refusal::body("a malformed id", &exchange("seventeen"), "{}", 404, "unknown-worker"),
        Refusal::of("DELETE", &format!("/v1/workers/{NO_ONE}"), 404, "unknown-worker"),
        Refusal::of("DELETE", "/v1/workers/seventeen", 404, "unknown-worker"),
    ]
}

/// Exchanges of a registered worker which are refused whole.
pub fn exchanges(path: &str) -> Vec<Refusal> {
    let invalid =
        |what, body: Value, pointer| Refusal::body(what, path, body.to_string(), 422, "invalid-request").at(pointer);
    let failure = json!({ "job": 1, "attempt": 1, "reason": "x" });
    vec![
        invalid("an unknown field", json!({ "colour": 1 }), "/colour"),
        invalid("too many wanted", json!({ "want": 1001 }), "/want"),
        invalid("a negative number wanted", json!({ "want": -1 }), "/want"),
        invalid("a wait into the past", json!({ "wait_s": -1 }), "/wait_s"),
        invalid("too many failures", json!({ "fail": vec![failure; 1001] }), "/fail"),
        invalid("a failure without a reason", json!({ "fail": [{ "job": 1, "attempt": 1 }] }), "/fail/0/reason"),
        Refusal::body("a wait for ever", path, "{\"wait_s\": 1e999}", 400, "malformed-json").at("/wait_s"),
        Refusal::body("no body", path, "", 400, "malformed-json").at(""),
    ]
}
