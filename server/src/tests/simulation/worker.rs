//! A made-up worker: it takes jobs, computes for a while, renews, returns what it has until answered.

use std::collections::{BTreeMap, VecDeque};

use manduca_protocol::ids::JobId;
use manduca_protocol::worker::{ExchangeResponse, Lease};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

use crate::tests::answers::{completion, registration, result};

const SLOTS: usize = 2;
/// How long it waits for an answer, ms.
const PATIENCE: i64 = 5000;
const RENEW: i64 = 5000;

/// A request as it leaves a worker.
#[derive(Debug, Clone)]
pub(super) struct Message {
    pub(super) path: String,
    pub(super) body: Value,
}

impl Message {
    pub(super) fn is_exchange(&self) -> bool {
        self.path.ends_with("/exchange")
    }

    /// Whether it carries the result of a training, or of an optimisation.
    pub(super) fn is_large(&self) -> bool {
        let complete = self.body["complete"].as_array().into_iter().flatten();
        complete.map(|completion| &completion["result"]["kind"]).any(|kind| kind != "simulate")
    }
}

#[derive(Debug, Default)]
pub(super) struct Worker {
    /// Changes when it is killed: what was sent to the dead reaches nobody.
    pub(super) life: u64,
    path: Option<String>,
    running: BTreeMap<JobId, (Lease, i64)>,
    outbox: VecDeque<(bool, Value)>,
    /// The request under way, until when it is waited for, and how many reports it carries.
    waiting: Option<(u64, i64, usize)>,
    /// An answer was lost which may have brought jobs.
    missed: bool,
    renew_at: i64,
    pub(super) stopped_until: i64,
}

impl Worker {
    /// SIGKILL, and a fresh start.
    pub(super) fn kill(&mut self) {
        *self = Self { life: self.life + 1, ..Self::default() };
    }

    /// Does what is due; gives what it sends.
    pub(super) fn act(&mut self, now: i64, message: u64, rng: &mut ChaCha8Rng, faulty: bool) -> Option<Message> {
        if now < self.stopped_until {
            return None;
        }
        let ended: Vec<JobId> = self.running.iter().filter(|(_, (_, end))| *end <= now).map(|(job, _)| *job).collect();
        for (lease, _) in ended.into_iter().filter_map(|job| self.running.remove(&job)) {
            // Two in a row of one job are likely enough, three would end the study otherwise than undisturbed.
            let fails = faulty && lease.attempt == 1 && rng.random_bool(0.05);
            let report = if fails {
                json!({ "job": lease.job, "attempt": lease.attempt, "reason": "made up" })
            } else {
                completion(&lease, result(&lease))
            };
            self.outbox.push_back((!fails, report));
        }
        if self.waiting.as_ref().is_some_and(|(_, until, _)| now < *until) {
            return None;
        }
        self.missed |= self.waiting.is_some();
        let (path, body, batch) = match &self.path {
            None => ("/v1/workers".to_owned(), registration("made-up"), 0),
            Some(path) => {
                let batch = self.outbox.len().min(3);
                (format!("{path}/exchange"), self.exchange(now, batch), batch)
            }
        };
        self.waiting = Some((message, now + PATIENCE, batch));
        Some(Message { path, body })
    }

    fn exchange(&mut self, now: i64, batch: usize) -> Value {
        let of = |wanted: bool| -> Vec<&Value> {
            self.outbox.iter().take(batch).filter(|(done, _)| *done == wanted).map(|(_, report)| report).collect()
        };
        let (complete, fail) = (of(true), of(false));
        let renew: Vec<_> = if now >= self.renew_at {
            self.running.values().map(|(l, _)| json!({ "job": l.job, "attempt": l.attempt })).collect()
        } else {
            Vec::new()
        };
        let want = SLOTS - self.running.len();
        let mut body = json!({ "complete": complete, "fail": fail, "renew": renew, "want": want });
        if want > 0 && std::mem::take(&mut self.missed) {
            let reported = self.outbox.iter().map(|(_, report)| report["job"].clone());
            let have: Vec<_> = self.running.keys().map(|job| json!(job)).chain(reported).collect();
            body["have"] = json!(have);
        }
        if now >= self.renew_at {
            self.renew_at = now + RENEW;
        }
        body
    }

    /// An answer arrives; one to a request it has given up is dropped.
    pub(super) fn hear(&mut self, now: i64, message: u64, status: u16, body: &[u8], rng: &mut ChaCha8Rng) {
        let Some((_, _, batch)) = self.waiting.take_if(|(waited, ..)| *waited == message) else { return };
        match (status, &self.path) {
            (201, None) => {
                let registered: Value = serde_json::from_slice(body).expect("a registration");
                self.path = registered["worker"].as_str().map(|id| format!("/v1/workers/{id}"));
            }
            (200, Some(_)) => {
                let told: ExchangeResponse = serde_json::from_slice(body).expect("an exchange");
                self.outbox.drain(..batch);
                for job in told.cancel {
                    self.running.remove(&job);
                }
                for lease in told.jobs {
                    let end = now + rng.random_range(100..8000);
                    self.running.insert(lease.job, (lease, end));
                }
            }
            (404, Some(_)) => self.kill(),
            _ => self.missed = true,
        }
    }
}
