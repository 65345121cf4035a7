//! A worker waits for work in one request.

use std::time::{Duration, Instant};

use serde_json::json;

use super::answers::study;
use super::bench::Bench;

#[tokio::test]
async fn waiting_ends_when_work_comes() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let waiting = bench.exchange(&worker, json!({ "want": 2, "wait_s": 20.0 }));
    let submitting = async {
        tokio::time::sleep(Duration::from_millis(100)).await;
        bench.submit(&study(20, &[])).await
    };
    let began = Instant::now();
    let (told, _) = tokio::join!(waiting, submitting);
    assert_eq!(told.jobs.len(), 2);
    assert!(began.elapsed() < Duration::from_secs(10));
}

#[tokio::test]
async fn waiting_ends_empty_in_time_and_at_shutdown() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let told = bench.exchange(&worker, json!({ "want": 2, "wait_s": 0.05 })).await;
    assert!(told.jobs.is_empty());
    let waiting = bench.exchange(&worker, json!({ "want": 2, "wait_s": 20.0 }));
    let stopping = async {
        tokio::time::sleep(Duration::from_millis(50)).await;
        bench.state.stopping().cancel();
    };
    let began = Instant::now();
    let (told, ()) = tokio::join!(waiting, stopping);
    assert!(told.jobs.is_empty() && !told.drain);
    assert!(began.elapsed() < Duration::from_secs(10));
}

#[tokio::test]
async fn the_real_thing_stops_while_workers_wait() {
    let folder = tempfile::tempdir().expect("a folder");
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = listener.local_addr().expect("an address");
    let config = crate::Config::new(folder.path().join("manduca.db"));
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let hold = match crate::Hold::take(&config.database).expect("can be held") {
        crate::Taken::Ours(hold) => hold,
        crate::Taken::Theirs(_) => panic!("a fresh database is nobody's"),
    };
    let state = crate::open(config, hold).await.expect("opens");
    let server = tokio::spawn(crate::serve(listener, state, async {
        let _ = stopped.await;
    }));
    let mut socket = tokio::net::TcpStream::connect(address).await.expect("connects");
    // An idle connection and an open coordinator: neither may hold up the end.
    tokio::io::AsyncWriteExt::write_all(&mut socket, b"GET /healthz HTTP/1.1\r\nhost: localhost\r\n\r\n")
        .await
        .expect("asks");
    let mut answer = [0; 12];
    tokio::io::AsyncReadExt::read_exact(&mut socket, &mut answer).await.expect("is answered");
    assert_eq!(&answer, b"HTTP/1.1 200");
    stop.send(()).expect("is running");
    let ended = tokio::time::timeout(Duration::from_secs(8), server).await.expect("ends in time");
    ended.expect("does not panic").expect("ends well");
}
