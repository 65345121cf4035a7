//! The child's side.

use std::any::Any;
use std::io::{self, BufRead, Write};
use std::panic::{self, AssertUnwindSafe};
use std::process::ExitCode;
use std::sync::mpsc::{self, Receiver};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use manduca_numerics::simulation;
use manduca_protocol::task::{Checkpoint, Progress, Provenance, Task};
use manduca_protocol::worker::Fault;

use super::Message;
use crate::compute::{self, Listener};

/// Progress more often than this is of use to no one.
const BETWEEN_PROGRESS: Duration = Duration::from_millis(500);

/// Work between two checkpoints which may have to be done again.
const BETWEEN_CHECKPOINTS: Duration = Duration::from_secs(2);

/// Where and why the last panic was: the payload alone does not say where.
static LAST_PANIC: Mutex<Option<String>> = Mutex::new(None);

/// The whole life of a compute slot. Returns when the parent can no longer be
/// written to; the usual end is that of standard input.
pub fn slot_main() -> ExitCode {
    // Nothing else holds the runtime, and dropping it would stop the handlers.
    let _signals = ignore_signals();
    panic::set_hook(Box::new(|info| {
        *LAST_PANIC.lock().unwrap_or_else(PoisonError::into_inner) = Some(info.to_string());
    }));
    let mut stdout = io::stdout().lock();
    for line in tasks() {
        let mut written = Ok(());
        answer(&line, &mut |message| {
            if written.is_ok() {
                written = write(&mut stdout, message);
            }
        });
        if written.is_err() {
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}

/// Lines of standard input. When it ends the parent is gone, perhaps killed, and
/// no one wants what is being computed: the process ends at once.
fn tasks() -> Receiver<String> {
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || {
        for line in io::stdin().lock().lines() {
            let Ok(line) = line else { break };
            if sender.send(line).is_err() {
                break;
            }
        }
        std::process::exit(0);
    });
    receiver
}

fn write(out: &mut impl Write, message: &Message) -> io::Result<()> {
    let mut line = serde_json::to_vec(message)?;
    line.push(b'\n');
    out.write_all(&line)?;
    out.flush()
}

/// Tells the parent now and then.
struct Teller<'a> {
    say: &'a mut dyn FnMut(&Message),
    /// When each was last told.
    progress: Instant,
    checkpoint: Instant,
}

impl Listener for Teller<'_> {
    fn progress(&mut self, at: Progress) {
        if self.progress.elapsed() >= BETWEEN_PROGRESS {
            self.progress = Instant::now();
            (self.say)(&Message::Progress(at));
        }
    }

    fn checkpoint(&mut self, make: &dyn Fn() -> Checkpoint) {
        if self.checkpoint.elapsed() >= BETWEEN_CHECKPOINTS {
            (self.say)(&Message::Checkpoint { at: make() });
            self.checkpoint = Instant::now();
        }
    }
}

/// Computes one task and says what there is to say about it.
fn answer(line: &str, say: &mut dyn FnMut(&Message)) {
    let task: Task = match serde_json::from_str(line) {
        Ok(task) => task,
        Err(e) => {
            let reason = format!("the slot cannot read its task: {e}");
            return say(&Message::Failed { reason, fault: Fault::Machine });
        }
    };
    let start = Instant::now();
    let mut teller = Teller { say: &mut *say, progress: start, checkpoint: start };
    // A task is pure: whatever a panic leaves half done is dropped with it.
    let computed = panic::catch_unwind(AssertUnwindSafe(|| compute::run(&task, &mut teller)));
    say(&match computed {
        Ok(Ok(result)) => {
            let provenance = Provenance { wall_s: start.elapsed().as_secs_f64(), level: simulation::level().into() };
            Message::Done { result, provenance }
        }
        Ok(Err(error)) => Message::Failed { reason: error.to_string(), fault: error.fault() },
        Err(payload) => Message::Failed { reason: panic_reason(payload.as_ref()), fault: Fault::Failed },
    });
}

fn panic_reason(payload: &(dyn Any + Send)) -> String {
    let noted = LAST_PANIC.lock().unwrap_or_else(PoisonError::into_inner).take();
    noted.unwrap_or_else(|| {
        let text = payload.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| payload.downcast_ref::<&str>().copied());
        format!("panicked: {}", text.unwrap_or("without a word"))
    })
}

/// Ctrl-C in a terminal and systemd's SIGTERM reach every process of the group.
/// Only the worker may act on them: it lets its slots finish. A handler once
/// registered replaces the default action for the life of the process.
#[cfg(unix)]
fn ignore_signals() -> Option<tokio::runtime::Runtime> {
    use tokio::signal::unix::{SignalKind, signal};
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build().ok()?;
    let guard = runtime.enter();
    for kind in [SignalKind::interrupt(), SignalKind::terminate(), SignalKind::hangup()] {
        drop(signal(kind));
    }
    drop(guard);
    Some(runtime)
}

#[cfg(not(unix))]
fn ignore_signals() {}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(line: &str) -> Vec<Message> {
        let mut all = Vec::new();
        answer(line, &mut |message| all.push(message.clone()));
        all
    }

    #[test]
    fn a_task_it_cannot_read_is_a_failure_not_an_end() {
        let all = said("{\"kind\":\"dance\"}");
        assert!(
            matches!(&all[..], [Message::Failed { reason, fault: Fault::Machine }] if reason.contains("cannot read")),
            "{all:?}"
        );
    }

    #[test]
    fn a_task_which_makes_no_sense_is_refused_by_field() {
        let all = said(
            r#"{"kind":"simulate","model":{"insect":"dragon"},"parameters":{
            "frequency_hz":26,"stroke_plane_deg":15,"sweep_mean_deg":0,"elevation_mean_deg":0,"rotation_mean_deg":0,
            "sweep_amplitude_deg":60,"elevation_amplitude_deg":0,"rotation_amplitude_deg":60,"sweep_shape":0,
            "rotation_shape":1}}"#,
        );
        let [Message::Failed { reason, fault }] = &all[..] else { panic!("{all:?}") };
        assert!(reason.contains("/model/insect") && *fault == Fault::Refused, "{all:?}");
    }

    #[test]
    fn messages_survive_the_pipe() {
        let progress = Progress { done: 3, total: 9, note: "a \"quoted\"\nnote".into() };
        let message = Message::Progress(progress);
        let mut bytes = Vec::new();
        write(&mut bytes, &message).unwrap();
        assert_eq!(bytes.iter().filter(|&&b| b == b'\n').count(), 1);
        assert_eq!(serde_json::from_slice::<Message>(&bytes).unwrap(), message);
    }

    #[test]
    fn a_panic_says_what_it_is() {
        *LAST_PANIC.lock().unwrap() = None;
        assert_eq!(panic_reason(&"index 9"), "panicked: index 9");
    }
}
