//! What needs no library: nothing at all, and a datagram.

use super::{BYTES, Receiver, Sender, filled, time_of};
use anyhow::Result;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};

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

pub struct DatagramSender(Vec<UnixDatagram>);

impl DatagramSender {
    pub fn open(paths: &[PathBuf]) -> Result<Self> {
        let connected = |path| {
            let socket = UnixDatagram::unbound()?;
            socket.connect(path)?;
            Ok(socket)
        };
        Ok(Self(paths.iter().map(connected).collect::<Result<_>>()?))
    }
}

impl Sender for DatagramSender {
    fn send(&mut self, sent_ns: u64) -> Result<()> {
        for socket in &self.0 {
            socket.send(&filled(sent_ns))?;
        }
        Ok(())
    }
}

pub struct DatagramReceiver(UnixDatagram);

impl DatagramReceiver {
    pub fn open(path: &Path) -> Result<Self> {
        Ok(Self(UnixDatagram::bind(path)?))
    }
}

impl Receiver for DatagramReceiver {
    fn receive(&mut self) -> Result<u64> {
        let mut bytes = [0; BYTES];
        let got = self.0.recv(&mut bytes)?;
        time_of(&bytes[..got])
    }
}
