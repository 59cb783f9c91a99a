//! The other process of `bus`: sends back what comes, over the bus and over its socket, until whoever started it is gone.

use bus::{Bus, Domain};
use command::{Answer, Failure};
use messages::MotorState;
use std::io::Read;
use std::os::fd::AsFd;
use std::os::unix::net::UnixDatagram;
use std::sync::mpsc::{Sender, channel};

/// How it is started.
pub const COMMAND: &str = "bench-peer";
/// What it says on its socket once it listens; anything else is why it cannot.
pub const READY: &[u8] = b"ready";
/// The channel to it.
pub const THERE: &str = "motor/state";
/// The channel back.
pub const BACK: &str = "bench/back";

/// Serves. Standard output is its socket; the end of standard input is its own.
///
/// # Errors
/// What it was given cannot be used.
pub fn serve(domain: &str) -> Answer {
    let no_socket =
        |error: std::io::Error| Failure::BadInput(format!("{COMMAND} is started by `nims bench` alone: {error}"));
    bus::make_private();
    let socket = UnixDatagram::from(std::io::stdout().as_fd().try_clone_to_owned().map_err(no_socket)?);
    socket.peer_addr().map_err(no_socket)?;
    let domain = Domain::parse(domain)?;
    let (say, said) = channel();
    std::thread::spawn(move || {
        if let Err(failure) = by_bus(&domain, &say) {
            let _ = say.send(Err(failure));
        }
    });
    // The other thread says something in any case, or has ended.
    let begun = said.recv().unwrap_or_else(|_| Err(Failure::NotNow("it ended early".to_owned())));
    let word = match &begun {
        Ok(()) => READY.to_vec(),
        Err(failure) => failure.to_string().into_bytes(),
    };
    socket.send(&word).map_err(no_socket)?;
    begun?;
    std::thread::spawn(move || by_socket(&socket));
    // An error is as good as an end.
    let _ = std::io::stdin().read(&mut [0]);
    Ok(())
}

/// Publish, notify, receive, as the processes of the control chain do.
fn by_bus(domain: &Domain, say: &Sender<Answer>) -> Answer {
    let bus = Bus::join(domain, COMMAND)?;
    let mut there = bus.subscriber::<MotorState>(THERE)?;
    let mut back = bus.publisher::<MotorState>(BACK)?;
    let mut waiter = bus.waiter(&[THERE])?;
    let _ = say.send(Ok(()));
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
        // Without anybody at the other end, this process is about to end.
        if socket.send(&sample[..bytes]).is_err() {
            return;
        }
    }
}
