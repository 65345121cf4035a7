//! Who did what: tokens are kept by name, and only the token of a worker speaks for it.

use axum::body::Body;
use axum::http::Request;
use manduca_protocol::worker::Lease;
use serde_json::{Value, json};

use super::answers::{completion, registration, result, study};
use super::bench::{Answer, Bench};
use crate::{Access, Offline, Scope, Secret};

/// A coordinator with tokens, and the secrets of some.
struct Guarded {
    bench: Bench,
    operator: Secret,
    ada: Secret,
    mine: Secret,
    theirs: Secret,
}

impl Guarded {
    async fn open() -> Self {
        let operator = Secret::random().expect("random");
        let hash = operator.hash();
        let bench = Bench::open_with(|config| config.access = Access::Tokens(vec![hash])).await;
        let mut database = Offline::open(&bench.database()).await.expect("opens beside the coordinator");
        let mut make = async |name: &str, scope: Scope| {
            database.create_token(name, [scope].into_iter().collect()).await.expect("a token")
        };
        let ada = make("ada", Scope::Submit).await;
        let (mine, theirs) = (make("mine", Scope::Worker).await, make("theirs", Scope::Worker).await);
        Self { bench, operator, ada, mine, theirs }
    }

    async fn ask(&self, token: &Secret, method: &str, path: &str, body: &Value) -> Answer {
        let request = Request::builder().method(method).uri(path).header("content-type", "application/json");
        let request = request.header("authorization", format!("Bearer {}", token.reveal()));
        self.bench.send(request.body(Body::from(body.to_string())).expect("a request")).await
    }

    async fn view(&self, path: &str) -> Value {
        self.ask(&self.operator, "GET", path, &Value::Null).await.json()
    }

    async fn worker(&self, token: &Secret, name: &str) -> String {
        let answer = self.ask(token, "POST", "/v1/workers", &registration(name)).await;
        format!("/v1/workers/{}", answer.json()["worker"].as_str().expect("an id"))
    }

    async fn claim(&self, token: &Secret, worker: &str) -> Lease {
        let answer = self.ask(token, "POST", &format!("{worker}/exchange"), &json!({ "want": 1 })).await;
        serde_json::from_value(answer.json()["jobs"][0].clone()).expect("a lease")
    }
}

#[tokio::test]
async fn only_the_token_of_a_worker_speaks_for_it() {
    let guarded = Guarded::open().await;
    let Guarded { operator, ada, mine, theirs, .. } = &guarded;
    guarded.ask(ada, "POST", "/v1/studies", &study(20, &[])).await;
    let worker = guarded.worker(mine, "node").await;
    let exchange = format!("{worker}/exchange");
    for other in [theirs, operator] {
        guarded.ask(other, "POST", &exchange, &json!({ "want": 1 })).await.problem(403, "another-token");
    }
    guarded.ask(theirs, "DELETE", &worker, &Value::Null).await.problem(403, "another-token");
    let lease = guarded.claim(mine, &worker).await;
    let task = format!("/v1/jobs/{}/task", lease.job);
    assert_eq!(guarded.ask(mine, "GET", &task, &Value::Null).await.status, 200);
    assert_eq!(guarded.ask(operator, "GET", &task, &Value::Null).await.status, 200);
    guarded.ask(theirs, "GET", &task, &Value::Null).await.problem(403, "another-token");
    let other = json!(lease.job.0 + 1);
    guarded.ask(mine, "GET", &format!("/v1/jobs/{other}/task"), &Value::Null).await.problem(403, "another-token");
    // A result by another token changes nothing.
    let forged = json!({ "complete": [completion(&lease, result(&lease))] });
    guarded.ask(theirs, "POST", &exchange, &forged).await.problem(403, "another-token");
    assert_eq!(guarded.view(&format!("/v1/jobs/{}", lease.job)).await["state"], "leased");
    let metrics = guarded.ask(operator, "GET", "/metrics", &Value::Null).await;
    let text = String::from_utf8(metrics.body.to_vec()).expect("text");
    assert!(text.contains("manduca_requests_turned_away_total{reason=\"another_token\"} 6"), "{text}");
    assert_eq!(guarded.ask(operator, "DELETE", &worker, &Value::Null).await.status, 204, "an admin may");
    guarded.ask(mine, "POST", &exchange, &json!({})).await.problem(404, "unknown-worker");
}

#[tokio::test]
async fn a_worker_from_before_belongs_to_the_first_token_that_speaks_for_it() {
    let guarded = Guarded::open().await;
    let Guarded { mine, theirs, .. } = &guarded;
    let worker = guarded.worker(mine, "node").await;
    let mut database = Offline::open(&guarded.bench.database()).await.expect("opens");
    sqlx::query("update workers set token = null").execute(database.file.db()).await.expect("as before");
    let exchange = format!("{worker}/exchange");
    assert_eq!(guarded.ask(mine, "POST", &exchange, &json!({})).await.status, 200);
    guarded.ask(theirs, "POST", &exchange, &json!({})).await.problem(403, "another-token");
}

#[tokio::test]
async fn views_name_the_tokens_that_submitted_steered_registered_and_computed() {
    let guarded = Guarded::open().await;
    let Guarded { operator, ada, mine, .. } = &guarded;
    let submitted = guarded.ask(ada, "POST", "/v1/studies", &study(20, &[])).await;
    let path = submitted.header("location").to_owned();
    let worker = guarded.worker(mine, "node").await;
    let lease = guarded.claim(mine, &worker).await;
    let job = format!("/v1/jobs/{}", lease.job);
    let view = guarded.view(&job).await;
    assert_eq!(
        (&view["worker_name"], &view["token"], &view["computed_by"]),
        (&json!("node"), &json!("mine"), &json!(null))
    );
    let told = guarded.view(&format!("{job}/explain")).await;
    assert!(told["because"][0].as_str().is_some_and(|why| why.contains("`node` of token `mine`")), "{told}");
    let done = json!({ "complete": [completion(&lease, result(&lease))] });
    guarded.ask(mine, "POST", &format!("{worker}/exchange"), &done).await;
    let by = json!({ "job": lease.job, "worker": worker.rsplit('/').next(), "worker_name": "node", "token": "mine" });
    let view = guarded.view(&job).await;
    assert_eq!((&view["computed_by"], &view["worker_name"]), (&by, &json!(null)));
    // Another study shares the result, and names its origin.
    let shared = guarded.ask(ada, "POST", "/v1/studies", &study(21, &[])).await;
    let jobs = guarded.view(&format!("{}/jobs?state=succeeded", shared.header("location"))).await;
    assert_eq!((&jobs["items"][0]["cached"], &jobs["items"][0]["computed_by"]), (&json!(true), &by));
    let told = guarded.view(&format!("/v1/jobs/{}/explain", jobs["items"][0]["id"])).await;
    assert!(told["because"][0].as_str().is_some_and(|why| why.contains("computed by worker `node` of token `mine`")));
    guarded.ask(operator, "POST", &format!("{path}/pause"), &Value::Null).await;
    guarded.ask(operator, "POST", &format!("{worker}/drain"), &Value::Null).await;
    let view = guarded.view(&path).await;
    assert_eq!((&view["submitted_by"], &view["steered_by"]), (&json!("ada"), &json!("(operator)")));
    assert_eq!(guarded.view("/v1/studies").await["items"][0]["submitted_by"], "ada");
    let seen = guarded.view("/v1/workers").await;
    assert_eq!((&seen[0]["token"], &seen[0]["drained_by"]), (&json!("mine"), &json!("(operator)")));
}

#[tokio::test]
async fn the_name_of_the_operators_own_token_is_given_to_nobody() {
    let bench = Bench::open().await;
    let mut database = Offline::open(&bench.database()).await.expect("opens");
    assert!(database.create_token("(operator)", [Scope::Read].into_iter().collect()).await.is_err());
    let path = bench.submit(&study(20, &[])).await;
    assert!(bench.view(&path).await.get("submitted_by").is_none(), "nobody is asked who he is");
}
