//! Log lines on standard error. Nothing waits for them: a line that cannot be written is dropped.

use std::io::{self, IsTerminal, Write};
use std::iter;
use std::sync::OnceLock;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::MakeWriter;

use crate::args::{Cli, Command, LogFormat};
use crate::output;

/// Most lines that wait to be written; further ones are dropped.
const MOST_WAITING: usize = 4096;
/// Time between two writes.
const BETWEEN: Duration = Duration::from_millis(5);
/// How long the last lines are waited for.
const PATIENCE: Duration = Duration::from_secs(1);

static LINES: OnceLock<Lines> = OnceLock::new();

/// Starts logging: `MANDUCA_LOG`, then `RUST_LOG`, then `-v`/`-q` decide what is seen.
pub fn start(cli: &Cli) {
    let by_variable = ["MANDUCA_LOG", "RUST_LOG"]
        .into_iter()
        .filter(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()))
        .find_map(|name| EnvFilter::try_from_env(name).ok());
    let filter = by_variable.unwrap_or_else(|| EnvFilter::new(level(cli)));
    let lines = LINES.get_or_init(Lines::start).clone();
    // The library would tell of lines it cannot write, on the very stream, and panic when that fails.
    let builder = tracing_subscriber::fmt().with_env_filter(filter).with_writer(lines).log_internal_errors(false);
    let builder = builder.with_ansi(io::stderr().is_terminal()).with_target(false);
    match cli.log_format {
        LogFormat::Text => builder.init(),
        LogFormat::Json => {
            output::speak_json();
            builder.json().flatten_event(true).with_current_span(false).with_span_list(false).init();
            std::panic::set_hook(Box::new(|panic| output::complain(panic)));
        }
    }
}

/// Waits a while until the lines so far are written.
pub fn finish() {
    let Some(lines) = LINES.get() else { return };
    let (done, told) = sync_channel(1);
    if lines.0.try_send(Message::Flush(done)).is_ok() {
        // Where nobody reads, nobody misses them.
        let _ = told.recv_timeout(PATIENCE);
    }
}

/// Services tell what they do; a command which shows its own progress does not.
fn level(cli: &Cli) -> &'static str {
    let quiet = !matches!(cli.command, Command::Serve(_) | Command::Worker(_));
    match (cli.quiet, cli.verbose, quiet) {
        (true, ..) => "error",
        (_, 0, true) => "error",
        (_, 0, false) | (_, 1, true) => "info",
        (_, 1, false) | (_, 2, _) => "info,manduca_server=debug,manduca_worker=debug,manduca=debug",
        _ => "trace",
    }
}

enum Message {
    Line(Vec<u8>),
    Flush(SyncSender<()>),
}

/// The way to the thread that writes. A reader that stops reading stops that thread alone.
#[derive(Clone)]
struct Lines(SyncSender<Message>);

impl Lines {
    fn start() -> Self {
        Self::to(io::stderr())
    }

    fn to(stream: impl Write + Send + 'static) -> Self {
        let (lines, waiting) = sync_channel(MOST_WAITING);
        thread::spawn(move || write(&waiting, stream));
        Self(lines)
    }
}

/// Writes a line at once, and those which follow close behind it together: to be woken for each would cost
/// more than the line.
fn write(waiting: &Receiver<Message>, mut stream: impl Write) {
    let (mut lines, mut flushed, mut last) = (Vec::new(), Vec::new(), None::<Instant>);
    while let Ok(first) = waiting.recv() {
        if let Some(rest) = last.and_then(|last| BETWEEN.checked_sub(last.elapsed())) {
            thread::sleep(rest);
        }
        for message in iter::once(first).chain(waiting.try_iter().take(MOST_WAITING)) {
            match message {
                Message::Line(line) => lines.extend(line),
                Message::Flush(done) => flushed.push(done),
            }
        }
        // A closed pipe or a full disk: the lines are lost, and nothing else.
        let _ = stream.write_all(&lines);
        lines.clear();
        for done in flushed.drain(..) {
            let _ = done.try_send(());
        }
        last = Some(Instant::now());
    }
}

impl Write for &Lines {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        let _ = self.0.try_send(Message::Line(line.to_vec()));
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl<'a> MakeWriter<'a> for Lines {
    type Writer = &'a Self;

    fn make_writer(&'a self) -> &'a Self {
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Takes nothing: no line, or not even the time of day.
    struct Nobody(bool);

    impl Write for Nobody {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            if self.0 {
                thread::park();
            }
            Err(io::ErrorKind::BrokenPipe.into())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_line_nobody_takes_costs_nothing() {
        for blocks in [false, true] {
            let lines = Lines::to(Nobody(blocks));
            for _ in 0..3 * MOST_WAITING {
                (&lines).write_all(b"a line\n").unwrap();
            }
        }
    }
}
