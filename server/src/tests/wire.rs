//! Clients which say too much, or too little, on a real socket.

use std::time::Duration;

use tempfile::TempDir;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio_util::sync::CancellationToken;

use crate::{Config, serve};

/// No test measures time; this only ends one which hangs.
const DEADLINE: Duration = Duration::from_secs(60);

struct Served {
    address: std::net::SocketAddr,
    stop: CancellationToken,
    ended: tokio::task::JoinHandle<Result<(), crate::ServerError>>,
    _folder: TempDir,
}

impl Served {
    async fn start(change: impl FnOnce(&mut Config)) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let mut config = Config::new(folder.path().join("manduca.db"));
        change(&mut config);
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let address = listener.local_addr().expect("an address");
        let stop = CancellationToken::new();
        let state =
            crate::open_with_clock(config, std::sync::Arc::new(crate::SystemClock::start())).await.expect("opens");
        let ended = tokio::spawn(serve(listener, state, stop.clone().cancelled_owned()));
        Self { address, stop, ended, _folder: folder }
    }

    async fn connect(&self) -> TcpStream {
        TcpStream::connect(self.address).await.expect("connects")
    }

    /// Sends text, and reads until the server closes the connection.
    async fn converse(&self, text: &str) -> String {
        let mut stream = self.connect().await;
        stream.write_all(text.as_bytes()).await.expect("is taken");
        until_closed(&mut stream).await
    }

    async fn end(self) {
        self.stop.cancel();
        let ended = tokio::time::timeout(DEADLINE, self.ended).await.expect("ends").expect("does not panic");
        ended.expect("ends well");
    }
}

async fn until_closed(stream: &mut TcpStream) -> String {
    let mut answer = Vec::new();
    let read = tokio::time::timeout(DEADLINE, stream.read_to_end(&mut answer)).await.expect("the server lets go");
    // One which is reset has let go too.
    let _ = read;
    String::from_utf8_lossy(&answer).into_owned()
}

#[tokio::test]
async fn a_head_which_never_ends_is_not_waited_for() {
    let served = Served::start(|config| config.header_wait = Duration::from_millis(200)).await;
    let answer = served.converse("GET /healthz HTTP/1.1\r\nhost: localhost\r\nx-slow: ").await;
    assert!(!answer.contains("200 OK"), "{answer}");
    assert!(served.converse("").await.is_empty(), "nor is one which never begins");
    let answer = served.converse("GET /healthz HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n").await;
    assert!(answer.starts_with("HTTP/1.1 200 OK"), "{answer}");
    served.end().await;
}

#[tokio::test]
async fn a_body_which_never_ends_is_not_waited_for() {
    let served = Served::start(|config| config.body_wait = Duration::from_millis(200)).await;
    let mut stream = served.connect().await;
    let head = "POST /v1/studies HTTP/1.1\r\nhost: localhost\r\ncontent-type: application/json\r\ncontent-length: 100\r\n\r\n{";
    stream.write_all(head.as_bytes()).await.expect("is taken");
    let mut answer = [0; 12];
    tokio::time::timeout(DEADLINE, stream.read_exact(&mut answer)).await.expect("is answered").expect("is read");
    assert_eq!(&answer, b"HTTP/1.1 408");
    served.end().await;
}

#[tokio::test]
async fn one_who_does_not_read_is_let_go() {
    let served = Served::start(|config| {
        config.write_wait = Duration::from_millis(200);
        config.connections = 1;
    })
    .await;
    let mut deaf = served.connect().await;
    // Answers of some 30 MB: more than the system keeps for a client.
    let requests = "GET /openapi.json HTTP/1.1\r\nhost: localhost\r\n\r\n".repeat(300);
    deaf.write_all(requests.as_bytes()).await.expect("the system takes it");
    let answer = served.converse("GET /healthz HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n").await;
    assert!(answer.starts_with("HTTP/1.1 200 OK"), "the only place was kept: {answer}");
    drop(deaf);
    served.end().await;
}

#[tokio::test]
async fn heads_too_long_are_refused() {
    let served = Served::start(|config| config.header_wait = Duration::from_secs(5)).await;
    let long = format!("GET /healthz HTTP/1.1\r\nhost: localhost\r\nx-long: {}\r\n\r\n", "a".repeat(40_000));
    let many = format!("GET /healthz HTTP/1.1\r\nhost: localhost\r\n{}\r\n", "x-a: 1\r\n".repeat(100));
    for head in [long, many] {
        let answer = served.converse(&head).await;
        assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 431"), "{answer}");
    }
    served.end().await;
}

#[tokio::test]
async fn more_connections_than_allowed_wait_for_a_place() {
    let served = Served::start(|config| config.connections = 1).await;
    let request = "GET /healthz HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n";
    let first = served.connect().await;
    let mut second = served.connect().await;
    second.write_all(request.as_bytes()).await.expect("the system takes it");
    let mut byte = [0; 1];
    let early = tokio::time::timeout(Duration::from_millis(200), second.read(&mut byte)).await;
    assert!(early.is_err(), "it was served beside the first");
    drop(first);
    assert!(until_closed(&mut second).await.starts_with("HTTP/1.1 200 OK"));
    served.end().await;
}

#[tokio::test]
async fn a_request_for_another_host_is_refused_however_it_is_spelt() {
    let served = Served::start(|_| {}).await;
    let secret = "\"items\"";
    for (head, status) in [
        ("GET /v1/studies HTTP/1.1\r\nhost: rebind.example", "421"),
        ("GET /v1/studies HTTP/1.1\r\nHOST:\t rebind.example:80 ", "421"),
        ("GET /v1/studies HTTP/1.1\r\nhost: localhost\r\nhost: rebind.example", "400"),
        ("GET /v1/studies HTTP/1.1\r\nhost: rebind.example\r\nHost: localhost", "400"),
        ("GET /v1/studies HTTP/1.1\r\nhost:", "400"),
        ("GET /v1/studies HTTP/1.1\r\nx-host: localhost", "400"),
        ("GET /v1/studies HTTP/1.0", "400"),
        ("GET http://rebind.example/v1/studies HTTP/1.1\r\nhost: localhost", "400"),
        ("GET http://rebind.example/v1/studies HTTP/1.1\r\nhost: rebind.example", "421"),
        ("GET http://localhost@rebind.example/v1/studies HTTP/1.1\r\nhost: localhost", "400"),
        ("CONNECT rebind.example:80 HTTP/1.1\r\nhost: rebind.example:80", "421"),
        ("OPTIONS * HTTP/1.1\r\nhost: rebind.example", "421"),
        (
            "POST /v1/studies HTTP/1.1\r\nhost: rebind.example\r\norigin: http://rebind.example\r\ncontent-length: 0",
            "421",
        ),
    ] {
        let answer = served.converse(&format!("{head}\r\nconnection: close\r\n\r\n")).await;
        assert!(answer.split(' ').nth(1) == Some(status) && !answer.contains(secret), "{head}: {answer}");
    }
    for head in [
        "GET /v1/studies HTTP/1.1\r\nhost: localhost:9000",
        "GET http://localhost:9000/v1/studies HTTP/1.1\r\nhost: localhost:9000",
        "GET /v1/studies HTTP/1.0\r\nHost: [::1]:1",
    ] {
        let answer = served.converse(&format!("{head}\r\nconnection: close\r\n\r\n")).await;
        assert!(answer.contains(secret), "{head}: {answer}");
    }
    served.end().await;
}

#[tokio::test]
async fn a_coordinator_whose_writer_has_ended_ends() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = Config::new(folder.path().join("manduca.db"));
    let state = crate::open_with_clock(config, std::sync::Arc::new(crate::SystemClock::start())).await.expect("opens");
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let serving = tokio::spawn(serve(listener, state.clone(), std::future::pending()));
    state.store().close().await;
    let ended = tokio::time::timeout(DEADLINE, serving).await.expect("ends").expect("does not panic");
    let told = ended.expect_err("it does not go on").to_string();
    assert!(told.contains("the writer of the database ended"), "{told}");
}
