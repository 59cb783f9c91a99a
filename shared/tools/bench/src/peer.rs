//! The peer process of `bus`: echoes samples over the bus and over its socket until its parent ends.

use bus::{Bus, Domain};
use command::{Answer, Failure};
use messages::MotorState;
use std::io::Read;
use std::os::fd::AsFd;
use std::os::unix::net::UnixDatagram;
use std::sync::mpsc::{Sender, channel};

/// Command-line argument that starts it.
pub const COMMAND: &str = "bench-peer";
/// Message on its socket once it is ready; any other message is the reason why it is not.
pub const READY: &[u8] = b"ready";
/// Channel to the peer.
pub const TO_PEER: &str = "motor/state";
/// Channel back.
pub const FROM_PEER: &str = "bench/back";

/// Runs the peer. Its standard output is the socket; it ends when its standard input is closed.
///
/// # Errors
/// An unusable argument or socket.
pub fn serve(domain: &str) -> Answer {
    let no_socket =
        |error: std::io::Error| Failure::BadInput(format!("only `nims bench` may start {COMMAND}: {error}"));
    bus::make_private();
    let socket = UnixDatagram::from(std::io::stdout().as_fd().try_clone_to_owned().map_err(no_socket)?);
    socket.peer_addr().map_err(no_socket)?;
    let domain = Domain::parse(domain)?;
    let (startup_sender, startup) = channel();
    std::thread::spawn(move || {
        if let Err(failure) = by_bus(&domain, &startup_sender) {
            let _ = startup_sender.send(Err(failure));
        }
    });
    // The other thread always sends a result unless it has panicked.
    let started =
        startup.recv().unwrap_or_else(|_| Err(Failure::NotNow("the peer's bus thread ended early".to_owned())));
    let word = match &started {
        Ok(()) => READY.to_vec(),
        Err(failure) => failure.to_string().into_bytes(),
    };
    socket.send(&word).map_err(no_socket)?;
    started?;
    std::thread::spawn(move || by_socket(&socket));
    // An error has the same effect as the end of the input.
    let _ = std::io::stdin().read(&mut [0]);
    Ok(())
}

/// Publishes, notifies and receives as the processes of the control chain do.
fn by_bus(domain: &Domain, startup_sender: &Sender<Answer>) -> Answer {
    let bus = Bus::join(domain, COMMAND)?;
    let mut there = bus.subscriber::<MotorState>(TO_PEER)?;
    let mut back = bus.publisher::<MotorState>(FROM_PEER)?;
    let mut waiter = bus.waiter(&[TO_PEER])?;
    let _ = startup_sender.send(Ok(()));
    loop {
        waiter.wait_until(None)?;
        while let Some(mut sample) = there.receive()? {
            back.send(&mut sample)?;
        }
    }
}

fn by_socket(socket: &UnixDatagram) {
    let mut sample = [0; size_of::<MotorState>()];
    while let Ok(bytes) = socket.recv(&mut sample) {
        // The parent closed its end, so this process is about to end.
        if socket.send(&sample[..bytes]).is_err() {
            return;
        }
    }
}
