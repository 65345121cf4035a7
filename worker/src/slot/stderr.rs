//! What a child said last on standard error: the only witness of an abort.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use tokio::io::{AsyncRead, AsyncReadExt};
use tokio::task::JoinHandle;

const LINES: usize = 8;
const LINE: usize = 400;

/// The last lines of a stream, kept while it is read to its end.
#[derive(Debug)]
pub(super) struct LastWords {
    lines: Arc<Mutex<VecDeque<String>>>,
    reader: JoinHandle<()>,
}

impl LastWords {
    /// Starts to listen.
    pub(super) fn of(stream: impl AsyncRead + Send + Unpin + 'static) -> Self {
        let lines = Arc::new(Mutex::new(VecDeque::new()));
        let reader = tokio::spawn(listen(stream, Arc::clone(&lines)));
        Self { lines, reader }
    }

    /// Forgets what was said about an earlier job.
    pub(super) fn clear(&self) {
        self.lines.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// What was said, once the stream has ended; a grandchild may keep it open, so the wait is short.
    pub(super) async fn take(mut self) -> String {
        let wait = std::time::Duration::from_millis(500);
        // Either way what was heard so far is what counts.
        let _ = tokio::time::timeout(wait, &mut self.reader).await;
        let mut lines = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        lines.drain(..).collect::<Vec<_>>().join(" | ")
    }
}

impl Drop for LastWords {
    fn drop(&mut self) {
        self.reader.abort();
    }
}

/// Reads bytes, not lines: a child gone wild may write a line without an end.
async fn listen(mut stream: impl AsyncRead + Unpin, lines: Arc<Mutex<VecDeque<String>>>) {
    let mut buffer = [0; 4096];
    let mut line = Vec::new();
    while let Ok(n @ 1..) = stream.read(&mut buffer).await {
        for &byte in &buffer[..n] {
            if byte == b'\n' {
                keep(&mut line, &lines);
            } else if line.len() < LINE {
                line.push(byte);
            }
        }
    }
    keep(&mut line, &lines);
}

fn keep(line: &mut Vec<u8>, lines: &Mutex<VecDeque<String>>) {
    let text = String::from_utf8_lossy(line).trim().to_owned();
    line.clear();
    if text.is_empty() {
        return;
    }
    let mut lines = lines.lock().unwrap_or_else(PoisonError::into_inner);
    if lines.len() == LINES {
        lines.pop_front();
    }
    lines.push_back(text);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn only_the_end_is_kept() {
        let text: String = (0..50).map(|i| format!("line {i}\n")).collect();
        let words = LastWords::of(std::io::Cursor::new(text + &"x".repeat(10_000)));
        let said = words.take().await;
        assert!(said.starts_with("line 43 | ") && said.ends_with("xxx"), "{said}");
        assert!(said.len() < 600);
    }
}
