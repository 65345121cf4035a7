//! What one request may cost: the worst body of each route, alone and sixteen at once, against the
//! memory docs/reliability.md allows it. The coordinator has so little address space that one which
//! took what such bodies used to take would end.

#[path = "bounded/load.rs"]
mod load;

use std::fmt::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use manduca_numerics::surrogate::Split;
use manduca_protocol::resolve::MAX_SAMPLES;
use manduca_server::Config;
use manduca_tests::bulk::Bulk;
use manduca_tests::chance::Chance;
use manduca_tests::coordinator::Coordinator;
use manduca_tests::crowd::flown;
use manduca_tests::studies::blades;
use manduca_tests::{SOLVER_VERSION, is_long, wait_for};
use serde_json::{Value, json};

/// Memory one request may cost, bytes.
const ONE: u64 = 128 << 20;
/// Memory sixteen at once may cost, bytes.
const SIXTEEN: u64 = 512 << 20;
/// Address space of the coordinator, bytes.
const SPACE: u64 = 4 << 30;

/// A made-up worker which is as fast as the coordinator lets it be.
struct Hand<'c> {
    coordinator: &'c Coordinator,
    /// Where it exchanges.
    path: String,
}

impl<'c> Hand<'c> {
    /// Registers one.
    fn new(coordinator: &'c Coordinator) -> Self {
        let registration = json!({ "name": "bulky", "slots": 500, "protocol_version": 1,
            "solver_version": SOLVER_VERSION, "level": "test" });
        let told = coordinator.post("/v1/workers", &registration).expect(201);
        Self { coordinator, path: format!("/v1/workers/{}/exchange", told["worker"].as_str().expect("an id")) }
    }

    fn exchange(&self, what: &Value) -> Value {
        self.coordinator.post(&self.path, what).expect(200)
    }

    /// Flies all there is; gives what is leased to it then, and how many were flown.
    fn fly(&self) -> (Option<Value>, usize) {
        let (mut complete, mut flown): (Vec<Value>, usize) = (Vec::new(), 0);
        loop {
            let told = self.exchange(&json!({ "complete": complete, "want": 1000 }));
            assert_eq!(told["accepted"].as_array().map(Vec::len), Some(complete.len()), "{}", told["rejected"]);
            flown += complete.len();
            let jobs = told["jobs"].as_array().expect("leases");
            let (strokes, others): (Vec<_>, Vec<_>) = jobs.iter().partition(|lease| lease["kind"] == "simulate");
            complete = strokes.into_iter().map(flight).collect();
            if complete.is_empty() {
                return (others.first().map(|lease| (*lease).clone()), flown);
            }
        }
    }

    /// Flies the samples of a study; gives the lease of its training.
    fn to_training(&self, study: &Value) -> Value {
        self.coordinator.submit(study);
        let (lease, _) = self.fly();
        lease.filter(|lease| lease["kind"] == "train").expect("a training follows")
    }
}

/// Lift over the weight of a made-up stroke, per Hz.
const LIFT: f64 = 0.04;

/// The result of a made-up flight, whose lift alone depends on its stroke.
fn flight(lease: &Value) -> Value {
    let frequency = lease["task"]["parameters"]["frequency_hz"].as_f64().expect("a stroke has a frequency");
    flown(lease, LIFT * frequency)
}

/// A study whose training is the largest there can be: 16 networks of 1000 neurons.
fn largest(seed: u64, samples: u32) -> Value {
    let mut study = blades("bulky", seed, samples);
    study["surrogate"] = json!({ "neurons": 1000, "ensemble": 16, "max_iterations": 10_000, "patience": 1,
        "features": "paper" });
    study
}

fn mib(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 20)
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
    let (trainer, other) = (Hand::new(&coordinator), Hand::new(&coordinator).path);
    let lease = trainer.to_training(&blades("bulky", 81, 20));
    let path = &trainer.path;
    let mut bulks = studies(&config);
    bulks.push(Bulk::json("a large exchange without a job", &other, vec![b' '; config.large_limit]));
    bulks.extend(exchanges(&other, &lease, config.exchange_limit));
    bulks.extend(exchanges(path, &lease, config.large_limit - (1 << 20)));
    let mut worst: Vec<(u64, usize)> = Vec::new();
    for (i, bulk) in bulks.iter().enumerate() {
        let cost = cost(&coordinator, bulk, 1);
        println!("{:6.1} MiB: {}", mib(cost), bulk.what);
        assert!(cost <= ONE, "{} costs {cost} bytes", bulk.what);
        worst.push((cost, i));
    }
    // The worst of the small ones and of the large ones, by many at once.
    worst.sort_unstable();
    let large = worst.last().map(|(_, i)| *i);
    let small = worst.iter().rev().map(|(_, i)| *i).find(|i| bulks[*i].body.len() <= config.exchange_limit);
    for i in [small, large].into_iter().flatten() {
        let cost = cost(&coordinator, &bulks[i], 16);
        println!("{:6.1} MiB: sixteen of {}", mib(cost), bulks[i].what);
        assert!(cost <= SIXTEEN, "sixteen of {} cost {cost} bytes", bulks[i].what);
    }
    assert_eq!(coordinator.ask("/readyz").status, 200);
}

/// The result of a training of 16 networks of 1000 neurons, each of as many iterations as there may be. It predicts
/// made-up flights as they are: the sigmoid of a small number is that number.
fn largest_training(lease: &Value, bounds: &Value, seed: u64, samples: u32) -> Vec<u8> {
    const SMALL: f64 = 1e-5;
    let mut chance = Chance::new(seed);
    // Numbers of full length, which do not compress.
    let mut number = |exponent: i32| format!("-1.{:016}e{exponent}", chance.next() % 10_u64.pow(16));
    let [lower, upper] = ["lower", "upper"].map(|end| bounds[end][0].as_f64().expect("a bound"));
    let (middle, half) = (0.5 * (lower + upper), 0.5 * (upper - lower));
    let mut networks: Vec<String> = Vec::new();
    for _ in 0..16 {
        // But for the first all neurons have next to no weight.
        let mut hidden: Vec<String> = (0..10_000).map(|_| number(-1)).collect();
        hidden[..10].fill("0.0".into());
        hidden[0] = SMALL.to_string();
        let mut biases: Vec<String> = (0..1000).map(|_| number(-1)).collect();
        biases[0] = "0.0".into();
        let mut output: Vec<String> = (0..4000).map(|_| number(-300)).collect();
        output[0] = (LIFT * half / SMALL).to_string();
        networks.push(format!(
            r#"{{"bounds":{bounds},"hidden_weights":[{}],"hidden_biases":[{}],"output_weights":[{}],"output_biases":{}}}"#,
            hidden.join(","),
            biases.join(","),
            output.join(","),
            json!([LIFT * middle, 0.0, 0.1, 1.1])
        ));
    }
    let networks = networks.join(",");
    let mut curve = String::new();
    for network in 0..16 {
        for iteration in 0..10_000 {
            let comma = if curve.is_empty() { "" } else { "," };
            let [a, b, c, d] = std::array::from_fn(|_| number(5).replace('-', ""));
            write!(
                curve,
                r#"{comma}{{"network":{network},"iteration":{iteration},"train_mse":{a},"validation_mse":{b},"test_mse":{c},"damping":{d}}}"#
            )
            .expect("a text takes it");
        }
    }
    let [zero, one] = [0.0, 1.0].map(|x| json!({ "lift": x, "drag": x, "pitch_moment": x, "power": x }));
    let split = Split::new(samples as usize, 0.8, 0.1, seed);
    let errors = |share: &[usize]| json!({ "rmse": zero, "correlation": one, "count": share.len() });
    format!(
        r#"{{"complete":[{{"job":{},"attempt":{},"provenance":{{"wall_s":1.0,"level":"test"}},"result":{{"kind":"train",
            "surrogate":{{"frame":{{"features":"paper"}},"networks":[{networks}]}},"curve":[{curve}],
            "best_iterations":{},"stops":{},"train":{},"validation":{},"test":{},
            "solver_version":"{SOLVER_VERSION}"}}}}]}}"#,
        lease["job"],
        lease["attempt"],
        json!(vec![9999; 16]),
        json!(vec!["all iterations were made"; 16]),
        errors(&split.train),
        errors(&split.validation),
        errors(&split.test),
    )
    .into_bytes()
}

#[test]
fn the_largest_training_there_can_be_is_delivered() {
    let (seed, samples) = (82, if is_long() { MAX_SAMPLES } else { 20 });
    let coordinator = Coordinator::start_within(SPACE);
    let hand = Hand::new(&coordinator);
    let lease = hand.to_training(&largest(seed, samples));
    let task = coordinator.get(&format!("/v1/jobs/{}/task", lease["job"]));
    let training = largest_training(&lease, &task["bounds"], seed, samples);
    drop(task);
    let bulk = Bulk::json("the largest training", &hand.path, training);
    coordinator.forget_peak();
    let before = coordinator.memory();
    let (status, told) = bulk.send(coordinator.address());
    let cost = coordinator.peak_memory().saturating_sub(before);
    println!("{:6.1} MiB: {}, {} bytes, {samples} samples", mib(cost), bulk.what, bulk.body.len());
    let told: Value = serde_json::from_str(&told).unwrap_or_else(|_| panic!("{status}: {told}"));
    assert_eq!((status, &told["accepted"]), (200, &json!([lease["job"]])), "{told}");
    assert!(cost <= ONE, "it costs {cost} bytes");
    // Once it was checked, the optimisation's task has its networks.
    let next = wait_for("the optimisation", || hand.exchange(&json!({ "want": 1 }))["jobs"].get(0).cloned());
    println!("{:6.1} MiB: its check included", mib(coordinator.peak_memory().saturating_sub(before)));
    assert_eq!(next["kind"], "optimise");
    let task = coordinator.get(&format!("/v1/jobs/{}/task", next["job"]));
    assert_eq!(task["surrogate"]["networks"].as_array().map(Vec::len), Some(16));
}
