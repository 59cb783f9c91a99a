//! Zenoh over a socket of this machine.

use super::{Receiver, Sender, filled, time_of};
use anyhow::{Result, anyhow};
use std::path::{Path, PathBuf};
use zenoh::Wait;
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::sample::Sample;

const KEY: &str = "motor/state";

fn session(listened: &[PathBuf], connected: &[PathBuf]) -> Result<zenoh::Session> {
    let mut config = zenoh::Config::default();
    let list = |paths: &[PathBuf]| {
        let endpoints = paths.iter().map(|path| format!("\"unixsock-stream/{}\"", path.display()));
        format!("[{}]", endpoints.collect::<Vec<_>>().join(", "))
    };
    let keys = [
        ("mode", "\"peer\""),
        ("scouting/multicast/enabled", "false"),
        ("listen/endpoints", &list(listened)),
        ("connect/endpoints", &list(connected)),
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
    pub fn open(paths: &[PathBuf]) -> Result<Self> {
        let session = session(&[], paths)?;
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
    pub fn open(path: &Path) -> Result<Self> {
        let session = session(&[path.to_owned()], &[])?;
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
