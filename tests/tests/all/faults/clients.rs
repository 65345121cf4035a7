//! Clients which are slow on purpose.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::thread::sleep;
use std::time::Duration;

use manduca_tests::coordinator::Coordinator;
use manduca_tests::slow::{Slow, SlowClients};
use manduca_tests::studies::lattice;
use manduca_tests::{is_long, wait_for};

use super::{assert_once, times, undisturbed};

/// Bytes a slow client may cost: what it has asked for, once, and some for its connection.
const EACH: u64 = 300 << 10;

#[test]
fn slow_clients_hold_nobody_up_and_cost_little_memory() {
    let each = usize::try_from(times(60, 1000)).unwrap();
    let coordinator = Coordinator::start();
    let study = lattice("beside the slow", 71, 40);
    let before = coordinator.peak_memory();
    let slow = SlowClients::start(coordinator.address(), each);
    let _worker = coordinator.worker("quick");
    let id = coordinator.submit(&study);
    coordinator.wait_until_succeeded(&id);
    assert_once(&coordinator, &id);
    assert_eq!([coordinator.dataset(&id, "text/csv")], *undisturbed(&[study]));
    if is_long() {
        wait_for("the slow to be let go", || (slow.open() == 0).then_some(()));
    }
    let grown = coordinator.peak_memory() - before;
    let all = each * Slow::ALL.len();
    println!("{all} slow clients, {} of them let go; peak memory grew by {} MiB", all - slow.open(), grown >> 20);
    let heard = slow.end();
    assert!(heard.iter().all(|line| line.starts_with("HTTP/1.1 408")), "{heard:?}");
    if is_long() {
        assert!(heard.len() >= each, "{} of {each} unended bodies were answered", heard.len());
    }
    // 32 MiB for the study itself.
    assert!(grown < all as u64 * EACH + (32 << 20), "{all} slow clients cost {grown} bytes");
}

#[test]
fn a_body_in_single_bytes_costs_little_more_than_its_bytes() {
    let coordinator = Coordinator::start();
    let before = coordinator.peak_memory();
    let mut stream = TcpStream::connect(coordinator.address()).unwrap();
    stream.set_nodelay(true).unwrap();
    let head = "POST /v1/studies HTTP/1.1\r\nhost: localhost\r\ncontent-type: application/json\r\ncontent-length: 10001\r\n\r\n";
    stream.write_all(head.as_bytes()).unwrap();
    for _ in 0..10_000 {
        stream.write_all(b" ").unwrap();
        // So that each arrives by itself: kept with its buffer, each would cost some KiB.
        sleep(Duration::from_micros(200));
    }
    let grown = coordinator.peak_memory() - before;
    stream.write_all(b"x").unwrap();
    let mut answer = [0; 12];
    stream.read_exact(&mut answer).unwrap();
    assert_eq!(&answer, b"HTTP/1.1 400");
    println!("10,000 bytes, one at a time, cost {} KiB", grown >> 10);
    assert!(grown < 8 << 20, "10,000 bytes cost {grown}");
}
