//! A token is revoked while a request with it waits, or its answer streams.

use std::time::Duration;

use axum::body::Body;
use axum::http::Request;
use futures_util::StreamExt;
use serde_json::json;
use tower::ServiceExt;

use super::answers::{registration, study};
use super::bench::{Answer, Bench};
use crate::{Access, Offline, Scope, Secret};

/// No test measures time; this only ends one that hangs.
const PATIENCE: Duration = Duration::from_secs(60);

struct Guarded {
    bench: Bench,
    operator: Secret,
    database: Offline,
}

impl Guarded {
    async fn open() -> Self {
        let operator = Secret::random().expect("random");
        let hashes = vec![operator.hash()];
        let bench = Bench::open_with(|config| config.access = Access::Tokens(hashes)).await;
        let database = Offline::open(&bench.database()).await.expect("opens beside the coordinator");
        Self { bench, operator, database }
    }

    async fn token(&mut self, name: &str, scope: Scope) -> String {
        let made = self.database.create_token(name, [scope].into_iter().collect()).await.expect("a token");
        made.reveal().to_owned()
    }

    async fn ask(&self, method: &str, path: &str, token: &str, body: String) -> Answer {
        self.bench.send(request(method, path, token, body)).await
    }

    async fn submit(&self) {
        let body = study(20, &[]).to_string();
        assert_eq!(self.ask("POST", "/v1/studies", self.operator.reveal(), body).await.status, 201);
    }

    async fn worker(&self, token: &str, name: &str) -> String {
        let answer = self.ask("POST", "/v1/workers", token, registration(name).to_string()).await;
        assert_eq!(answer.status, 201, "{:?}", answer.body);
        format!("/v1/workers/{}/exchange", answer.json()["worker"].as_str().expect("an id"))
    }
}

fn request(method: &str, path: &str, token: &str, body: String) -> Request<Body> {
    let request = Request::builder().method(method).uri(path).header("content-type", "application/json");
    request.header("authorization", format!("Bearer {token}")).body(Body::from(body)).expect("a request")
}

#[tokio::test]
async fn a_worker_that_waits_is_let_go_and_given_no_job() {
    let mut guarded = Guarded::open().await;
    let (bad, good) = (guarded.token("bad", Scope::Worker).await, guarded.token("good", Scope::Worker).await);
    let (thief, honest) = (guarded.worker(&bad, "thief").await, guarded.worker(&good, "honest").await);
    let wait = || json!({ "want": 4, "wait_s": 30.0 }).to_string();
    let router = guarded.bench.router.clone();
    let waiting = tokio::spawn(router.clone().oneshot(request("POST", &thief, &bad, wait())));
    let other = tokio::spawn(router.oneshot(request("POST", &honest, &good, wait())));
    tokio::time::sleep(Duration::from_millis(100)).await;
    guarded.database.revoke_token("bad").await.expect("is known");
    // At once, so that no look at the tokens lies between the two.
    guarded.submit().await;
    let refused = tokio::time::timeout(PATIENCE, waiting).await.expect("ends").expect("no panic").expect("answers");
    assert_eq!(refused.status(), 401);
    let told = tokio::time::timeout(PATIENCE, other).await.expect("ends").expect("no panic").expect("answers");
    assert_eq!(told.status(), 200, "the other token is as good as before");
    let leased = guarded.ask("GET", "/v1/workers", guarded.operator.reveal(), String::new()).await.json();
    let of = |name: &str| {
        leased.as_array().expect("a list").iter().find(|w| w["name"] == name).expect(name)["leased"].clone()
    };
    assert_eq!((of("thief"), of("honest")), (json!(0), json!(4)));
}

#[tokio::test]
async fn a_worker_that_waits_is_let_go_though_nothing_happens() {
    let mut guarded = Guarded::open().await;
    let token = guarded.token("node", Scope::Worker).await;
    let path = guarded.worker(&token, "node").await;
    let waiting = request("POST", &path, &token, json!({ "want": 1, "wait_s": 30.0 }).to_string());
    let began = std::time::Instant::now();
    let waiting = tokio::spawn(guarded.bench.router.clone().oneshot(waiting));
    tokio::time::sleep(Duration::from_millis(100)).await;
    guarded.database.revoke_token("node").await.expect("is known");
    let refused = tokio::time::timeout(PATIENCE, waiting).await.expect("ends").expect("no panic").expect("answers");
    assert_eq!(refused.status(), 401);
    assert!(began.elapsed() < Duration::from_secs(30), "it waited for its time, not for the token");
}

#[tokio::test]
async fn events_end_with_the_token_and_none_is_told_after_it() {
    let mut guarded = Guarded::open().await;
    let token = guarded.token("ada", Scope::Read).await;
    let answer = guarded.bench.router.clone().oneshot(request("GET", "/v1/events", &token, String::new())).await;
    let answer = answer.expect("answers");
    assert_eq!(answer.status(), 200);
    let mut events = answer.into_body().into_data_stream();
    let hello = events.next().await.expect("an event").expect("bytes");
    assert!(hello.starts_with(b"event: changed"));
    guarded.submit().await;
    let told = tokio::time::timeout(PATIENCE, events.next()).await.expect("in time").expect("an event").expect("bytes");
    assert!(told.starts_with(b"event: changed"));
    guarded.database.revoke_token("ada").await.expect("is known");
    guarded.submit().await;
    let after = tokio::time::timeout(PATIENCE, events.next()).await.expect("ends in time");
    assert!(after.is_none(), "told after the end: {after:?}");
    let refused = guarded.ask("GET", "/v1/events", &token, String::new());
    let until = std::time::Instant::now() + PATIENCE;
    let mut status = refused.await.status;
    while status == 200 && std::time::Instant::now() < until {
        tokio::time::sleep(Duration::from_millis(50)).await;
        status = guarded.ask("GET", "/v1/studies", &token, String::new()).await.status;
    }
    assert_eq!(status, 401);
}

#[tokio::test]
async fn a_dataset_breaks_off_with_the_token() {
    let mut guarded = Guarded::open().await;
    guarded.submit().await;
    let token = guarded.token("ada", Scope::Read).await;
    let studies = guarded.ask("GET", "/v1/studies", &token, String::new()).await.json();
    let path = format!("/v1/studies/{}/dataset", studies["items"][0]["id"].as_str().expect("an id"));
    let answer = guarded.bench.router.clone().oneshot(request("GET", &path, &token, String::new())).await;
    let mut parts = answer.expect("answers").into_body().into_data_stream();
    guarded.database.revoke_token("ada").await.expect("is known");
    let first = parts.next().await.expect("something");
    assert!(first.is_err(), "a whole dataset after the end: {first:?}");
    assert!(parts.next().await.is_none());
}
