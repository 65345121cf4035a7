//! What pages of other sites can do through the browser of somebody beside a coordinator without tokens: nothing.

use axum::body::Body;
use axum::http::{HeaderMap, Method, Request, Uri};
use serde_json::json;

use super::answers::registration;
use super::bench::{Answer, Bench};
use crate::{Access, Hosts, Secret, app};

/// A request with these headers and no others, `content-type` apart.
async fn ask(bench: &Bench, method: &str, target: &str, headers: &[(&str, &str)]) -> Answer {
    let mut request = Request::builder().method(method).uri(target).header("content-type", "application/json");
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    let body = if method == "POST" { registration("w").to_string() } else { String::new() };
    bench.send_to(app(bench.state.clone()), request.body(Body::from(body)).expect("a request")).await
}

#[tokio::test]
async fn without_tokens_only_this_machine_is_answered_for() {
    let bench = Bench::open().await;
    for own in ["localhost", "LOCALHOST:8080", "127.0.0.1:1", "127.9.9.9", "[::1]:65535", "localhost."] {
        assert_eq!(ask(&bench, "GET", "/v1/studies", &[("host", own)]).await.status, 200, "{own}");
        assert_eq!(ask(&bench, "POST", "/v1/workers", &[("host", own)]).await.status, 201, "{own}");
    }
    for foreign in
        ["rebind.example", "rebind.example:8080", "127.0.0.1.nip.io", "localhost.rebind.example:80", "10.0.0.5"]
    {
        let origin = format!("http://{foreign}");
        let headers = [("host", foreign), ("origin", origin.as_str()), ("sec-fetch-site", "same-origin")];
        for (method, path) in [
            ("GET", "/v1/studies"),
            ("HEAD", "/v1/studies"),
            ("POST", "/v1/workers"),
            ("DELETE", "/v1/workers/x"),
            ("OPTIONS", "/v1/studies"),
            ("PUT", "/v1/studies"),
            ("GET", "/"),
            ("GET", "/assets/main.js"),
            ("GET", "/docs"),
            ("GET", "/healthz"),
            ("GET", "/metrics"),
            ("GET", "/v1/events"),
            ("GET", "/nothing"),
            ("TRACE", "/"),
        ] {
            let answer = ask(&bench, method, path, &headers).await;
            assert_eq!(answer.status, 421, "{method} {path} of {foreign}");
            if method != "HEAD" {
                answer.problem(421, "foreign-host");
                let detail = answer.json()["detail"].as_str().expect("a sentence").to_owned();
                assert!(detail.contains("--allow-host") && detail.contains("--require-tokens"), "{detail}");
            }
        }
    }
    assert_eq!(bench.get("/v1/workers").await.json().as_array().map(Vec::len), Some(6), "none was registered");
}

#[tokio::test]
async fn a_request_names_one_host() {
    let bench = Bench::open().await;
    for headers in [
        vec![],
        vec![("host", "")],
        vec![("host", "localhost"), ("host", "rebind.example")],
        vec![("host", "rebind.example"), ("host", "localhost")],
        vec![("host", "localhost"), ("host", "localhost")],
        vec![("host", "me@localhost")],
        vec![("host", "localhost, rebind.example")],
        vec![("host", "[::1")],
    ] {
        ask(&bench, "GET", "/v1/studies", &headers).await.problem(400, "unclear-host");
    }
    // A target with a host must agree with the header: only one of the two would be looked at elsewhere.
    for target in
        ["http://rebind.example/v1/studies", "http://me@localhost/v1/studies", "http://localhost:1/v1/studies"]
    {
        ask(&bench, "GET", target, &[("host", "localhost")]).await.problem(400, "unclear-host");
    }
    let both = ask(&bench, "GET", "http://rebind.example/v1/studies", &[("host", "rebind.example")]).await;
    both.problem(421, "foreign-host");
    assert_eq!(ask(&bench, "GET", "http://localhost/v1/studies", &[("host", "localhost")]).await.status, 200);
}

#[tokio::test]
async fn further_hosts_are_answered_for_where_the_operator_names_them() {
    let named = |hosts: Hosts| Bench::open_with(|config| config.hosts = hosts);
    let bench = named(Hosts::new(["manduca.example".parse().expect("a name")])).await;
    assert_eq!(ask(&bench, "GET", "/v1/studies", &[("host", "Manduca.Example:9000")]).await.status, 200);
    let own = [("host", "manduca.example"), ("origin", "https://manduca.example")];
    assert_eq!(ask(&bench, "POST", "/v1/workers", &own).await.status, 201, "behind a proxy which speaks TLS");
    ask(&bench, "GET", "/v1/studies", &[("host", "a.manduca.example")]).await.problem(421, "foreign-host");
    ask(&bench, "GET", "/v1/studies", &[("host", "10.0.0.5:8080")]).await.problem(421, "foreign-host");
    let bench = named(Hosts::default().with_addresses()).await;
    for own in ["10.0.0.5:8080", "[fe80::1]", "localhost"] {
        assert_eq!(ask(&bench, "GET", "/v1/studies", &[("host", own)]).await.status, 200, "{own}");
    }
    ask(&bench, "GET", "/v1/studies", &[("host", "rebind.example")]).await.problem(421, "foreign-host");
}

#[tokio::test]
async fn with_tokens_any_host_is_fine_and_the_token_decides() {
    let secret = Secret::random().expect("random");
    let bench = Bench::open_with(|config| config.access = Access::Tokens(vec![secret.hash()])).await;
    let bearer = format!("Bearer {}", secret.reveal());
    for host in ["coordinator:8080", "manduca.example", "10.0.0.5"] {
        let headers = [("host", host), ("origin", "https://other.example"), ("authorization", bearer.as_str())];
        assert_eq!(ask(&bench, "GET", "/v1/studies", &headers).await.status, 200, "{host}");
        assert_eq!(ask(&bench, "POST", "/v1/workers", &headers).await.status, 201, "{host}");
        ask(&bench, "GET", "/v1/studies", &[("host", host)]).await.problem(401, "unauthenticated");
        assert_eq!(ask(&bench, "GET", "/healthz", &[("host", host)]).await.status, 200);
    }
    ask(&bench, "GET", "/healthz", &[("host", "a"), ("host", "b")]).await.problem(400, "unclear-host");
}

#[tokio::test]
async fn what_a_browser_marks_as_of_another_site_is_refused() {
    let bench = Bench::open().await;
    let host = ("host", "127.0.0.1:8080");
    let foreign: &[&[(&str, &str)]] = &[
        &[("origin", "http://evil.example")],
        &[("origin", "null")],
        &[("origin", "")],
        &[("origin", "http://127.0.0.1:8081")],
        &[("origin", "http://127.0.0.1")],
        &[("origin", "http://localhost:8080")],
        &[("origin", "127.0.0.1:8080")],
        &[("origin", "http://127.0.0.1:8080/")],
        &[("origin", "http://me@127.0.0.1:8080")],
        &[("origin", "chrome-extension://127.0.0.1:8080")],
        &[("origin", "http://127.0.0.1:8080"), ("origin", "http://evil.example")],
        &[("origin", "http://evil.example"), ("origin", "http://127.0.0.1:8080")],
        &[("origin", "http://127.0.0.1:8080, http://evil.example")],
        &[("sec-fetch-site", "cross-site")],
        &[("sec-fetch-site", "same-site")],
        &[("sec-fetch-site", "")],
        &[("sec-fetch-site", "Same-Origin")],
        &[("sec-fetch-site", "same-origin"), ("sec-fetch-site", "cross-site")],
        &[("sec-fetch-site", "cross-site"), ("origin", "http://127.0.0.1:8080")],
        &[("sec-fetch-site", "same-origin"), ("origin", "http://evil.example")],
        &[("sec-fetch-site", "cross-site"), ("sec-fetch-mode", "navigate"), ("sec-fetch-dest", "document")],
        &[("sec-fetch-site", "cross-site"), ("sec-fetch-mode", "no-cors"), ("sec-fetch-dest", "image")],
    ];
    for more in foreign {
        let headers: Vec<_> = more.iter().copied().chain([host]).collect();
        for (method, path) in
            [("GET", "/v1/studies"), ("POST", "/v1/workers"), ("GET", "/healthz"), ("GET", "/v1/events")]
        {
            let answer = ask(&bench, method, path, &headers).await;
            assert_eq!(answer.status, 403, "{method} {path} {more:?}");
            answer.problem(403, "another-site");
        }
    }
    assert_eq!(bench.get("/v1/workers").await.json(), json!([]));
}

#[tokio::test]
async fn the_page_itself_can_be_opened_by_a_link_and_works() {
    let bench = Bench::open().await;
    let host = ("host", "localhost:8080");
    let visit =
        [host, ("sec-fetch-site", "cross-site"), ("sec-fetch-mode", "navigate"), ("sec-fetch-dest", "document")];
    for page in ["/", "/?from=mail", "/docs"] {
        assert_eq!(ask(&bench, "GET", page, &visit).await.status, 200, "{page}");
    }
    for dest in ["iframe", "frame", "embed", "object", "empty", "script", "image"] {
        let framed = [visit[0], visit[1], visit[2], ("sec-fetch-dest", dest)];
        ask(&bench, "GET", "/", &framed).await.problem(403, "another-site");
    }
    ask(&bench, "POST", "/", &visit).await.problem(403, "another-site");
    ask(&bench, "GET", "/assets/main.js", &visit).await.problem(403, "another-site");
    for site in ["none", "same-origin"] {
        let own = [host, ("sec-fetch-site", site), ("origin", "http://localhost:8080")];
        assert_eq!(ask(&bench, "GET", "/v1/studies", &own).await.status, 200);
        assert_eq!(ask(&bench, "POST", "/v1/workers", &own).await.status, 201);
    }
    let default_port = [("host", "localhost"), ("origin", "http://localhost:80")];
    assert_eq!(ask(&bench, "POST", "/v1/workers", &default_port).await.status, 201);
}

fn protects(headers: &HeaderMap, what: &str) {
    let of = |name: &str| headers.get(name).and_then(|v| v.to_str().ok()).unwrap_or_default();
    assert_eq!(of("x-content-type-options"), "nosniff", "{what}");
    assert_eq!(of("referrer-policy"), "no-referrer", "{what}");
    assert_eq!(of("cross-origin-resource-policy"), "same-origin", "{what}");
    assert!(of("content-security-policy").contains("frame-ancestors 'none'"), "{what}");
    assert!(of("content-security-policy").contains("default-src"), "{what}");
    assert!(!of("cache-control").is_empty(), "{what}");
    assert!(headers.get("access-control-allow-origin").is_none(), "{what}");
}

#[tokio::test]
async fn every_answer_says_what_a_browser_may_do_with_it() {
    let bench = Bench::open().await;
    let study = bench.submit(&super::answers::study(20, &[])).await;
    for path in [
        "/",
        "/assets/main.js",
        "/assets/no-such-file",
        "/docs",
        "/docs/start.js",
        "/docs/swagger-ui.css",
        "/docs/nothing",
        "/openapi.json",
        "/healthz",
        "/readyz",
        "/metrics",
        "/v1/studies",
        "/v1/studies?limit=x",
        "/v1/workers",
        "/nowhere",
        "/v1/jobs/99",
        &study,
        &format!("{study}/dataset"),
    ] {
        protects(&bench.get(path).await.headers, path);
    }
    protects(&bench.post("/v1/studies", "{").await.headers, "a refusal");
    protects(&bench.delete("/v1/studies").await.headers, "another refusal");
    protects(&ask(&bench, "GET", "/v1/studies", &[("host", "evil.example")]).await.headers, "of another host");
    protects(
        &ask(&bench, "OPTIONS", "/v1/studies", &[("host", "localhost"), ("origin", "null")]).await.headers,
        "preflight",
    );
    let of = |path: &str| {
        let (method, uri) = (Method::GET, path.parse::<Uri>().expect("a path"));
        let request = Request::builder().method(method).uri(uri).body(Body::empty()).expect("a request");
        bench.send(request)
    };
    assert_eq!(of("/v1/studies").await.header("cache-control"), "no-store");
    assert_eq!(of(&study).await.header("cache-control"), "private, no-cache", "it has a tag");
    assert_eq!(of("/nowhere").await.header("cache-control"), "no-store");
    assert!(of("/docs/swagger-ui.css").await.header("cache-control").contains("max-age"));
}

#[tokio::test]
async fn where_tokens_are_asked_for_refusals_have_the_same_headers() {
    let bench = Bench::open_with(|config| config.access = Access::Tokens(Vec::new())).await;
    for path in ["/v1/studies", "/v1/events", "/nothing", "/", "/healthz"] {
        protects(&bench.get(path).await.headers, path);
    }
}
