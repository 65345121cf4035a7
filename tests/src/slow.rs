//! Clients which say their requests a byte at a time, or never read what they asked for.

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::Duration;

/// Between two bytes.
const PAUSE: Duration = Duration::from_millis(500);
/// Requests a client sends which reads no answer: more answers than its system keeps for it.
const UNREAD: usize = 200;

/// In what a client is slow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slow {
    /// It never ends its headers.
    Head,
    /// It never ends its body.
    Body,
    /// It asks again and again, and reads nothing.
    Reading,
}

impl Slow {
    /// All there are.
    pub const ALL: [Self; 3] = [Self::Head, Self::Body, Self::Reading];

    fn begin(self) -> String {
        match self {
            Self::Head => "GET /healthz HTTP/1.1\r\nhost: localhost\r\nx-slow: ".into(),
            Self::Body => "POST /v1/studies HTTP/1.1\r\nhost: localhost\r\ncontent-type: application/json\r\n\
                           content-length: 1000000\r\n\r\n{"
                .into(),
            Self::Reading => "GET /openapi.json HTTP/1.1\r\nhost: localhost\r\n\r\n".repeat(UNREAD),
        }
    }
}

/// Slow clients at work.
#[derive(Debug)]
pub struct SlowClients {
    open: Arc<AtomicUsize>,
    heard: Arc<Mutex<Vec<String>>>,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl SlowClients {
    /// So many of each kind, of the coordinator at this address.
    pub fn start(address: &str, each: usize) -> Self {
        let mut clients = Vec::new();
        for kind in Slow::ALL {
            for _ in 0..each {
                let mut stream = TcpStream::connect(address).expect("connects");
                stream.write_all(kind.begin().as_bytes()).expect("the system takes it");
                stream.set_nonblocking(true).expect("is possible");
                clients.push((kind, stream));
            }
        }
        let (open, heard) = (Arc::new(AtomicUsize::new(clients.len())), Arc::new(Mutex::new(Vec::new())));
        let stop = Arc::new(AtomicBool::new(false));
        let shared = (open.clone(), heard.clone(), stop.clone());
        let thread = spawn(move || {
            let (open, heard, stop) = shared;
            while !stop.load(Ordering::Relaxed) {
                sleep(PAUSE);
                clients.retain_mut(|(kind, stream)| goes_on(*kind, stream, &heard));
                open.store(clients.len(), Ordering::Relaxed);
            }
        });
        Self { open, heard, stop, thread }
    }

    /// How many are still connected.
    pub fn open(&self) -> usize {
        self.open.load(Ordering::Relaxed)
    }

    /// Ends them; gives the first line of each answer which was read.
    pub fn end(self) -> Vec<String> {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().expect("no client panics");
        std::mem::take(&mut *self.heard.lock().expect("no client panics"))
    }
}

/// Sends one more byte; false once the other end has let go.
fn goes_on(kind: Slow, stream: &mut TcpStream, heard: &Mutex<Vec<String>>) -> bool {
    if kind != Slow::Reading {
        let mut answer = [0; 4096];
        match stream.read(&mut answer) {
            Ok(0) => return false,
            Ok(n) => {
                let answer = String::from_utf8_lossy(&answer[..n]);
                heard.lock().expect("no client panics").extend(answer.lines().next().map(str::to_owned));
                return false;
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            Err(_) => return false,
        }
    }
    let sent = stream.write_all(b"a");
    sent.is_ok() || sent.is_err_and(|error| error.kind() == ErrorKind::WouldBlock)
}
