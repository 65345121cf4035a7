//! Everything a client can get wrong is refused: with the right status, as a
//! problem document, naming the field, and leaving nothing behind.

#[path = "refusals/studies.rs"]
mod studies;
#[path = "refusals/workers.rs"]
mod workers;

use manduca_tests::client::{Answer, Client};
use manduca_tests::coordinator::Coordinator;
use manduca_tests::studies::{blades, endless};
use reqwest::RequestBuilder;
use serde_json::{Value, json};

/// A request which is refused, and how.
struct Refusal {
    /// What is wrong, for the message of a failing test.
    what: &'static str,
    method: &'static str,
    path: String,
    /// Content type and body, where there is a body.
    body: Option<(&'static str, String)>,
    status: u16,
    /// Last part of the problem's type.
    kind: &'static str,
    /// JSON pointer of the field at fault, where one is.
    pointer: Option<&'static str>,
}

const JSON: &str = "application/json";

impl Refusal {
    /// A refused request without a body.
    fn of(method: &'static str, path: &str, status: u16, kind: &'static str) -> Self {
        let what = "the request line";
        Self { what, method, path: path.into(), body: None, status, kind, pointer: None }
    }

    /// A refused body.
    fn body(what: &'static str, path: &str, body: impl Into<String>, status: u16, kind: &'static str) -> Self {
        Self { what, body: Some((JSON, body.into())), ..Self::of("POST", path, status, kind) }
    }

    /// A refused study, with the field at fault.
    fn study(what: &'static str, body: impl Into<String>, pointer: &'static str) -> Self {
        Self::body(what, "/v1/studies", body, 422, "invalid-study").at(pointer)
    }

    fn at(self, pointer: &'static str) -> Self {
        Self { pointer: Some(pointer), ..self }
    }

    fn request(&self, client: &Client) -> RequestBuilder {
        let request = client.request(self.method, &self.path);
        match &self.body {
            Some((content_type, body)) => request.header("content-type", *content_type).body(body.clone()),
            None => request,
        }
    }

    /// Fails unless the answer refuses as it should.
    fn check(&self, answer: &Answer) {
        let Self { what, method, path, status, .. } = self;
        let told = format!("{what} ({method} {path}): {}", answer.body);
        assert_eq!(answer.status, *status, "{told}");
        assert_eq!(answer.header("content-type"), "application/problem+json", "{told}");
        let problem = answer.json();
        assert_eq!(problem["type"], format!("urn:manduca:problem:{}", self.kind), "{told}");
        assert_eq!(problem["status"], *status, "{told}");
        for words in ["title", "detail"] {
            assert!(problem[words].as_str().is_some_and(|text| !text.is_empty()), "no {words}: {told}");
        }
        if let Some(pointer) = self.pointer {
            let errors = problem["errors"].as_array().cloned().unwrap_or_default();
            assert!(errors.iter().any(|error| error["pointer"] == pointer), "not at {pointer}: {told}");
            assert!(errors.iter().all(|error| error["detail"] != ""), "{told}");
        }
    }
}

/// Sends all of them, then sees that the coordinator is well and nothing was stored.
fn assert_refused(refusals: &[Refusal]) {
    let coordinator = Coordinator::start();
    for refusal in refusals {
        refusal.check(&coordinator.send(refusal.request(&coordinator)));
    }
    assert_eq!(coordinator.get("/v1/studies"), json!({ "items": [], "next_cursor": null }));
    assert_eq!(coordinator.get("/v1/workers"), json!([]));
    assert_eq!(coordinator.get("/healthz")["status"], "ok");
    assert!(!coordinator.said().contains("panicked"), "{}", coordinator.said());
}

/// A good study, changed.
fn study(change: impl FnOnce(&mut Value)) -> String {
    let mut study = blades("refused", 1, 30);
    change(&mut study);
    study.to_string()
}

#[test]
fn studies_are_refused_field_by_field() {
    let mut refusals = studies::syntax();
    refusals.extend(studies::bounds());
    refusals.extend(studies::settings());
    refusals.extend(studies::optimisations());
    assert!(refusals.len() >= 40, "{}", refusals.len());
    assert_refused(&refusals);
}

#[test]
fn lists_ids_and_methods_are_refused() {
    let mut refusals = studies::places();
    refusals.extend(workers::registrations());
    assert_refused(&refusals);
}

#[test]
fn all_faults_of_a_study_are_told_at_once_and_a_dry_run_tells_the_same() {
    let coordinator = Coordinator::start();
    let body = study(|s| {
        s["name"] = json!("");
        s["sampling"]["samples"] = json!(1);
        s["model"]["elastic_storage"] = json!(2);
        s["optimisations"][0]["population"] = json!(0);
    });
    let send =
        |path| coordinator.send(coordinator.request("POST", path).header("content-type", JSON).body(body.clone()));
    let errors = send("/v1/studies").expect(422)["errors"].clone();
    let pointers: Vec<_> = errors.as_array().unwrap().iter().map(|e| e["pointer"].as_str().unwrap()).collect();
    for pointer in ["/name", "/sampling/samples", "/model/elastic_storage", "/optimisations/0/population"] {
        assert!(pointers.contains(&pointer), "{pointer} in {pointers:?}");
    }
    let dry = send("/v1/studies?dry_run=true").expect(200);
    assert_eq!((&dry["errors"], &dry["simulations"]), (&errors, &json!(0)));
    assert_eq!(coordinator.get("/v1/studies")["items"], json!([]));
}

#[test]
fn a_key_belongs_to_one_study() {
    let coordinator = Coordinator::start();
    let submit = |study: &Value, key: &str| {
        coordinator.send(coordinator.request("POST", "/v1/studies").header("idempotency-key", key).json(study))
    };
    submit(&endless("one"), "key").expect(201);
    let refusal = Refusal::body("another study", "/v1/studies", "", 422, "idempotency-key-reused");
    refusal.at("/headers/idempotency-key").check(&submit(&endless("two"), "key"));
    let refusal = Refusal::body("a long key", "/v1/studies", "", 422, "invalid-request");
    refusal.at("/headers/idempotency-key").check(&submit(&endless("two"), &"k".repeat(256)));
    assert_eq!(coordinator.get("/v1/studies")["items"].as_array().unwrap().len(), 1);
}

#[test]
fn what_a_study_cannot_answer_yet_is_refused() {
    let coordinator = Coordinator::start();
    let id = coordinator.submit(&endless("waits"));
    for refusal in studies::too_early(&format!("/v1/studies/{id}")) {
        refusal.check(&coordinator.send(refusal.request(&coordinator)));
    }
    assert_eq!(coordinator.study(&id)["state"], "sampling");
    coordinator.steer(&id, "cancel");
    for action in ["pause", "resume", "retry-failed"] {
        let refusal = Refusal::of("POST", &format!("/v1/studies/{id}/{action}"), 409, "wrong-state");
        refusal.check(&coordinator.send(refusal.request(&coordinator)));
    }
}

#[test]
fn an_exchange_is_refused_whole() {
    let coordinator = Coordinator::start();
    let worker = coordinator.post("/v1/workers", &workers::registration()).expect(201);
    let path = format!("/v1/workers/{}/exchange", worker["worker"].as_str().unwrap());
    for refusal in workers::exchanges(&path) {
        refusal.check(&coordinator.send(refusal.request(&coordinator)));
    }
    let told = coordinator.post(&path, &json!({})).expect(200);
    assert_eq!((&told["jobs"], &told["drain"]), (&json!([]), &json!(false)));
}
