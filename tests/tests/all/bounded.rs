//! What one request may cost: the worst body of each route, alone and sixteen at once, against the
//! memory docs/reliability.md allows it. The coordinator has so little address space that one which
//! took what such bodies used to take would end.

#[path = "bounded/load.rs"]
mod load;

use std::fmt::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use manduca_protocol::resolve::MAX_SAMPLES;
use manduca_server::Config;
use manduca_tests::SOLVER_VERSION;
use manduca_tests::bulk::Bulk;
use manduca_tests::coordinator::Coordinator;
use manduca_tests::crowd::completion;
use manduca_tests::studies::blades;
use serde_json::{Value, json};

/// Memory one request may cost, bytes.
const ONE: u64 = 128 << 20;
/// Memory sixteen at once may cost, bytes.
const SIXTEEN: u64 = 512 << 20;
/// Address space of the coordinator, bytes.
const SPACE: u64 = 4 << 30;

/// A registered worker.
fn worker(coordinator: &Coordinator) -> String {
    let registration = json!({ "name": "bulky", "slots": 1000, "protocol_version": 1,
        "solver_version": SOLVER_VERSION, "level": "test" });
    let told = coordinator.post("/v1/workers", &registration).expect(201);
    format!("/v1/workers/{}/exchange", told["worker"].as_str().expect("an id"))
}

/// A worker which holds the training of a study; its exchange, and the lease.
fn trainer(coordinator: &Coordinator, seed: u64) -> (String, Value) {
    coordinator.submit(&blades("bulky", seed, 20));
    let path = worker(coordinator);
    let told = coordinator.post(&path, &json!({ "want": 20 })).expect(200);
    let complete: Vec<_> = told["jobs"].as_array().expect("leases").iter().map(completion).collect();
    let told = coordinator.post(&path, &json!({ "complete": complete, "want": 1 })).expect(200);
    assert_eq!((told["accepted"].as_array().map(Vec::len), &told["jobs"][0]["kind"]), (Some(20), &json!("train")));
    (path, told["jobs"][0].clone())
}

/// `part` again and again, up to so many bytes, between a beginning and an end.
fn filled(begin: &str, part: &str, end: &str, bytes: usize) -> Vec<u8> {
    let mut body = begin.as_bytes().to_vec();
    while body.len() + part.len() + end.len() <= bytes {
        body.extend_from_slice(part.as_bytes());
    }
    body.extend_from_slice(end.as_bytes());
    body
}

/// A body with white space up to so many bytes.
fn padded(mut body: Vec<u8>, bytes: usize) -> Vec<u8> {
    body.splice(0..0, std::iter::repeat_n(b' ', bytes.saturating_sub(body.len())));
    body
}

/// The worst bodies of a study.
fn studies(config: &Config) -> Vec<Bulk> {
    let path = "/v1/studies?dry_run=true";
    let dotted = |lines: usize| (0..lines).map(|i| format!("b{i}{}=1\n", ".a".repeat(78))).collect::<String>();
    let names = |from: usize, to: usize| (from..to).map(|i| format!("\"b{i}\":0,")).collect::<String>();
    vec![
        Bulk::toml("TOML of 10 MB", path, dotted(60_000)),
        Bulk::toml("TOML of as many steps as may be", path, dotted(410)),
        Bulk::toml("TOML of one list", path, filled("a=[", "0,", "]", 65_000)),
        Bulk::toml("TOML of tables", path, filled("", "[[a]]\n", "", config.study_limit)),
        Bulk::json(
            "a study of unknown parameters",
            path,
            format!(r#"{{"name":"x","sampling":{{"samples":20}},"parameters":{{{}"z":0}}}}"#, names(0, 16_000)),
        ),
        Bulk::json(
            "a study of escapes",
            path,
            filled(r#"{"name":"x","sampling":{"samples":20},"description":""#, "\\u0041", "\"}", config.study_limit),
        ),
        Bulk::json("a study nested without end", path, filled("", "[", "", config.study_limit)),
        Bulk::json(
            "a study of as many samples as may be",
            path,
            json!({ "name": "x", "sampling": { "samples": MAX_SAMPLES } }).to_string(),
        ),
        Bulk::json(
            "points without a study",
            "/v1/studies/00000000-0000-7000-8000-000000000000/surrogate/predictions",
            filled("{\"points\":[", "{},", "{}]}", config.body_limit),
        ),
    ]
}

/// The worst bodies of an exchange of at most so many bytes.
fn exchanges(path: &str, lease: &Value, bytes: usize) -> Vec<Bulk> {
    let (job, attempt) = (&lease["job"], &lease["attempt"]);
    let result = |fields: &str| format!(r#"{{"complete":[{{"job":{job},"attempt":{attempt},"result":{{{fields}"#);
    let case = |what: &str, begin: &str, part: &str, end: &str| {
        Bulk::json(format!("{what}, {} MiB", bytes >> 20), path, filled(begin, part, end, bytes))
    };
    // As many values as may be, and white space for the rest.
    let most = |what: &str, begin: &str, part: &str, end: &str, values: usize| {
        let body = padded(filled(begin, part, end, begin.len() + end.len() + part.len() * values), bytes);
        Bulk::json(format!("{what}, {} MiB", bytes >> 20), path, body)
    };
    let network = r#""kind":"train","surrogate":{"frame":{"features":"paper"},"networks":[{"hidden_weights":["#;
    let values = if bytes > 8 << 20 { 2_000_000 } else { 250_000 };
    vec![
        case("unknown fields", &result(r#""junk":["#), r#"{"":0},"#, "0]}}]}"),
        case("unknown fields in known ones", &result(r#""kind":"simulate","means":{"junk":["#), "[0],", "0]}}}]}"),
        case("weights", &result(network), "0,", "0]}]}}}]}"),
        most("as many weights as may be", &result(network), "0,", "0]}]}}}]}", values),
        most("numbers of full length", &result(network), "-1.2345678901234567e-300,", "0]}]}}}]}", values),
        most(
            "survivors",
            &result(r#""kind":"search","next":{"state":{"search":"breed","elite":["#),
            "null,",
            "0]",
            values,
        ),
        most("reasons to stop", &result(r#""kind":"train","stops":["#), "\"\",", "\"\"]}}]}", values),
        most("renewals", "{\"renew\":[", r#"{"job":1,"attempt":1},"#, r#"{"job":1,"attempt":1}]}"#, values / 3),
        case("one text", &result(r#""kind":"simulate","reason":""#), "\\u0041", "\"}}]}"),
        case("texts", "{\"fail\":[", &format!(r#"{{"job":1,"attempt":1,"reason":"{}"}},"#, "x".repeat(60_000)), "0]}"),
        case("the same field", "{", "\"want\":1,", "\"want\":1}"),
        case("lists in lists", "", "[", ""),
        case("jobs it has", "{\"have\":[", "1,", "1]}"),
    ]
}

/// Sends one, and tells what it cost beyond what the coordinator had.
fn cost(coordinator: &Coordinator, bulk: &Bulk, clients: usize) -> u64 {
    coordinator.forget_peak();
    let before = coordinator.memory();
    let done = AtomicBool::new(false);
    thread::scope(|scope| {
        let sending: Vec<_> = (0..clients).map(|_| scope.spawn(|| bulk.send(coordinator.address()))).collect();
        let watching = scope.spawn(|| {
            let client = manduca_tests::client::Client::new(&coordinator.url());
            while !done.load(Ordering::Relaxed) {
                client.get("/healthz");
            }
        });
        for sent in sending {
            let (status, told) = sent.join().expect("is answered");
            let known = [200, 400, 404, 413, 422, 429, 503].contains(&status);
            assert!(known && told.len() < 64 << 10, "{}: {status}, {} bytes", bulk.what, told.len());
        }
        done.store(true, Ordering::Relaxed);
        watching.join().expect("health is told meanwhile");
    });
    coordinator.peak_memory().saturating_sub(before)
}

#[test]
fn no_body_costs_more_memory_than_it_may() {
    let config = Config::new("none");
    let coordinator = Coordinator::start_within(SPACE);
    let (path, lease) = trainer(&coordinator, 81);
    let other = worker(&coordinator);
    let mut bulks = studies(&config);
    bulks.push(Bulk::json("a large exchange without a job", &other, vec![b' '; config.large_limit]));
    bulks.extend(exchanges(&other, &lease, config.exchange_limit));
    bulks.extend(exchanges(&path, &lease, config.large_limit - (1 << 20)));
    let mut worst: Vec<(u64, usize)> = Vec::new();
    for (i, bulk) in bulks.iter().enumerate() {
        let cost = cost(&coordinator, bulk, 1);
        println!("{:6.1} MiB: {}", cost as f64 / f64::from(1 << 20), bulk.what);
        assert!(cost <= ONE, "{} costs {cost} bytes", bulk.what);
        worst.push((cost, i));
    }
    // The worst of the small ones and of the large ones, by many at once.
    worst.sort_unstable();
    let large = worst.last().map(|(_, i)| *i);
    let small = worst.iter().rev().map(|(_, i)| *i).find(|i| bulks[*i].body.len() <= config.exchange_limit);
    for i in [small, large].into_iter().flatten() {
        let cost = cost(&coordinator, &bulks[i], 16);
        println!("{:6.1} MiB: sixteen of {}", cost as f64 / f64::from(1 << 20), bulks[i].what);
        assert!(cost <= SIXTEEN, "sixteen of {} cost {cost} bytes", bulks[i].what);
    }
    assert_eq!(coordinator.ask("/readyz").status, 200);
}

/// A training of 16 networks of 1000 neurons, each of all iterations there may be.
fn largest_training(lease: &Value, bounds: &Value) -> Vec<u8> {
    let numbers = |n: usize| vec!["-1.2345678901234567e-1"; n].join(",");
    let network = format!(
        r#"{{"bounds":{bounds},"hidden_weights":[{}],"hidden_biases":[{}],"output_weights":[{}],"output_biases":[{}]}}"#,
        numbers(10_000),
        numbers(1000),
        numbers(4000),
        numbers(4)
    );
    let networks = vec![network.as_str(); 16].join(",");
    let mut curve = String::new();
    for network in 0..16 {
        for iteration in 0..10_000 {
            let comma = if curve.is_empty() { "" } else { "," };
            let e = "1.2345678901234567e-5";
            write!(
                curve,
                r#"{comma}{{"network":{network},"iteration":{iteration},"train_mse":{e},"validation_mse":{e},"test_mse":{e},"damping":{e}}}"#
            )
            .expect("a text takes it");
        }
    }
    let four = json!({ "lift": 0.01, "drag": 0.01, "pitch_moment": 0.01, "power": 0.01 });
    let errors = json!({ "rmse": four, "correlation": four, "count": 3 });
    format!(
        r#"{{"complete":[{{"job":{},"attempt":{},"provenance":{{"wall_s":1.0,"level":"test"}},"result":{{"kind":"train",
            "surrogate":{{"frame":{{"features":"paper"}},"networks":[{networks}]}},"curve":[{curve}],
            "best_iterations":{},"stops":{},"train":{errors},"validation":{errors},"test":{errors},
            "solver_version":"{SOLVER_VERSION}"}}}}]}}"#,
        lease["job"],
        lease["attempt"],
        json!(vec![9999; 16]),
        json!(vec!["all iterations were made"; 16]),
    )
    .into_bytes()
}

#[test]
fn the_largest_training_there_can_be_is_delivered() {
    let coordinator = Coordinator::start_within(SPACE);
    let (path, lease) = trainer(&coordinator, 82);
    let task = coordinator.get(&format!("/v1/jobs/{}/task", lease["job"]));
    let bulk = Bulk::json("the largest training", &path, largest_training(&lease, &task["bounds"]));
    coordinator.forget_peak();
    let before = coordinator.memory();
    let (status, told) = bulk.send(coordinator.address());
    let cost = coordinator.peak_memory().saturating_sub(before);
    println!("{:6.1} MiB: {}, {} bytes", cost as f64 / f64::from(1 << 20), bulk.what, bulk.body.len());
    let told: Value = serde_json::from_str(&told).unwrap_or_else(|_| panic!("{status}: {told}"));
    assert_eq!((status, &told["accepted"]), (200, &json!([lease["job"]])), "{told}");
    assert!(cost <= ONE, "it costs {cost} bytes");
    // The optimisation's task has its networks.
    let next = coordinator.post(&path, &json!({ "want": 1 })).expect(200)["jobs"][0].clone();
    assert_eq!(next["kind"], "optimise");
    let task = coordinator.get(&format!("/v1/jobs/{}/task", next["job"]));
    assert_eq!(task["surrogate"]["networks"].as_array().map(Vec::len), Some(16));
}
