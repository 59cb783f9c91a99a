//! ZeroMQ over a socket of this machine.

use super::{Receiver, Sender, filled, time_of};
use anyhow::Result;
use std::path::{Path, PathBuf};

fn endpoint(path: &Path) -> String {
    format!("ipc://{}", path.display())
}

pub struct ZmqSender(zmq::Socket);

impl ZmqSender {
    pub fn open(paths: &[PathBuf]) -> Result<Self> {
        let socket = zmq::Context::new().socket(zmq::PUB)?;
        for path in paths {
            socket.connect(&endpoint(path))?;
        }
        Ok(Self(socket))
    }
}

impl Sender for ZmqSender {
    fn send(&mut self, sent_ns: u64) -> Result<()> {
        Ok(self.0.send(filled(sent_ns).as_slice(), 0)?)
    }
}

pub struct ZmqReceiver(zmq::Socket);

impl ZmqReceiver {
    pub fn open(path: &Path) -> Result<Self> {
        let socket = zmq::Context::new().socket(zmq::SUB)?;
        socket.bind(&endpoint(path))?;
        socket.set_subscribe(b"")?;
        Ok(Self(socket))
    }
}

impl Receiver for ZmqReceiver {
    fn receive(&mut self) -> Result<u64> {
        time_of(&self.0.recv_bytes(0)?)
    }
}
