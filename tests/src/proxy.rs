//! A network between workers and a coordinator which loses, repeats and delays, can be cut, and can
//! answer in the coordinator's place.
//!
//! It passes on one request per connection, as a whole, so that what it does to a connection it does
//! to a call.

use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use crate::chance::Chance;

/// How long one side may say nothing; longer than any answer is waited for.
const SILENCE: Duration = Duration::from_secs(120);
/// How often a cut line is looked at.
const GLANCE: Duration = Duration::from_millis(20);
/// Largest head of a request, bytes.
const LARGEST_HEAD: usize = 64 << 10;

/// What happens to how many of a hundred calls.
#[derive(Debug, Clone, Copy)]
pub struct Weather {
    /// Answered by the coordinator, and the answer lost.
    pub lost: u64,
    /// Sent to the coordinator twice at once.
    pub repeated: u64,
    /// Late on their way there or back.
    pub delayed: u64,
    /// How late at most.
    pub delay: Duration,
}

impl Weather {
    /// Nothing happens by itself.
    pub const CALM: Self = Self { lost: 0, repeated: 0, delayed: 0, delay: Duration::ZERO };
}

/// Answers of proxies, portals and other services, each with a name for it.
pub fn strangers() -> Vec<(&'static str, Vec<u8>)> {
    let page = |status: &str, more: &str, of: &str, body: &str| {
        let length = body.len();
        format!("HTTP/1.1 {status}\r\n{more}content-type: {of}\r\ncontent-length: {length}\r\nconnection: close\r\n\r\n{body}")
            .into_bytes()
    };
    let html = |status: &str, more: &str| page(status, more, "text/html", &format!("<h1>{status}</h1>"));
    let theirs = r#"{"type":"about:blank","title":"Not Found","status":404,"detail":"no such upstream"}"#;
    let mut cut = page("200 OK", "", "application/json", r#"{"accepted":[1,2,3],"rejected":[]}"#);
    cut.truncate(cut.len() - 12);
    vec![
        ("404", html("404 Not Found", "")),
        ("401", html("401 Unauthorized", "www-authenticate: Basic realm=\"proxy\"\r\n")),
        ("403", html("403 Forbidden", "")),
        ("410", html("410 Gone", "")),
        ("400", html("400 Bad Request", "")),
        ("422", page("422 Unprocessable Content", "", "application/json", r#"{"detail":[]}"#)),
        ("502", html("502 Bad Gateway", "")),
        ("302", html("302 Found", "location: http://127.0.0.1:9/login\r\n")),
        ("a page", html("200 OK", "")),
        ("JSON of another service", page("200 OK", "", "application/json", r#"{"ok":true}"#)),
        ("a problem of another service", page("404 Not Found", "", "application/problem+json", theirs)),
        ("half an answer", cut),
        ("nothing", Vec::new()),
    ]
}

/// What was done so far.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct Done {
    /// Calls.
    pub calls: u64,
    /// Answers lost.
    pub lost: u64,
    /// Calls repeated.
    pub repeated: u64,
    /// Calls or answers delayed.
    pub delayed: u64,
}

#[derive(Debug)]
struct Line {
    upstream: String,
    weather: Weather,
    chance: Mutex<Chance>,
    cut: AtomicBool,
    /// What is answered in the coordinator's place.
    stranger: Mutex<Option<Vec<u8>>>,
    intercepted: AtomicU64,
    closed: AtomicBool,
    calls: AtomicU64,
    lost: AtomicU64,
    repeated: AtomicU64,
    delayed: AtomicU64,
}

/// The proxy of one coordinator; it listens until it is dropped.
#[derive(Debug)]
pub struct Proxy {
    address: String,
    line: Arc<Line>,
}

impl Proxy {
    /// A proxy of the coordinator at this URL.
    pub fn start(url: &str, seed: u64, weather: Weather) -> Self {
        let upstream = url.trim_start_matches("http://").to_owned();
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("an address").to_string();
        let line = Arc::new(Line {
            upstream,
            weather,
            chance: Mutex::new(Chance::new(seed)),
            cut: AtomicBool::new(false),
            stranger: Mutex::new(None),
            intercepted: AtomicU64::new(0),
            closed: AtomicBool::new(false),
            calls: AtomicU64::new(0),
            lost: AtomicU64::new(0),
            repeated: AtomicU64::new(0),
            delayed: AtomicU64::new(0),
        });
        let shared = line.clone();
        thread::spawn(move || {
            for client in listener.incoming().flatten() {
                if shared.closed.load(Ordering::SeqCst) {
                    return;
                }
                let line = shared.clone();
                // Either side may break off at any time; the other one then sees a closed connection.
                thread::spawn(move || line.pass_on(&client));
            }
        });
        Self { address, line }
    }

    /// Where it listens, as workers are given it.
    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Lets no byte through, in either direction, until it is told otherwise.
    pub fn cut(&self, cut: bool) {
        self.line.cut.store(cut, Ordering::SeqCst);
    }

    /// Answers every call itself, with these bytes, until it is told otherwise. Every other call is passed
    /// on first, and its answer dropped.
    pub fn answer(&self, bytes: Option<Vec<u8>>) {
        *self.line.stranger.lock().expect("no holder panics") = bytes;
    }

    /// Calls which it has answered itself.
    pub fn intercepted(&self) -> u64 {
        self.line.intercepted.load(Ordering::SeqCst)
    }

    /// What it has done.
    pub fn done(&self) -> Done {
        let of = |count: &AtomicU64| count.load(Ordering::SeqCst);
        let line = &self.line;
        Done { calls: of(&line.calls), lost: of(&line.lost), repeated: of(&line.repeated), delayed: of(&line.delayed) }
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        self.line.closed.store(true, Ordering::SeqCst);
        self.cut(false);
        // Wakes the listener, which then sees that it is closed.
        let _ = TcpStream::connect(&self.address);
    }
}

/// What happens to one call.
struct Fate {
    lost: bool,
    repeated: bool,
    before: Duration,
    after: Duration,
}

impl Line {
    fn fate(&self) -> Fate {
        let mut chance = self.chance.lock().expect("no holder panics");
        let Weather { lost, repeated, delayed, delay } = self.weather;
        let (lost, repeated, delayed) =
            (chance.in_hundred(lost), chance.in_hundred(repeated), chance.in_hundred(delayed));
        let late = delay.mul_f64(if delayed { (chance.next() >> 11) as f64 / (1_u64 << 53) as f64 } else { 0.0 });
        let (before, after) = if chance.in_hundred(50) { (late, Duration::ZERO) } else { (Duration::ZERO, late) };
        drop(chance);
        let all = [(&self.calls, true), (&self.lost, lost), (&self.repeated, repeated), (&self.delayed, delayed)];
        for (count, happens) in all {
            count.fetch_add(u64::from(happens), Ordering::SeqCst);
        }
        Fate { lost, repeated, before, after }
    }

    fn wait_while_cut(&self) {
        while self.cut.load(Ordering::SeqCst) {
            thread::sleep(GLANCE);
        }
    }

    fn pass_on(&self, mut client: &TcpStream) -> io::Result<()> {
        let request = read_request(client)?;
        let fate = self.fate();
        thread::sleep(fate.before);
        self.wait_while_cut();
        if fate.repeated {
            let (upstream, copy) = (self.upstream.clone(), request.clone());
            // Nobody is told what the copy is answered.
            thread::spawn(move || answer(&upstream, &copy));
        }
        let stranger = self.stranger.lock().expect("no holder panics").clone();
        if let Some(bytes) = stranger {
            if self.intercepted.fetch_add(1, Ordering::SeqCst) % 2 == 1 && !waits(&request) {
                answer(&self.upstream, &request)?;
            }
            return client.write_all(&bytes);
        }
        let answer = answer(&self.upstream, &request)?;
        thread::sleep(fate.after);
        self.wait_while_cut();
        if fate.lost { Ok(()) } else { client.write_all(&answer) }
    }
}

/// Whether a request asks for work and may be held: its answer might bring jobs which nobody hears of.
fn waits(request: &[u8]) -> bool {
    !String::from_utf8_lossy(request).contains("\"wait_s\":0.0")
}

/// What the coordinator says, to the last byte.
fn answer(upstream: &str, request: &[u8]) -> io::Result<Vec<u8>> {
    let mut stream = TcpStream::connect(upstream)?;
    stream.set_read_timeout(Some(SILENCE))?;
    stream.write_all(request)?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer)?;
    Ok(answer)
}

/// A whole request, which asks for the connection to be closed after it.
fn read_request(mut client: &TcpStream) -> io::Result<Vec<u8>> {
    client.set_read_timeout(Some(SILENCE))?;
    let (mut bytes, mut block) = (Vec::new(), [0; 16 << 10]);
    let mut more = |bytes: &mut Vec<u8>| -> io::Result<()> {
        match client.read(&mut block)? {
            0 => Err(io::ErrorKind::UnexpectedEof.into()),
            n => {
                bytes.extend_from_slice(&block[..n]);
                Ok(())
            }
        }
    };
    let end = loop {
        if let Some(at) = bytes.windows(4).position(|four| four == b"\r\n\r\n") {
            break at;
        }
        assert!(bytes.len() < LARGEST_HEAD, "a head without an end");
        more(&mut bytes)?;
    };
    let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let is = |line: &str, name: &str| line.to_ascii_lowercase().starts_with(name);
    let length = head.lines().find(|line| is(line, "content-length:")).and_then(|line| line[15..].trim().parse().ok());
    let length: usize = length.unwrap_or(0);
    while bytes.len() < end + 4 + length {
        more(&mut bytes)?;
    }
    let kept: Vec<_> = head.lines().filter(|line| !is(line, "connection:")).collect();
    let mut request = format!("{}\r\nconnection: close\r\n\r\n", kept.join("\r\n")).into_bytes();
    request.extend_from_slice(&bytes[end + 4..end + 4 + length]);
    Ok(request)
}
