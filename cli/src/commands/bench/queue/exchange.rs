//! What a made-up worker says and hears.

use std::fmt::Write;

use anyhow::{Context, Result, bail};
use manduca_numerics::insect::Insect;
use manduca_numerics::simulation::{SOLVER_VERSION, level};
use manduca_protocol::ids::JobId;
use manduca_protocol::worker::{PROTOCOL_VERSION, RegisterRequest, RegisterResponse};
use manduca_worker::http::{self, Http};
use serde::Deserialize;

/// A lease as far as its fence.
#[derive(Debug, Clone, Copy, Deserialize)]
pub struct Granted {
    pub job: JobId,
    pub attempt: u32,
}

/// An answer as far as it is needed here: the tasks are not flown.
#[derive(Debug, Deserialize)]
pub struct Answer {
    pub accepted: Vec<JobId>,
    pub rejected: Vec<serde::de::IgnoredAny>,
    pub jobs: Vec<Granted>,
}

/// Registers a worker of so many slots and gives the path of its exchange.
pub async fn register(http: &Http, name: &str, slots: u32) -> Result<String> {
    let request = RegisterRequest {
        name: name.to_owned(),
        slots,
        protocol_version: PROTOCOL_VERSION,
        solver_version: SOLVER_VERSION.into(),
        level: level().into(),
    };
    let answer: RegisterResponse = http::call(http.post("/v1/workers").json(&request)).await?;
    Ok(format!("/v1/workers/{}/exchange", answer.worker))
}

/// One round trip: results of what was granted, and a wish for more.
pub async fn exchange(http: &Http, path: &str, done: &[Granted], want: u32, wait_s: u32) -> Result<Answer> {
    let request = http
        .post(path)
        .timeout(http::CALL + std::time::Duration::from_secs(wait_s.into()))
        .header("content-type", "application/json")
        .body(body(done, want, wait_s));
    let answer: Answer = http::call(request).await.context("an exchange failed")?;
    if !answer.rejected.is_empty() || answer.accepted.len() != done.len() {
        bail!("{} of {} results were refused", answer.rejected.len(), done.len());
    }
    Ok(answer)
}

fn body(done: &[Granted], want: u32, wait_s: u32) -> String {
    let mut text = String::with_capacity(200 + done.len() * 1400);
    text.push_str("{\"complete\":[");
    for (i, Granted { job, attempt }) in done.iter().enumerate() {
        let comma = if i == 0 { "" } else { "," };
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "{comma}{{\"job\":{job},\"attempt\":{attempt},\"result\":{},\"provenance\":{{\"wall_s\":0.25,\"level\":\"{}\"}}}}",
            result(job.0),
            level()
        );
    }
    let _ = write!(text, "],\"want\":{want},\"wait_s\":{wait_s}}}");
    text
}

/// A result with as many digits as a flown one, other numbers for each job, which agree with each other.
fn result(job: i64) -> String {
    let x = 0.123_456_789_012_345_6 + job as f64 * 1e-7;
    let power = [0.51, 0.11, 0.23].map(|scale| x * scale);
    let si = [x * 0.013, x * 0.0017, x * 0.000_11, power.iter().sum()];
    let e = |mean: f64| format!("{{\"mean\":{mean},\"se\":{}}}", mean * 1.234_567_890_123e-3);
    let scales = Insect::default().scales();
    let [lift_n, drag_n, moment_nm, power_w] = si.map(e);
    let [lift, drag, moment, over] = std::array::from_fn(|i| e(si[i] / scales[i]));
    let [sweep, elevation, rotation] = power.map(|required| {
        let inertial = required * 0.345_678_901_234_567;
        let aerodynamic = required - inertial;
        format!("{{\"aerodynamic_w\":{aerodynamic},\"inertial_w\":{inertial},\"required_w\":{required}}}")
    });
    format!(
        "{{\"kind\":\"simulate\",\"outcome\":\"ok\",\"means\":{{\"lift_n\":{lift_n},\"drag_n\":{drag_n},\
         \"pitch_moment_nm\":{moment_nm},\"power_w\":{power_w}}},\"scaled\":{{\"lift\":{lift},\"drag\":{drag},\
         \"pitch_moment\":{moment},\"power\":{over}}},\"joints\":{{\"sweep\":{sweep},\"elevation\":{elevation},\
         \"rotation\":{rotation}}},\"power_per_lift_w_per_n\":{},\"strokes_averaged\":1,\
         \"solver_version\":\"{SOLVER_VERSION}\"}}",
        si[3] / si[0]
    )
}

/// Size of a result.
pub fn result_bytes() -> usize {
    result(123_456).len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use manduca_protocol::worker::ExchangeRequest;

    #[test]
    fn what_is_said_is_an_exchange_of_a_kilobyte_per_result() {
        let done = [Granted { job: JobId(7), attempt: 2 }, Granted { job: JobId(8), attempt: 1 }];
        let request: ExchangeRequest = serde_json::from_str(&body(&done, 3, 0)).unwrap();
        assert_eq!((request.complete.len(), request.complete[0].attempt, request.want), (2, 2, 3));
        assert_ne!(request.complete[0].result, request.complete[1].result);
        assert!((950..1150).contains(&result_bytes()), "{}", result_bytes());
    }
}
