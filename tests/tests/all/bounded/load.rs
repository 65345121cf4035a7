//! Health and renewals while others ask for much. The long form has the figures of docs/reliability.md:
//! `MANDUCA_FAULTS=long cargo test --release -p manduca-tests bounded::load -- --nocapture`.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, Builder, Scope, sleep};
use std::time::{Duration, Instant};

use manduca_numerics::parameters::TABLE;
use manduca_server::Config;
use manduca_tests::bulk::{Bulk, Kept};
use manduca_tests::coordinator::{Coordinator, text};
use manduca_tests::is_long;
use manduca_tests::studies::blades;
use serde_json::{Value, json};

use super::{Hand, largest, largest_training};

/// Between two looks at health, and two renewals.
const PAUSE: Duration = Duration::from_millis(20);

/// How many ask for what, and how long.
struct Load {
    samples: u32,
    predicting: usize,
    sending: usize,
    reading: usize,
    time: Duration,
}

/// How long answers took, and how often each status came.
#[derive(Debug, Default)]
struct Seen {
    seconds: Vec<f64>,
    statuses: BTreeMap<u16, usize>,
}

impl Seen {
    fn quantile(&self, share: f64) -> f64 {
        let mut sorted = self.seconds.clone();
        sorted.sort_by(f64::total_cmp);
        let place = ((sorted.len() as f64 * share) as usize).min(sorted.len().saturating_sub(1));
        sorted.get(place).copied().unwrap_or_default() * 1000.0
    }

    fn told(&self, what: &str) -> String {
        let [median, late, worst] = [0.5, 0.99, 1.0].map(|share| self.quantile(share));
        format!(
            "{what}: {} answers, median {median:.1} ms, p99 {late:.1} ms, worst {worst:.1} ms, {:?}",
            self.seconds.len(),
            self.statuses
        )
    }
}

/// Asks until it is over; what a client is told to wait, it waits.
fn asking<'s>(
    scope: &'s Scope<'s, '_>,
    over: &'s AtomicBool,
    seen: &'s Mutex<Seen>,
    pause: Duration,
    mut ask: impl FnMut() -> Option<u16> + Send + 's,
) {
    let client = move || {
        while !over.load(Ordering::Relaxed) {
            let began = Instant::now();
            let status = ask();
            let mut seen = seen.lock().expect("no client panics");
            seen.seconds.push(began.elapsed().as_secs_f64());
            *seen.statuses.entry(status.unwrap_or_default()).or_default() += 1;
            drop(seen);
            sleep(if status == Some(429) { Duration::from_secs(1) } else { pause });
        }
    };
    Builder::new().stack_size(256 << 10).spawn_scoped(scope, client).expect("a thread");
}

/// A study with the largest surrogate there can be, and one of so many samples, by their ids.
fn trained(hand: &Hand<'_>, samples: u32) -> [String; 2] {
    let lease = hand.to_training(&largest(91, 20));
    let task = hand.coordinator.get(&format!("/v1/jobs/{}/task", lease["job"]));
    let training = largest_training(&lease, &task["bounds"], 91, 20);
    let (status, told) = Bulk::json("a training", &hand.path, training).send(hand.coordinator.address());
    assert_eq!(status, 200, "{told}");
    let study = hand.coordinator.submit(&blades("many", 92, samples));
    hand.fly();
    assert_eq!(hand.coordinator.study(&study)["samples"]["succeeded"], samples);
    [text(&lease["study"]), study]
}

#[test]
fn health_and_renewals_go_on_while_others_ask_for_much() {
    let load = if is_long() {
        Load { samples: 100_000, predicting: 16, sending: 4, reading: 1000, time: Duration::from_secs(60) }
    } else {
        Load { samples: 200, predicting: 4, sending: 2, reading: 50, time: Duration::from_secs(3) }
    };
    let coordinator = Coordinator::start();
    let [renewing, sender] = [Hand::new(&coordinator), Hand::new(&coordinator)];
    let [predictor, flown] = trained(&renewing, load.samples);
    sender.to_training(&blades("large", 93, 20));
    coordinator.submit(&blades("held", 94, 40));
    let leases = renewing.exchange(&json!({ "want": 40 }))["jobs"].clone();
    let renew: Vec<_> = leases
        .as_array()
        .expect("leases")
        .iter()
        .map(|l| json!({ "job": l["job"], "attempt": l["attempt"] }))
        .collect();
    assert!(renew.len() >= 20, "{leases}");
    let renewal = json!({ "renew": renew }).to_string();
    let point: serde_json::Map<_, _> = TABLE.iter().map(|p| (p.name.to_owned(), json!(p.least))).collect();
    let points = json!({ "points": vec![Value::Object(point); 1000] }).to_string();
    let junk = format!(
        r#"{{"complete":[{{"job":1,"attempt":1,"result":{{"kind":"train","junk":[{}0]}}}}]}}"#,
        r#"{"":0},"#.repeat(9_000_000)
    );
    assert!(junk.len() < Config::new("none").large_limit);
    let bulk = Bulk::json("unknown fields", &sender.path, junk);
    let (over, address) = (AtomicBool::new(false), coordinator.address());
    let seen: [Mutex<Seen>; 5] = Default::default();
    let [health, renewals, predictions, exchanges, reads] = &seen;
    let predictions_path = format!("/v1/studies/{predictor}/surrogate/predictions");
    let throughput = format!("/v1/studies/{flown}/throughput");
    thread::scope(|scope| {
        for _ in 0..load.reading {
            let mut client = Kept::new(address);
            let throughput = &throughput;
            asking(scope, &over, reads, Duration::ZERO, move || client.get(throughput));
        }
        for _ in 0..load.predicting {
            let (mut client, path, points) = (Kept::new(address), &predictions_path, &points);
            asking(scope, &over, predictions, Duration::ZERO, move || {
                client.post(path, points).map(|(status, _)| status)
            });
        }
        for _ in 0..load.sending {
            let bulk = &bulk;
            asking(scope, &over, exchanges, Duration::ZERO, move || Some(bulk.send(address).0));
        }
        let mut client = Kept::new(address);
        asking(scope, &over, health, PAUSE, move || client.get("/healthz"));
        let mut client = Kept::new(address);
        let (renewing, renewal) = (&renewing.path, &renewal);
        asking(scope, &over, renewals, PAUSE, move || {
            let (status, told) = client.post(renewing, renewal)?;
            let told: Value = serde_json::from_slice(&told).unwrap_or_default();
            assert_eq!(told["cancel"], json!([]), "a lease was lost");
            Some(status)
        });
        sleep(load.time);
        over.store(true, Ordering::Relaxed);
    });
    let names = ["health", "renewals", "predictions", "exchanges of 63 MB", "throughput"];
    for (seen, name) in seen.iter().zip(names) {
        let seen = seen.lock().expect("no client panics");
        println!("{}", seen.told(name));
        assert!(!seen.seconds.is_empty(), "{name}: none was answered");
    }
    println!("peak memory {} MiB", coordinator.peak_memory() >> 20);
    for seen in [health, renewals] {
        let statuses = &seen.lock().expect("no client panics").statuses;
        assert_eq!(statuses.keys().collect::<Vec<_>>(), [&200], "{statuses:?}");
    }
}
