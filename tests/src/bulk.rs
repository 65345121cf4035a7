//! Requests with bodies too large for a client which copies them.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// How long an answer is waited for.
const PATIENCE: Duration = Duration::from_secs(120);

/// A request whose body is sent as it is, by as many clients as want.
#[derive(Debug, Clone)]
pub struct Bulk {
    /// What it is, for people.
    pub what: String,
    /// Where it goes.
    pub path: String,
    /// What its body is declared as.
    pub media_type: &'static str,
    /// Its body.
    pub body: Vec<u8>,
}

impl Bulk {
    /// One of JSON.
    pub fn json(what: impl Into<String>, path: &str, body: impl Into<Vec<u8>>) -> Self {
        Self { what: what.into(), path: path.into(), media_type: "application/json", body: body.into() }
    }

    /// One of TOML.
    pub fn toml(what: impl Into<String>, path: &str, body: impl Into<Vec<u8>>) -> Self {
        Self { media_type: "application/toml", ..Self::json(what, path, body) }
    }

    /// Sends it; gives the status and the body of the answer.
    ///
    /// # Panics
    /// When nobody answers.
    pub fn send(&self, address: &str) -> (u16, String) {
        let mut stream = TcpStream::connect(address).expect("connects");
        stream.set_read_timeout(Some(PATIENCE)).expect("is possible");
        stream.set_write_timeout(Some(PATIENCE)).expect("is possible");
        let Self { path, media_type, body, .. } = self;
        let head = format!(
            "POST {path} HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\ncontent-type: {media_type}\r\n\
             content-length: {}\r\n\r\n",
            body.len()
        );
        stream.write_all(head.as_bytes()).expect("the head is taken");
        // One which is refused before it has come is answered all the same.
        let _ = stream.write_all(body);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let answer = String::from_utf8_lossy(&answer);
        let status = answer.split(' ').nth(1).and_then(|status| status.parse().ok());
        let text = answer.split_once("\r\n\r\n").map_or("", |(_, text)| text);
        (status.unwrap_or_else(|| panic!("no answer to {}", self.what)), text.to_owned())
    }
}

/// A client which keeps its connection, and little else: there may be a thousand.
#[derive(Debug)]
pub struct Kept {
    address: String,
    stream: Option<BufReader<TcpStream>>,
}

impl Kept {
    /// A client of the coordinator at this address.
    pub fn new(address: &str) -> Self {
        Self { address: address.to_owned(), stream: None }
    }

    /// GET; gives the status, or none where the connection failed.
    pub fn get(&mut self, path: &str) -> Option<u16> {
        let request = format!("GET {path} HTTP/1.1\r\nhost: {}\r\n\r\n", self.address);
        self.ask(request.as_bytes()).map(|(status, _)| status)
    }

    /// POST of JSON; gives status and answer.
    pub fn post(&mut self, path: &str, body: &str) -> Option<(u16, Vec<u8>)> {
        let request = format!(
            "POST {path} HTTP/1.1\r\nhost: {}\r\ncontent-type: application/json\r\ncontent-length: {}\r\n\r\n{body}",
            self.address,
            body.len()
        );
        self.ask(request.as_bytes())
    }

    fn ask(&mut self, request: &[u8]) -> Option<(u16, Vec<u8>)> {
        let answer = self.try_ask(request);
        if answer.is_none() {
            self.stream = None;
        }
        answer
    }

    fn try_ask(&mut self, request: &[u8]) -> Option<(u16, Vec<u8>)> {
        if self.stream.is_none() {
            let stream = TcpStream::connect(&self.address).ok()?;
            stream.set_read_timeout(Some(PATIENCE)).ok()?;
            stream.set_nodelay(true).ok()?;
            self.stream = Some(BufReader::new(stream));
        }
        let stream = self.stream.as_mut()?;
        stream.get_mut().write_all(request).ok()?;
        let (mut line, mut status, mut length) = (String::new(), None, 0);
        loop {
            line.clear();
            if stream.read_line(&mut line).ok()? == 0 {
                return None;
            }
            let told = line.trim_end();
            if told.is_empty() {
                break;
            }
            if status.is_none() {
                status = told.split(' ').nth(1)?.parse().ok();
            } else if let Some((name, value)) = told.split_once(':')
                && name.eq_ignore_ascii_case("content-length")
            {
                length = value.trim().parse().ok()?;
            }
        }
        let mut body = vec![0; length];
        stream.read_exact(&mut body).ok()?;
        Some((status?, body))
    }
}
