//! Who may ask what.

use axum::body::Body;
use axum::http::Request;

use super::answers::{registration, study};
use super::bench::{Answer, Bench};
use crate::{Access, Offline, Scope, Secret};

async fn guarded(given: &[&Secret]) -> Bench {
    let hashes = given.iter().map(|secret| secret.hash()).collect();
    Bench::open_with(|config| config.access = Access::Tokens(hashes)).await
}

async fn ask(bench: &Bench, method: &str, path: &str, token: Option<&str>, body: String) -> Answer {
    let mut request = Request::builder().method(method).uri(path).header("content-type", "application/json");
    if let Some(token) = token {
        request = request.header("authorization", format!("Bearer {token}"));
    }
    bench.send(request.body(Body::from(body)).expect("a request")).await
}

#[tokio::test]
async fn without_a_valid_token_nothing_but_health_is_told() {
    let secret = Secret::random().expect("random");
    let bench = guarded(&[&secret]).await;
    let forged = secret.reveal().replace('a', "b");
    for token in [None, Some("short"), Some(forged.as_str())] {
        for (method, path) in
            [("GET", "/v1/studies"), ("POST", "/v1/studies"), ("GET", "/metrics"), ("GET", "/nothing")]
        {
            let answer = ask(&bench, method, path, token, String::new()).await;
            answer.problem(401, "unauthenticated");
            assert_eq!(answer.header("www-authenticate"), "Bearer");
        }
        for path in ["/healthz", "/readyz", "/openapi.json", "/docs"] {
            assert_eq!(ask(&bench, "GET", path, token, String::new()).await.status, 200);
        }
    }
    assert_eq!(ask(&bench, "GET", "/v1/studies", Some(secret.reveal()), String::new()).await.status, 200);
    let metrics = ask(&bench, "GET", "/metrics", Some(secret.reveal()), String::new()).await;
    let text = String::from_utf8(metrics.body.to_vec()).expect("text");
    assert!(text.contains("manduca_requests_turned_away_total{reason=\"no_valid_token\"} 12"), "{text}");
    let other_scheme = Request::get("/v1/studies").header("authorization", format!("Basic {}", secret.reveal()));
    bench.send(other_scheme.body(Body::empty()).expect("a request")).await.problem(401, "unauthenticated");
}

#[tokio::test]
async fn a_token_allows_its_scopes_until_it_is_revoked() {
    let bench = guarded(&[]).await;
    let mut database = Offline::open(&bench.database()).await.expect("opens beside the coordinator");
    let worker = database.create_token("cluster", [Scope::Worker].into_iter().collect()).await.expect("a token");
    let reader = database.create_token("ada", [Scope::Read].into_iter().collect()).await.expect("a token");
    assert!(database.create_token("ada", [Scope::Admin].into_iter().collect()).await.is_err(), "names are not reused");
    let (worker, reader) = (worker.reveal(), reader.reveal());
    let study = study(20, &[]).to_string();
    ask(&bench, "POST", "/v1/studies", Some(worker), study.clone()).await.problem(403, "forbidden");
    ask(&bench, "POST", "/v1/studies", Some(reader), study).await.problem(403, "forbidden");
    ask(&bench, "GET", "/v1/studies", Some(worker), String::new()).await.problem(403, "forbidden");
    assert_eq!(ask(&bench, "GET", "/v1/studies", Some(reader), String::new()).await.status, 200);
    let registered = ask(&bench, "POST", "/v1/workers", Some(worker), registration("w").to_string()).await;
    assert_eq!(registered.status, 201);
    let path = format!("/v1/workers/{}", registered.json()["worker"].as_str().expect("an id"));
    let drain = format!("{path}/drain");
    ask(&bench, "POST", &drain, Some(worker), String::new()).await.problem(403, "forbidden");

    database.revoke_token("cluster").await.expect("is known");
    assert!(database.revoke_token("nobody").await.is_err());
    let until = std::time::Instant::now() + std::time::Duration::from_secs(30);
    while ask(&bench, "POST", &format!("{path}/exchange"), Some(worker), "{}".into()).await.status == 200 {
        assert!(std::time::Instant::now() < until, "the revoked token is still taken");
        tokio::time::sleep(std::time::Duration::from_millis(50)).await;
    }
    let listed = database.tokens().await.expect("lists");
    assert_eq!(listed.iter().map(|t| t.revoked_at.is_some()).collect::<Vec<_>>(), [true, false]);
    let stored: Vec<Vec<u8>> =
        sqlx::query_scalar("select hash from tokens").fetch_all(bench.state.store().readers()).await.expect("reads");
    assert!(stored.iter().all(|hash| hash.len() == 32 && !worker.as_bytes().windows(32).any(|part| part == hash)));
}
