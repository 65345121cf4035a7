//! Memory of a compute slot.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail};
use manduca_numerics::cases::CASES;
use manduca_numerics::table::Table;
use manduca_numerics::uvlm::Settings;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::study::ModelSpec;
use manduca_protocol::task::{SimulateTask, Task};
use manduca_worker::slot::Message;

use crate::commands::host;

/// Most memory a slot has had after flying one stroke at these settings, MB (10^6 bytes); none
/// where the system does not tell.
pub fn peak_mb(settings: &Settings) -> Result<Option<f64>> {
    let solver: BTreeMap<String, f64> = settings.entries().map(|(name, value)| (name.to_owned(), value)).collect();
    let model = ModelSpec { solver, ..ModelSpec::default() };
    let task = Task::Simulate(SimulateTask { model, parameters: ParameterValues(CASES[0].parameters) });
    let mut slot = Command::new(host::this_program()?)
        .arg("slot")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .context("cannot start a slot")?;
    let peak = after(&task, &mut slot);
    // Its input has ended with the borrow of its pipes; it leaves by itself, or is made to.
    let _ = slot.kill();
    let _ = slot.wait();
    peak
}

fn after(task: &Task, slot: &mut std::process::Child) -> Result<Option<f64>> {
    let (Some(stdin), Some(stdout)) = (&mut slot.stdin, &mut slot.stdout) else { bail!("no pipes to the slot") };
    let mut line = serde_json::to_vec(task)?;
    line.push(b'\n');
    stdin.write_all(&line)?;
    stdin.flush()?;
    for line in BufReader::new(stdout).lines() {
        match serde_json::from_str(&line?)? {
            Message::Progress(_) | Message::Checkpoint { .. } => {}
            Message::Done { .. } => return Ok(resident_peak_mb(slot.id())),
            Message::Failed { reason, .. } => bail!("the slot failed: {reason}"),
        }
    }
    bail!("the slot broke off")
}

/// Most memory a process which still runs has had, MB: `VmHWM` (Linux).
pub fn resident_peak_mb(id: u32) -> Option<f64> {
    let status = std::fs::read_to_string(format!("/proc/{id}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: f64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kibibytes * 1024e-6)
}
