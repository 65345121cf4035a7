//! The coordinator as a process of its own, and what the system says of it.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use tempfile::TempDir;

use crate::commands::host;

/// What `serve` says before its address.
const LISTENING: &str = "listening on ";
const STARTS_WITHIN: Duration = Duration::from_secs(20);
/// Clock ticks per second in `/proc`: 100 on every Linux.
const TICKS: f64 = 100.0;

/// A coordinator on a fresh database. Dropped, it is killed and its folder removed.
pub struct Coordinator {
    child: Child,
    url: String,
    _folder: TempDir,
}

impl Coordinator {
    /// Starts one whose database is below a folder.
    pub fn start(below: &Path) -> Result<Self> {
        let folder = super::temporary(below)?;
        let log = folder.path().join("log");
        let mut command = Command::new(host::this_program()?);
        command.args(["serve", "--listen", "127.0.0.1:0", "--data"]).arg(folder.path().join("data"));
        // As it is by default, whatever is set here.
        for name in ["MANDUCA_LOG", "RUST_LOG"] {
            command.env_remove(name);
        }
        let child = command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(std::fs::File::create(&log)?)
            .spawn()
            .context("cannot start a coordinator")?;
        let mut coordinator = Self { child, url: String::new(), _folder: folder };
        coordinator.url = coordinator.listening(&log)?;
        Ok(coordinator)
    }

    fn listening(&mut self, log: &Path) -> Result<String> {
        let start = Instant::now();
        while start.elapsed() < STARTS_WITHIN {
            let said = std::fs::read_to_string(log)?;
            let found = said.split_once(LISTENING).and_then(|(_, rest)| rest.split_once(','));
            if let Some((url, _)) = found {
                return Ok(url.to_owned());
            }
            if let Some(status) = self.child.try_wait()? {
                bail!("the coordinator ended with {status}: {said}");
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        bail!("the coordinator does not start")
    }

    /// Its address.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// Processor time it has used, s (Linux).
    pub fn cpu_s(&self) -> Option<f64> {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.child.id())).ok()?;
        // The name before these fields is in parentheses and may contain anything.
        let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(11);
        let user: f64 = fields.next()?.parse().ok()?;
        let system: f64 = fields.next()?.parse().ok()?;
        Some((user + system) / TICKS)
    }

    /// Memory it has now, MB (Linux).
    pub fn resident_mb(&self) -> Option<f64> {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).ok()?;
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
        let kibibytes: f64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
        Some(kibibytes * 1024e-6)
    }
}

impl Drop for Coordinator {
    fn drop(&mut self) {
        // It may have ended by itself: gone is gone.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The one-minute load average (Linux).
pub fn load_average() -> Option<f64> {
    std::fs::read_to_string("/proc/loadavg").ok()?.split_whitespace().next()?.parse().ok()
}
