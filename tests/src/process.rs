//! Child processes which never outlive their test.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};

use crate::wait_for;

/// A running process with its standard error in a file. Dropped, also by a panic, it is killed.
#[derive(Debug)]
pub struct Process {
    child: Child,
    name: String,
    log: PathBuf,
}

impl Process {
    /// Starts a command; what it says goes to `<folder>/<name>.log`.
    pub fn start(command: Command, folder: &Path, name: &str) -> Self {
        let file = File::create(folder.join(format!("{name}.log"))).expect("a log file can be made");
        // A pipe nobody reads would fill up and block the child; a file cannot.
        Self::start_saying(command, folder, name, file)
    }

    /// [`Process::start`] with something else for what it says.
    pub fn start_saying(mut command: Command, folder: &Path, name: &str, stderr: impl Into<Stdio>) -> Self {
        let child = command.stdout(Stdio::null()).stderr(stderr).spawn().expect("the program can be started");
        Self { child, name: name.to_owned(), log: folder.join(format!("{name}.log")) }
    }

    /// Lets go of the pipe into which it says things.
    pub fn stop_listening(&mut self) {
        self.child.stderr = None;
    }

    /// Its id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// What it has said so far.
    pub fn said(&self) -> String {
        fs::read(&self.log).map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).unwrap_or_default()
    }

    /// Most memory it has had, bytes: `VmHWM`.
    ///
    /// # Panics
    /// Where the system does not tell (Linux does), or once it has ended.
    pub fn peak_memory(&self) -> u64 {
        self.status_bytes("VmHWM:")
    }

    /// Memory it has now, bytes: `VmRSS`.
    ///
    /// # Panics
    /// As [`Process::peak_memory`].
    pub fn memory(&self) -> u64 {
        self.status_bytes("VmRSS:")
    }

    /// Forgets how much memory it has had: [`Process::peak_memory`] is that from now on.
    ///
    /// # Panics
    /// Where the system does not let it (Linux does).
    pub fn forget_peak(&self) {
        fs::write(format!("/proc/{}/clear_refs", self.child.id()), "5").expect("the system forgets");
    }

    fn status_bytes(&self, name: &str) -> u64 {
        let status = fs::read_to_string(format!("/proc/{}/status", self.child.id())).expect("it runs");
        let line = status.lines().find_map(|line| line.strip_prefix(name)).expect("the system tells");
        line.split_whitespace().next().and_then(|kib| kib.parse::<u64>().ok()).expect("a number") * 1024
    }

    /// How it ended, if it has.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().expect("a child can be waited for")
    }

    /// Ends it as a power cut would (SIGKILL), and waits until it is gone.
    pub fn kill(&mut self) {
        // It may have ended by itself already; then there is nothing to kill.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// Asks it to leave (SIGTERM).
    pub fn terminate(&self) {
        signal("TERM", self.child.id());
    }

    /// Stops it where it is, as a closed lid does (SIGSTOP). Its children go on.
    pub fn stop(&self) {
        signal("STOP", self.child.id());
    }

    /// Lets it go on (SIGCONT).
    pub fn resume(&self) {
        signal("CONT", self.child.id());
    }

    /// Its child processes that still run, by their ids: the compute slots of a worker.
    #[cfg(target_os = "linux")]
    pub fn children(&self) -> Vec<u32> {
        let all = fs::read_dir("/proc").expect("Linux shows its processes").flatten();
        let ids = all.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
        ids.filter(|&id| parent(id).is_some_and(|parent| parent == self.child.id())).collect()
    }

    /// Waits until it has ended by itself, and tells its exit code.
    pub fn exit_code(&mut self) -> Option<i32> {
        let what = format!("the end of {}", self.name);
        wait_for(&what, || self.ended()).code()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.kill();
        if std::thread::panicking() {
            // The harness shows this beside the failure; log files go with their folder.
            eprintln!("---- {} said:\n{}", self.name, tail(&self.said()));
        }
    }
}

/// Parent of a process; none once it has ended.
#[cfg(target_os = "linux")]
fn parent(id: u32) -> Option<u32> {
    let stat = fs::read_to_string(format!("/proc/{id}/stat")).ok()?;
    // The name before these fields is in parentheses and may contain anything.
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace();
    let state = fields.next()?.chars().next()?;
    let parent = fields.next()?.parse().ok()?;
    // One which has ended may wait for someone to ask how.
    (state != 'Z').then_some(parent)
}

/// Whether a process still runs.
#[cfg(target_os = "linux")]
pub fn runs(id: u32) -> bool {
    parent(id).is_some()
}

/// Kills a process which is not a child of this one (SIGKILL).
#[cfg(target_os = "linux")]
pub fn kill(id: u32) {
    signal("KILL", id);
}

/// Sends a process a signal.
fn signal(name: &str, id: u32) {
    // The standard library can only kill; the tool of that name can do the rest.
    let sent = Command::new("kill").args([format!("-{name}"), id.to_string()]).status();
    assert!(sent.is_ok_and(|status| status.success()), "process {id} cannot be sent SIG{name}");
}

/// The last lines of a log, enough to see what went wrong.
fn tail(text: &str) -> String {
    let lines: Vec<_> = text.lines().collect();
    lines[lines.len().saturating_sub(40)..].join("\n")
}
