//! The parent's side.

use std::ffi::OsStr;
use std::io;
use std::path::PathBuf;
use std::process::{ExitStatus, Stdio};
use std::time::{Duration, Instant};

use manduca_protocol::task::{JobResult, Provenance, Task};
use manduca_protocol::worker::Fault;
use tokio::io::{AsyncBufReadExt, AsyncWriteExt, BufReader, Lines};
use tokio::process::{Child, ChildStdin, ChildStdout, Command};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use tracing::error;

use super::stderr::LastWords;
use super::{Message, News};

/// A program which cannot be started must not burn every attempt of every job within a second.
const AFTER_A_FAILED_START: Duration = Duration::from_secs(1);
/// How long a slot waits for what the machine is short of, such as handles of files or room for processes.
const SHORTAGE: Duration = Duration::from_secs(60);

/// How a task ended.
#[derive(Debug)]
pub enum Outcome {
    /// With a result.
    Done(Box<JobResult>, Provenance),
    /// Without one, and what is to blame.
    Failed(String, Fault),
    /// Its lease was taken away; no one waits for an answer.
    Cancelled,
}

/// A compute slot: at most one child process, started when first needed.
#[derive(Debug)]
pub struct Slot {
    program: PathBuf,
    arguments: Vec<String>,
    process: Option<Process>,
}

#[derive(Debug)]
struct Process {
    child: Child,
    stdin: ChildStdin,
    stdout: Lines<BufReader<ChildStdout>>,
    last_words: LastWords,
}

impl Slot {
    /// A slot whose child is `program arguments...`.
    pub fn new(program: PathBuf, arguments: Vec<String>) -> Self {
        Self { program, arguments, process: None }
    }

    /// Computes a task: to its end, to its run limit, or until told to stop.
    pub async fn run(
        &mut self,
        task: &Task,
        limit: Duration,
        news: &watch::Sender<News>,
        stop: &CancellationToken,
    ) -> Outcome {
        if let Err(outcome) = self.start_patiently(stop).await {
            return outcome;
        }
        tokio::select! {
            biased;
            () = stop.cancelled() => {
                self.kill().await;
                Outcome::Cancelled
            }
            () = tokio::time::sleep(limit) => {
                self.kill().await;
                // As a rule the job is too long for any machine.
                Outcome::Failed(format!("exceeded its run limit of {} s", limit.as_secs_f64()), Fault::Failed)
            }
            answer = self.converse(task, news) => match answer {
                Ok(outcome) => outcome,
                // A task too large for the memory ends its process too: should it be the machine, others will tell.
                Err(trouble) => Outcome::Failed(self.bury(trouble).await, Fault::Failed),
            }
        }
    }

    /// Starts the child where there is none. What the machine is short of is waited for: it is no
    /// job's fault, and may be there again when another job has ended.
    async fn start_patiently(&mut self, stop: &CancellationToken) -> Result<(), Outcome> {
        let begun = Instant::now();
        let mut told = false;
        loop {
            let Err(error) = self.ensure_started() else { return Ok(()) };
            let is_short = is_shortage(&error);
            if is_short && !told {
                error!(%error, "a compute slot cannot be started; fewer slots or higher limits of the system would help");
                told = true;
            }
            tokio::select! {
                () = stop.cancelled() => return Err(Outcome::Cancelled),
                () = tokio::time::sleep(AFTER_A_FAILED_START) => {}
            }
            if !is_short || begun.elapsed() >= SHORTAGE {
                let reason = format!("cannot start {}: {error}", self.program.display());
                return Err(Outcome::Failed(reason, Fault::Machine));
            }
        }
    }

    /// A child may have died while it was idle; that is no job's fault.
    fn ensure_started(&mut self) -> io::Result<()> {
        if let Some(process) = &mut self.process
            && process.child.try_wait()?.is_none()
        {
            process.last_words.clear();
            return Ok(());
        }
        self.process = None;
        let mut command = Command::new(&self.program);
        command.args(&self.arguments).kill_on_drop(true);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        #[cfg(unix)]
        command.arg0("manduca");
        // It only computes: what it does not have it cannot give away.
        for (name, _) in std::env::vars_os().filter(|(name, _)| is_secret(name)) {
            command.env_remove(name);
        }
        let mut child = command.spawn()?;
        let (Some(stdin), Some(stdout), Some(stderr)) = (child.stdin.take(), child.stdout.take(), child.stderr.take())
        else {
            return Err(io::Error::other("no pipes to the slot"));
        };
        let stdout = BufReader::new(stdout).lines();
        self.process = Some(Process { child, stdin, stdout, last_words: LastWords::of(stderr) });
        Ok(())
    }

    async fn converse(&mut self, task: &Task, news: &watch::Sender<News>) -> io::Result<Outcome> {
        let Some(process) = &mut self.process else { return Err(io::Error::other("not started")) };
        let mut line = serde_json::to_vec(task)?;
        line.push(b'\n');
        process.stdin.write_all(&line).await?;
        process.stdin.flush().await?;
        while let Some(line) = process.stdout.next_line().await? {
            match serde_json::from_str(&line)? {
                Message::Progress(at) => news.send_modify(|news| news.progress = Some(at)),
                Message::Checkpoint { at } => news.send_modify(|news| news.checkpoint = Some(at)),
                Message::Done { result, provenance } => return Ok(Outcome::Done(Box::new(result), provenance)),
                Message::Failed { reason, fault } => return Ok(Outcome::Failed(reason, fault)),
            }
        }
        Err(io::ErrorKind::UnexpectedEof.into())
    }

    /// Ends the child for good.
    async fn kill(&mut self) {
        if let Some(mut process) = self.process.take() {
            // It may have ended by itself in this very moment: gone is gone.
            let _ = process.child.kill().await;
        }
    }

    /// Ends a child which broke off the conversation, and says why it did.
    async fn bury(&mut self, trouble: io::Error) -> String {
        let Some(mut process) = self.process.take() else { return trouble.to_string() };
        // One which only talks nonsense is still alive and has to be killed;
        // one which hung up is about to end by itself, and how is worth knowing.
        let wait = if trouble.kind() == io::ErrorKind::InvalidData { Duration::ZERO } else { Duration::from_secs(1) };
        let ended = match tokio::time::timeout(wait, process.child.wait()).await {
            Ok(Ok(status)) => describe(status),
            _ => {
                let _ = process.child.kill().await;
                format!("the slot broke off: {trouble}")
            }
        };
        match process.last_words.take().await {
            words if words.is_empty() => ended,
            words => format!("{ended}; it said: {words}"),
        }
    }
}

/// Whether a program cannot be started for want of file handles, processes or memory.
fn is_shortage(error: &io::Error) -> bool {
    // ENFILE and EMFILE have no kind of their own.
    let is_out_of_files = cfg!(unix) && matches!(error.raw_os_error(), Some(23 | 24));
    is_out_of_files || matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::OutOfMemory)
}

/// Whether a variable holds a token, or says where one is.
fn is_secret(variable: &OsStr) -> bool {
    variable.as_encoded_bytes().starts_with(b"MANDUCA_TOKEN")
}

fn describe(status: ExitStatus) -> String {
    #[cfg(unix)]
    if let Some(signal) = std::os::unix::process::ExitStatusExt::signal(&status) {
        let hint = if signal == 9 { " (killed, perhaps for lack of memory)" } else { "" };
        return format!("the slot ended by signal {signal}{hint}");
    }
    format!("the slot ended with {status}")
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use super::*;

    fn script(text: &str) -> Slot {
        Slot::new("/bin/sh".into(), vec!["-c".into(), text.into()])
    }

    fn task() -> Task {
        serde_json::from_str(
            r#"{"kind":"train","surrogate":{},"seed":1,"bounds":{"lower":[0,0,0,0,0,0,0,0,0,0],
                "upper":[1,1,1,1,1,1,1,1,1,1]},"dataset":[]}"#,
        )
        .unwrap()
    }

    async fn run(slot: &mut Slot, limit: Duration) -> (String, Option<manduca_protocol::task::Progress>) {
        let (progress, at) = watch::channel(News::default());
        let outcome = slot.run(&task(), limit, &progress, &CancellationToken::new()).await;
        let at = at.borrow().progress.clone();
        match outcome {
            Outcome::Failed(reason, _) => (reason, at),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn tokens_are_secret() {
        assert!(["MANDUCA_TOKEN", "MANDUCA_TOKEN_FILE"].iter().all(|name| is_secret(name.as_ref())));
        assert!(!is_secret("MANDUCA_SLOTS".as_ref()));
    }

    #[tokio::test]
    async fn a_crash_is_a_failure_with_its_last_words_and_the_next_job_runs() {
        let mut slot = script("read task; echo 'out of vortices' >&2; kill -ABRT $$");
        for _ in 0..2 {
            let (reason, _) = run(&mut slot, Duration::from_secs(10)).await;
            assert!(reason.contains("signal 6") && reason.contains("out of vortices"), "{reason}");
        }
    }

    #[tokio::test]
    async fn one_child_serves_many_jobs_and_reports_progress() {
        let mut slot = script(
            r#"while read task; do n=$((n+1)); echo '{"message":"progress","done":1,"total":2,"note":"half"}'
               echo "{\"message\":\"failed\",\"reason\":\"job $n of $$\"}"; done"#,
        );
        let (first, at) = run(&mut slot, Duration::from_secs(10)).await;
        assert_eq!(at.unwrap().note, "half");
        let (second, _) = run(&mut slot, Duration::from_secs(10)).await;
        assert_eq!(first.replace("job 1", "job 2"), second);
    }

    #[tokio::test]
    async fn nonsense_and_overrun_end_the_child() {
        let (reason, _) = run(&mut script("read task; echo hello; exec sleep 60"), Duration::from_secs(10)).await;
        assert!(reason.contains("broke off"), "{reason}");
        let start = Instant::now();
        let (reason, _) = run(&mut script("exec sleep 60"), Duration::from_millis(100)).await;
        assert!(reason.contains("run limit"), "{reason}");
        assert!(start.elapsed() < Duration::from_secs(10));
    }

    #[test]
    fn what_a_machine_is_short_of_is_no_fault_of_the_program() {
        for code in [23, 24] {
            assert!(is_shortage(&io::Error::from_raw_os_error(code)), "{code}");
        }
        assert!(is_shortage(&io::ErrorKind::WouldBlock.into()) && !is_shortage(&io::ErrorKind::NotFound.into()));
    }

    #[tokio::test]
    async fn a_program_which_is_not_there_is_a_failure() {
        let mut slot = Slot::new("/no/such/program".into(), vec![]);
        let (reason, _) = run(&mut slot, Duration::from_secs(10)).await;
        assert!(reason.contains("cannot start /no/such/program"), "{reason}");
    }
}
