//! Clients which submit studies, take jobs and return results, and remember what was acknowledged.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use manduca_numerics::insect::Insect;
use serde_json::{Value, json};

use crate::SOLVER_VERSION;
use crate::client::Client;
use crate::studies::blades;

/// Samples of a study they submit.
const SAMPLES: u32 = 200;

/// What was acknowledged, and what must not have been.
#[derive(Debug, Default)]
pub struct Ledger {
    /// Jobs whose result was acknowledged.
    pub results: BTreeSet<i64>,
    /// Studies whose submission was.
    pub studies: BTreeSet<String>,
    /// Acknowledged results which were asked for again.
    pub lost: BTreeSet<i64>,
    /// Answers with a status of 5xx.
    pub refused: u64,
}

/// Clients at work.
#[derive(Debug)]
pub struct Crowd {
    ledger: Arc<Mutex<Ledger>>,
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Crowd {
    /// So many clients of a coordinator which may come and go.
    pub fn start(url: &str, clients: u64) -> Self {
        let (ledger, stop) = (Arc::new(Mutex::new(Ledger::default())), Arc::new(AtomicBool::new(false)));
        let threads = (0..clients)
            .map(|i| {
                let (ledger, stop, url) = (ledger.clone(), stop.clone(), url.to_owned());
                std::thread::spawn(move || Member { client: Client::new(&url), number: i, ledger, stop }.work())
            })
            .collect();
        Self { ledger, stop, threads }
    }

    /// How many results were acknowledged so far.
    pub fn acknowledged(&self) -> usize {
        self.ledger.lock().expect("no client panics").results.len()
    }

    /// Ends the clients; gives what they remember.
    pub fn end(self) -> Ledger {
        self.stop.store(true, Ordering::Relaxed);
        self.threads.into_iter().for_each(|thread| thread.join().expect("no client panics"));
        std::mem::take(&mut *self.ledger.lock().expect("no client panics"))
    }
}

struct Member {
    client: Client,
    number: u64,
    ledger: Arc<Mutex<Ledger>>,
    stop: Arc<AtomicBool>,
}

impl Member {
    fn work(self) {
        let (mut worker, mut held, mut submitted): (Option<String>, Vec<Value>, u64) = (None, Vec::new(), 0);
        while !self.stop.load(Ordering::Relaxed) {
            let Some(path) = worker.clone() else {
                worker = self.register();
                continue;
            };
            let complete: Vec<_> = held.iter().map(completion).collect();
            let Some((status, told)) = self.post(&path, &json!({ "complete": complete, "want": 4 }), None) else {
                continue;
            };
            if status == 404 {
                (worker, held) = (None, Vec::new());
                continue;
            }
            if status != 200 {
                continue;
            }
            held = told["jobs"].as_array().cloned().unwrap_or_default();
            held.retain(|lease| lease["kind"] == "simulate");
            self.note(&told, &held);
            if held.is_empty() && self.submit(submitted) {
                submitted += 1;
            }
        }
    }

    fn note(&self, told: &Value, held: &[Value]) {
        let mut ledger = self.ledger.lock().expect("no client panics");
        ledger.results.extend(told["accepted"].as_array().into_iter().flatten().filter_map(Value::as_i64));
        let again: Vec<_> =
            held.iter().filter_map(|l| l["job"].as_i64()).filter(|j| ledger.results.contains(j)).collect();
        ledger.lost.extend(again);
    }

    /// Some status and answer, or nobody there.
    fn post(&self, path: &str, body: &Value, key: Option<&str>) -> Option<(u16, Value)> {
        let mut request = self.client.request("POST", path).json(body);
        if let Some(key) = key {
            request = request.header("idempotency-key", key);
        }
        let Ok(answer) = self.client.try_send(request) else {
            std::thread::sleep(std::time::Duration::from_millis(20));
            return None;
        };
        if answer.status >= 500 {
            self.ledger.lock().expect("no client panics").refused += 1;
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        Some((answer.status, serde_json::from_str(&answer.body).unwrap_or_default()))
    }

    fn register(&self) -> Option<String> {
        let registration = json!({ "name": format!("member-{}", self.number), "slots": 64, "protocol_version": 1,
            "solver_version": SOLVER_VERSION, "level": "test" });
        let (status, told) = self.post("/v1/workers", &registration, None)?;
        (status == 201).then(|| format!("/v1/workers/{}/exchange", told["worker"].as_str().expect("an id")))
    }

    fn submit(&self, number: u64) -> bool {
        let key = format!("{}-{number}", self.number);
        let study = blades("crowd", self.number * 100_000 + number, SAMPLES);
        let Some((status, told)) = self.post("/v1/studies", &study, Some(&key)) else { return false };
        let taken = status == 201 || status == 200;
        if taken {
            let id = told["id"].as_str().expect("an id").to_owned();
            self.ledger.lock().expect("no client panics").studies.insert(id);
        }
        taken
    }
}

/// A result of a simulation, the same whenever it is asked for.
pub fn completion(lease: &Value) -> Value {
    flown(lease, lease["job"].as_i64().unwrap_or_default() as f64)
}

/// A result of a simulation with so much lift over the weight.
pub fn flown(lease: &Value, x: f64) -> Value {
    let e = |mean: f64, scale: f64| json!({ "mean": mean * scale, "se": 0.001 * scale });
    let (scaled, scales) = ([x, 0.0, 0.1, 1.1], Insect::default().scales());
    let si = |i: usize| e(scaled[i], scales[i]);
    let over = |i: usize| e(scaled[i], 1.0);
    let (lift, power) = (x * scales[0], 1.1 * scales[3]);
    let joint = json!({ "aerodynamic_w": power / 3.0, "inertial_w": 0.0, "required_w": power / 3.0 });
    json!({
        "job": lease["job"], "attempt": lease["attempt"], "provenance": { "wall_s": 0.01, "level": "test" },
        "result": {
            "kind": "simulate", "outcome": "ok",
            "means": { "lift_n": si(0), "drag_n": si(1), "pitch_moment_nm": si(2), "power_w": si(3) },
            "scaled": { "lift": over(0), "drag": over(1), "pitch_moment": over(2), "power": over(3) },
            "joints": { "sweep": joint, "elevation": joint, "rotation": joint },
            "power_per_lift_w_per_n": (lift > 0.0).then(|| power / lift), "strokes_averaged": 1,
            "solver_version": SOLVER_VERSION
        }
    })
}
