//! Bodies, queries, paths and headers which nobody would send on purpose: they are refused or
//! answered, and never a fault of the coordinator.
//!
//! `MANDUCA_FUZZ_CASES` is how many (2,000), `MANDUCA_FUZZ_SEED` of which sequence.

mod change;

use std::cell::RefCell;

use axum::body::Body;
use axum::http::Request;
use manduca_protocol::worker::Lease;
use proptest::prelude::*;
use proptest::test_runner::{Config as Fuzz, RngAlgorithm, TestCaseError, TestError, TestRng, TestRunner};
use serde_json::{Value, json};
use tokio::runtime::{Builder, Runtime};
use tower::ServiceExt;

use super::answers;
use super::bench::Bench;
use change::{Change, changes, mutated};

/// Cases on one database, which would grow for ever else.
const CASES_PER_STORE: u32 = 2000;

/// A coordinator with a finished study, a running one, a worker, and what they are asked.
struct Target {
    bench: Bench,
    study: String,
    running: String,
    worker: String,
    leases: Vec<Lease>,
    posts: Vec<(String, Value)>,
    gets: Vec<String>,
}

impl Target {
    async fn open() -> Self {
        let bench = Bench::open().await;
        let worker = bench.worker("fuzz").await;
        let study = bench.submit(&answers::study(20, &["a"])).await;
        bench.work_off(&worker).await;
        let mut other = answers::study(40, &[]);
        other["seed"] = 6.into();
        let running = bench.submit(&other).await;
        let leases = bench.claim(&worker, 4).await;
        assert_eq!((leases.len(), bench.view(&study).await["state"].clone()), (4, json!("succeeded")));
        let mut target = Self { bench, study, running, worker, leases, posts: Vec::new(), gets: Vec::new() };
        target.list().await;
        target
    }

    /// Every route of the document, with a body which is fine where one is taken.
    async fn list(&mut self) {
        let document = self.bench.get("/openapi.json").await.json();
        let mut bodies = self.bodies();
        // A stroke flown while one waits takes a second and more.
        let of_moments = document["paths"].as_object().expect("paths").iter().filter(|(p, _)| *p != "/v1/simulations");
        for (path, item) in of_moments {
            let job = self.leases[0].job.to_string();
            let filled = path
                .replace("/v1/studies/{study}", &self.study)
                .replace("/v1/workers/{worker}", &self.worker)
                .replace("{job}", &job)
                .replace("{name}", "a");
            assert!(!filled.contains('{'), "{path} has a part without a value");
            if item["post"].is_object() {
                let fine = bodies.iter().position(|(of, _)| of == path).map(|i| bodies.swap_remove(i).1);
                // Routes without a body of their own get one all the same.
                self.posts.push((filled.clone(), fine.unwrap_or(json!({}))));
                assert!(item["post"]["requestBody"].is_null() || self.posts.iter().any(|p| p.1 != json!({})));
            }
            if item["get"].is_object() {
                self.gets.push(filled);
            }
        }
        assert!(bodies.is_empty(), "no such route: {bodies:?}");
        let control = |verb: &str| (format!("{}/{verb}", self.running), json!({}));
        let running = ["pause", "resume", "cancel", "retry-failed"].map(control);
        self.posts.extend(running);
    }

    fn bodies(&self) -> Vec<(&'static str, Value)> {
        let [a, b, c, d] = &self.leases[..] else { panic!("four leases") };
        let exchange = json!({
            "complete": [answers::completion(a, answers::result(a)), answers::completion(b, answers::infeasible("x"))],
            "fail": [{ "job": c.job, "attempt": c.attempt, "reason": "broken" }],
            "renew": [{ "job": d.job, "attempt": d.attempt, "progress": { "done": 1, "total": 2, "note": "x" } }],
            "want": 1, "wait_s": 0.0,
        });
        let point = answers::optimised()["parameters"].clone();
        vec![
            ("/v1/studies", answers::study(20, &["a", "b"])),
            ("/v1/workers", answers::registration("another")),
            ("/v1/workers/{worker}/exchange", exchange),
            ("/v1/studies/{study}/surrogate/predictions", json!({ "points": [point.clone(), point] })),
            ("/v1/studies/{study}/optimisations", json!({ "name": "c", "refine_simulations": 0 })),
        ]
    }

    /// Sends a case; gives its status.
    async fn send(&self, case: &Case) -> Result<u16, String> {
        let request = self.request(case);
        let Some(request) = request else { return Ok(0) };
        let told = format!("{} {}", request.method(), request.uri());
        let response = self.bench.router.clone().oneshot(request).await.map_err(|e| e.to_string())?;
        let status = response.status().as_u16();
        // A stream of events does not end.
        if !told.contains("/v1/events") {
            axum::body::to_bytes(response.into_body(), usize::MAX).await.map_err(|e| format!("{told}: {e}"))?;
        }
        if status < 500 { Ok(status) } else { Err(format!("{status} for {told}")) }
    }

    /// None where there is no such request: not every text is a path or a header.
    fn request(&self, case: &Case) -> Option<Request<Body>> {
        let of = |n: usize| case.route.index(n);
        let (method, path, body) = if case.reads {
            ("GET", self.gets[of(self.gets.len())].clone(), String::new())
        } else {
            let (path, fine) = &self.posts[of(self.posts.len())];
            ("POST", path.clone(), mutated(fine, &case.changes, &case.bytes))
        };
        let query = if case.query.is_empty() { String::new() } else { format!("?{}", case.query) };
        let mut request = Request::builder().method(method).uri(format!("{path}{}{query}", case.suffix));
        if case.typed {
            request = request.header("content-type", "application/json");
        }
        for (name, value) in &case.headers {
            request = request.header(*name, value.as_bytes());
        }
        request.body(Body::from(body)).ok()
    }
}

/// One request.
#[derive(Debug, Clone)]
struct Case {
    reads: bool,
    route: prop::sample::Index,
    changes: Vec<Change>,
    bytes: Vec<(prop::sample::Index, u8)>,
    query: String,
    suffix: String,
    typed: bool,
    headers: Vec<(&'static str, String)>,
}

fn query() -> impl Strategy<Value = String> {
    let name = prop::sample::select(vec![
        "limit", "cursor", "state", "kind", "dry_run", "class", "samples", "after", "study", "x",
    ]);
    let value = prop_oneof![
        "[0-9]{1,25}",
        "-?[0-9.e]{1,9}",
        "[a-z]{0,9}",
        "(%[0-9a-f]{2}){0,9}",
        "[!-~&&[^#]]{0,30}",
        Just("true".to_owned()),
        Just("succeeded".to_owned()),
        Just("simulate".to_owned()),
    ];
    let pairs = prop::collection::vec((name, value).prop_map(|(n, v)| format!("{n}={v}")), 0..4);
    prop_oneof![2 => Just(String::new()), 3 => pairs.prop_map(|pairs| pairs.join("&")), 1 => "[!-~&&[^#]]{0,40}"]
}

fn header() -> impl Strategy<Value = (&'static str, String)> {
    let name = prop::sample::select(vec![
        "accept",
        "content-type",
        "idempotency-key",
        "if-none-match",
        "authorization",
        "content-length",
        "content-encoding",
        "accept-encoding",
        "range",
        "last-event-id",
        "x-forwarded-for",
        "transfer-encoding",
    ]);
    let value = prop_oneof![
        "[ -~]{0,60}",
        "\\PC{0,30}",
        "[0-9]{1,20}",
        Just("text/csv".to_owned()),
        Just("application/x-ndjson;q=0".to_owned()),
        Just("*/*;q=x".to_owned()),
    ];
    (name, value)
}

fn case() -> impl Strategy<Value = Case> {
    let suffix = prop_oneof![12 => Just(String::new()), 1 => "/[!-~&&[^#?]]{0,12}", 1 => "(%[0-9a-f]{2}){1,4}"];
    let bytes = prop_oneof![
        4 => Just(Vec::new()),
        1 => prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
    ];
    let said = (prop::collection::vec(header(), 0..3), query(), suffix, prop::bool::weighted(0.97));
    (prop::bool::weighted(0.2), any::<prop::sample::Index>(), changes(), bytes, said).prop_map(
        |(reads, route, changes, bytes, (headers, query, suffix, typed))| Case {
            reads,
            route,
            changes,
            bytes,
            query,
            suffix,
            typed,
            headers,
        },
    )
}

fn number(variable: &str, otherwise: u32) -> u32 {
    std::env::var(variable).map_or(otherwise, |text| text.parse().expect("a number"))
}

/// Statuses seen, by hundreds.
#[derive(Debug, Default)]
struct Seen([u64; 5]);

/// Runs cases against one coordinator.
fn fuzz(runtime: &Runtime, cases: u32, seed: u32, seen: &RefCell<Seen>) {
    let target = runtime.block_on(Target::open());
    let mut bytes = [0; 32];
    bytes[..4].copy_from_slice(&seed.to_le_bytes());
    let config = Fuzz { cases, failure_persistence: None, max_shrink_iters: 2000, ..Fuzz::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::from_seed(RngAlgorithm::ChaCha, &bytes));
    let tried = runner.run(&case(), |case| match runtime.block_on(target.send(&case)) {
        Ok(status) => {
            seen.borrow_mut().0[usize::from(status / 100).min(4)] += 1;
            Ok(())
        }
        Err(why) => Err(TestCaseError::fail(why)),
    });
    match tried {
        Ok(()) => runtime.block_on(async {
            target.bench.check_counts().await;
            target.bench.state.close().await;
        }),
        Err(TestError::Fail(why, case)) => {
            let sent = (!case.reads).then(|| {
                let (path, fine) = &target.posts[case.route.index(target.posts.len())];
                format!("{path} {}", mutated(fine, &case.changes, &case.bytes))
            });
            panic!("MANDUCA_FUZZ_SEED={seed}: {why}\n{case:?}\n{sent:?}");
        }
        Err(TestError::Abort(why)) => panic!("MANDUCA_FUZZ_SEED={seed}: {why}"),
    }
}

#[test]
fn whatever_is_sent_is_answered_or_refused() {
    let runtime = Builder::new_multi_thread().worker_threads(2).enable_all().build().expect("a runtime");
    let (cases, first) = (number("MANDUCA_FUZZ_CASES", 2000), number("MANDUCA_FUZZ_SEED", 1));
    let seen = RefCell::new(Seen::default());
    for batch in 0..cases.div_ceil(CASES_PER_STORE) {
        let here = CASES_PER_STORE.min(cases - batch * CASES_PER_STORE);
        fuzz(&runtime, here, first + batch, &seen);
    }
    let Seen([none, _, good, unchanged, refused]) = seen.into_inner();
    eprintln!("{cases} cases: {good} answered, {unchanged} not modified, {refused} refused, {none} no request at all");
    if let Some(peak) = peak_mib() {
        eprintln!("peak memory {peak} MiB");
    }
    // Cases which are all refused at the door would show nothing.
    assert!(good > u64::from(cases) / 20 && refused > u64::from(cases) / 4);
}

/// Most memory this process has had, where the system tells.
fn peak_mib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse::<u64>().ok().map(|kib| kib / 1024)
}
