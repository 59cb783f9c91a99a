//! What needs no library: nothing at all, and a datagram.

use super::{BYTES, Receiver, Sender, filled, time_of};
use anyhow::Result;
use std::os::unix::net::UnixDatagram;
use std::path::Path;

/// Sends and receives nothing.
pub struct Nothing;

impl Sender for Nothing {
    fn send(&mut self, _: u64) -> Result<()> {
        Ok(())
    }
}

impl Receiver for Nothing {
    fn receive(&mut self) -> Result<u64> {
        // Until it is killed.
        loop {
            std::thread::park();
        }
    }
}

pub struct DatagramSender(UnixDatagram);

impl DatagramSender {
    pub fn open(place: &Path) -> Result<Self> {
        let socket = UnixDatagram::unbound()?;
        socket.connect(place.join("datagram"))?;
        Ok(Self(socket))
    }
}

impl Sender for DatagramSender {
    fn send(&mut self, sent_ns: u64) -> Result<()> {
        self.0.send(&filled(sent_ns))?;
        Ok(())
    }
}

pub struct DatagramReceiver(UnixDatagram);

impl DatagramReceiver {
    pub fn open(place: &Path) -> Result<Self> {
        Ok(Self(UnixDatagram::bind(place.join("datagram"))?))
    }
}

impl Receiver for DatagramReceiver {
    fn receive(&mut self) -> Result<u64> {
        let mut bytes = [0; BYTES];
        let got = self.0.recv(&mut bytes)?;
        time_of(&bytes[..got])
    }
}
