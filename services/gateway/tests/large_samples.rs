//! Samples that are larger than what may wait for a client.

#![allow(clippy::unwrap_used, clippy::panic)]

use bus::{Bus, Domain};
use config::GatewaySection;
use gateway::Server;
use gateway::settings::Settings;
use gateway_protocol::{Call, Origin, VERSION, encode};
use messages::blob::BlobType;
use messages::{Header, OperatorRequest, Request};
use std::io::Write;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// More than what may wait for a client, and than what its socket takes.
const PICTURE: usize = 3 << 20;
const LONGEST: Duration = Duration::from_secs(60);

#[test]
fn a_client_that_reads_no_large_samples_stops_the_robot() {
    let folder = tempfile::tempdir().unwrap();
    let domain = Domain::for_test();
    let robot = Bus::join(&domain, "motor-io").unwrap();
    let mut motor_io = robot.server("motor-io").unwrap();
    let mut camera = robot.blob_publisher("blob/camera", BlobType::CompressedImage, PICTURE, 10.0).unwrap();
    let settings = Settings {
        system: folder.path().join("lab.toml"),
        name: "lab".to_owned(),
        instance: "lab".to_owned(),
        domain: domain.name().to_owned(),
        socket: folder.path().join("lab.sock"),
        runs: folder.path().join("runs"),
        tokens: folder.path().join("tokens.json"),
        section: GatewaySection::default(),
        plugins: Vec::new(),
    };
    let stop = Arc::new(AtomicBool::new(false));
    let (socket, flag) = (settings.socket.clone(), Arc::clone(&stop));
    let server = std::thread::spawn(move || {
        let mut server = Server::open(&settings).map_err(|error| error.to_string()).unwrap();
        server.run(&flag).map_err(|error| error.to_string()).unwrap();
    });
    let begun = Instant::now();
    let mut client = loop {
        match UnixStream::connect(&socket) {
            Ok(client) => break client,
            Err(error) => assert!(begun.elapsed() < LONGEST && !server.is_finished(), "{error}"),
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let mut send = |call: Call| client.write_all(&encode(&call.header().unwrap(), &[])).unwrap();
    send(Call::Hello { version: VERSION, origin: Origin::Python, token: None, from: None });
    send(Call::Subscribe { id: 1, channel: "blob/camera".to_owned(), rate_hz: None });
    // Until the gateway has a picture: it takes no further one for a client that does not read.
    let picture = vec![7; PICTURE];
    let mut arrived = [0; 1 << 16];
    while peeked(&client, &mut arrived) < arrived.len() {
        assert!(begun.elapsed() < LONGEST && !server.is_finished(), "no picture");
        camera.send(Header::default(), &picture).unwrap();
        std::thread::sleep(Duration::from_millis(20));
    }
    let mut send = |call: Call| client.write_all(&encode(&call.header().unwrap(), &[])).unwrap();
    send(Call::Ask { id: 2, request: Request::Stop, process: None, held: false, at_ns: None, pressed_ns: None });
    let asked: OperatorRequest = loop {
        assert!(begun.elapsed() < LONGEST && !server.is_finished(), "no stop");
        if let Some(call) = motor_io.try_next().unwrap() {
            break call.request;
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    assert!(matches!(Request::decode(&asked), Ok(Request::Stop)), "{asked:?}");
    stop.store(true, Ordering::Relaxed);
    server.join().unwrap();
}

/// The number of bytes that have arrived, at most as many as fit.
fn peeked(client: &UnixStream, arrived: &mut [u8]) -> usize {
    let flags = rustix::net::RecvFlags::PEEK | rustix::net::RecvFlags::DONTWAIT;
    rustix::net::recv(client, arrived, flags).map_or(0, |(_, length)| length)
}
