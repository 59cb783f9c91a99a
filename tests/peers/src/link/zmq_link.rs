//! ZeroMQ over a socket of this machine.

use super::{Receiver, Sender, filled, time_of};
use anyhow::Result;
use std::path::Path;

fn endpoint(place: &Path) -> String {
    format!("ipc://{}", place.join("zmq").display())
}

pub struct ZmqSender(zmq::Socket);

impl ZmqSender {
    pub fn open(place: &Path) -> Result<Self> {
        let socket = zmq::Context::new().socket(zmq::PUB)?;
        socket.connect(&endpoint(place))?;
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
    pub fn open(place: &Path) -> Result<Self> {
        let socket = zmq::Context::new().socket(zmq::SUB)?;
        socket.bind(&endpoint(place))?;
        socket.set_subscribe(b"")?;
        Ok(Self(socket))
    }
}

impl Receiver for ZmqReceiver {
    fn receive(&mut self) -> Result<u64> {
        time_of(&self.0.recv_bytes(0)?)
    }
}
