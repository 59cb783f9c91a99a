//! Zenoh over a socket of this machine.

use super::{Receiver, Sender, filled, time_of};
use anyhow::{Result, anyhow};
use std::path::Path;
use zenoh::Wait;
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::sample::Sample;

const KEY: &str = "motor/state";

fn session(place: &Path, role: &str) -> Result<zenoh::Session> {
    let mut config = zenoh::Config::default();
    let endpoints = format!("[\"unixsock-stream/{}\"]", place.join("zenoh").display());
    let keys = [
        ("mode", "\"peer\""),
        ("scouting/multicast/enabled", "false"),
        ("listen/endpoints", if role == "listen" { &endpoints } else { "[]" }),
        ("connect/endpoints", if role == "listen" { "[]" } else { &endpoints }),
    ];
    for (key, value) in keys {
        config.insert_json5(key, value).map_err(|error| anyhow!("{error}"))?;
    }
    zenoh::open(config).wait().map_err(|error| anyhow!("{error}"))
}

pub struct ZenohSender {
    publisher: Publisher<'static>,
    _session: zenoh::Session,
}

impl ZenohSender {
    pub fn open(place: &Path) -> Result<Self> {
        let session = session(place, "connect")?;
        let publisher = session.declare_publisher(KEY).wait().map_err(|error| anyhow!("{error}"))?;
        Ok(Self { publisher, _session: session })
    }
}

impl Sender for ZenohSender {
    fn send(&mut self, sent_ns: u64) -> Result<()> {
        self.publisher.put(filled(sent_ns).as_slice()).wait().map_err(|error| anyhow!("{error}"))
    }
}

pub struct ZenohReceiver {
    subscriber: Subscriber<FifoChannelHandler<Sample>>,
    _session: zenoh::Session,
}

impl ZenohReceiver {
    pub fn open(place: &Path) -> Result<Self> {
        let session = session(place, "listen")?;
        let subscriber = session.declare_subscriber(KEY).wait().map_err(|error| anyhow!("{error}"))?;
        Ok(Self { subscriber, _session: session })
    }
}

impl Receiver for ZenohReceiver {
    fn receive(&mut self) -> Result<u64> {
        let sample = self.subscriber.recv().map_err(|error| anyhow!("{error}"))?;
        time_of(&sample.payload().to_bytes())
    }
}
