//! The ways from one process to another.

#[cfg(feature = "cyclone")]
mod cyclone;
#[cfg(feature = "dds")]
mod dds;
mod plain;
mod shared;
#[cfg(feature = "zenoh")]
mod zenoh_link;
#[cfg(feature = "zmq")]
mod zmq_link;

use anyhow::{Context, Result, ensure};
use shared::Sizes;
use std::path::{Path, PathBuf};

/// Size of a sample, bytes: that of `motor/state`.
pub const BYTES: usize = size_of::<messages::MotorState>();

/// The sending end.
pub trait Sender {
    /// Sends a sample with this time, ns.
    fn send(&mut self, sent_ns: u64) -> Result<()>;
}

/// The receiving end.
pub trait Receiver {
    /// Sleeps until a sample arrives; returns the time that it holds, ns.
    fn receive(&mut self) -> Result<u64>;
}

/// A way from one process to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// Sends nothing: what the schedule itself costs.
    Nothing,
    /// The bus of nims.
    Nims,
    /// iceoryx2 with its listener, as in its examples.
    Iceoryx,
    /// The same with the places and the buffers of the bus.
    Sized,
    /// Samples of iceoryx2, and an eventfd that wakes.
    Doorbell,
    /// A datagram between sockets of this machine.
    Datagram,
    /// Zenoh over a socket of this machine.
    #[cfg(feature = "zenoh")]
    Zenoh,
    /// ZeroMQ over `ipc://`.
    #[cfg(feature = "zmq")]
    Zmq,
    /// A DDS in Rust, best effort.
    #[cfg(feature = "dds")]
    Dds,
    /// Cyclone DDS over UDP, best effort.
    #[cfg(feature = "cyclone")]
    Cyclone,
}

impl Way {
    /// Every way, with its name.
    pub const ALL: &[(Way, &'static str)] = &[
        (Way::Nothing, "the schedule alone"),
        (Way::Nims, "nims"),
        (Way::Iceoryx, "iceoryx2 with its listener"),
        (Way::Sized, "iceoryx2 with the places of nims"),
        (Way::Doorbell, "iceoryx2 with an eventfd"),
        (Way::Datagram, "datagram"),
        #[cfg(feature = "zenoh")]
        (Way::Zenoh, "zenoh"),
        #[cfg(feature = "zmq")]
        (Way::Zmq, "ZeroMQ"),
        #[cfg(feature = "dds")]
        (Way::Dds, "Dust DDS"),
        #[cfg(feature = "cyclone")]
        (Way::Cyclone, "Cyclone DDS over UDP"),
    ];

    /// Returns the way of a name.
    pub fn named(name: &str) -> Result<Way> {
        let found = Self::ALL.iter().find(|(_, known)| *known == name);
        Ok(found.with_context(|| format!("{name} is no way"))?.0)
    }

    /// Opens the sending end. The receiving end is there.
    pub fn sender(self, place: &Path) -> Result<Box<dyn Sender>> {
        Ok(match self {
            Way::Nothing => Box::new(plain::Nothing),
            Way::Nims => Box::new(shared::NimsSender::open(place)?),
            Way::Iceoryx => Box::new(shared::IceoryxSender::open(Sizes::Default)?),
            Way::Sized => Box::new(shared::IceoryxSender::open(Sizes::OfNims)?),
            Way::Doorbell => Box::new(shared::DoorbellSender::open()?),
            Way::Datagram => Box::new(plain::DatagramSender::open(&paths_of(place, "datagram")?)?),
            #[cfg(feature = "zenoh")]
            Way::Zenoh => Box::new(zenoh_link::ZenohSender::open(&paths_of(place, "zenoh")?)?),
            #[cfg(feature = "zmq")]
            Way::Zmq => Box::new(zmq_link::ZmqSender::open(&paths_of(place, "zmq")?)?),
            #[cfg(feature = "dds")]
            Way::Dds => Box::new(dds::DdsSender::open()?),
            #[cfg(feature = "cyclone")]
            Way::Cyclone => Box::new(cyclone::CycloneSender::open()?),
        })
    }

    /// Whether a sample reaches several receivers.
    pub fn reaches_several(self) -> bool {
        self != Self::Doorbell
    }

    /// Opens the receiving end; `number` is unique among those of this way.
    pub fn receiver(self, place: &Path, number: &str) -> Result<Box<dyn Receiver>> {
        Ok(match self {
            Way::Nothing => Box::new(plain::Nothing),
            Way::Nims => Box::new(shared::NimsReceiver::open(place)?),
            Way::Iceoryx => Box::new(shared::IceoryxReceiver::open(Sizes::Default)?),
            Way::Sized => Box::new(shared::IceoryxReceiver::open(Sizes::OfNims)?),
            Way::Doorbell => Box::new(shared::DoorbellReceiver::open()?),
            Way::Datagram => Box::new(plain::DatagramReceiver::open(&path_of(place, "datagram", number))?),
            #[cfg(feature = "zenoh")]
            Way::Zenoh => Box::new(zenoh_link::ZenohReceiver::open(&path_of(place, "zenoh", number))?),
            #[cfg(feature = "zmq")]
            Way::Zmq => Box::new(zmq_link::ZmqReceiver::open(&path_of(place, "zmq", number))?),
            #[cfg(feature = "dds")]
            Way::Dds => Box::new(dds::DdsReceiver::open()?),
            #[cfg(feature = "cyclone")]
            Way::Cyclone => Box::new(cyclone::CycloneReceiver::open()?),
        })
    }
}

/// The socket of a receiver.
fn path_of(place: &Path, way: &str, number: &str) -> PathBuf {
    place.join(format!("{way}-{number}"))
}

/// The sockets of the receivers that are there.
fn paths_of(place: &Path, way: &str) -> Result<Vec<PathBuf>> {
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(place)? {
        let path = entry?.path();
        // Some libraries put a lock file beside the socket.
        let is_socket = path.extension().is_none();
        if is_socket && path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&format!("{way}-"))) {
            paths.push(path);
        }
    }
    ensure!(!paths.is_empty(), "no receiver is there");
    Ok(paths)
}

/// A sample with this time, as bytes.
fn filled(sent_ns: u64) -> [u8; BYTES] {
    let mut bytes = [0; BYTES];
    bytes[..8].copy_from_slice(&sent_ns.to_ne_bytes());
    bytes
}

/// The time that a sample holds, ns.
fn time_of(bytes: &[u8]) -> Result<u64> {
    let bytes = bytes.get(..8).context("a sample is too short")?;
    Ok(u64::from_ne_bytes(bytes.try_into()?))
}
