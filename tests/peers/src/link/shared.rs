//! Samples in shared memory: the bus of nims, iceoryx2 with its listener, and iceoryx2 with an eventfd.

use super::{BYTES, Receiver, Sender, filled, time_of};
use anyhow::{Context, Result};
use bus::{Bus, Domain, Publisher, Subscriber, Waiter};
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher as RawPublisher;
use iceoryx2::port::subscriber::Subscriber as RawSubscriber;
use iceoryx2::prelude::{LogLevel, Node, NodeBuilder, ServiceName, SignalHandlingMode, ipc, set_log_level};
use iceoryx2::service::port_factory::event;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use messages::{Message, MotorState};
use std::path::Path;

const CHANNEL: &str = "motor/state";
/// Most listeners of a channel of the bus.
const EVENT_PLACES: usize = 64;

fn joined(place: &Path, process: &str) -> Result<Bus> {
    // The folder of the measurement names the domain too.
    let name = place.file_name().context("the place has no name")?.to_string_lossy();
    Ok(Bus::join(&Domain::new(&name)?, process)?)
}

pub struct NimsSender {
    _bus: Bus,
    port: Publisher<MotorState>,
}

impl NimsSender {
    pub fn open(place: &Path) -> Result<Self> {
        let bus = joined(place, "sender")?;
        Ok(Self { port: bus.publisher(CHANNEL)?, _bus: bus })
    }
}

impl Sender for NimsSender {
    fn send(&mut self, sent_ns: u64) -> Result<()> {
        let mut sample = MotorState::default();
        sample.header_mut().stamp_ns = sent_ns;
        self.port.send(&mut sample)?;
        Ok(())
    }
}

pub struct NimsReceiver {
    _bus: Bus,
    port: Subscriber<MotorState>,
    waiter: Waiter,
}

impl NimsReceiver {
    pub fn open(place: &Path) -> Result<Self> {
        let bus = joined(place, "receiver")?;
        Ok(Self { port: bus.subscriber(CHANNEL)?, waiter: bus.waiter(&[CHANNEL])?, _bus: bus })
    }
}

impl Receiver for NimsReceiver {
    fn receive(&mut self) -> Result<u64> {
        loop {
            if let Some(sample) = self.port.receive()? {
                return Ok(sample.header().stamp_ns);
            }
            self.waiter.wait_until(None)?;
        }
    }
}

fn node() -> Result<Node<ipc::Service>> {
    // The standard error has the result.
    set_log_level(LogLevel::Fatal);
    Ok(NodeBuilder::new().signal_handling_mode(SignalHandlingMode::Disabled).create::<ipc::Service>()?)
}

/// Places and buffers of a service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sizes {
    /// Those of iceoryx2 without settings.
    Default,
    /// Those of the channel of the bus.
    OfNims,
}

impl Sizes {
    /// Name of a service that two measurements do not share.
    fn service(self, what: &str) -> Result<ServiceName> {
        // Sender and receiver have the same parent.
        let parent = rustix::process::getppid().map_or(0, |parent| parent.as_raw_nonzero().get());
        Ok(format!("{what}-{self:?}-{parent}").as_str().try_into()?)
    }

    fn samples(self, node: &Node<ipc::Service>, what: &str) -> Result<PortFactory<ipc::Service, [u8; BYTES], ()>> {
        let mut builder = node.service_builder(&self.service(what)?).publish_subscribe::<[u8; BYTES]>();
        if self == Self::OfNims {
            let quality = messages::quality_for(CHANNEL, BYTES);
            builder = builder
                .subscriber_max_buffer_size(quality.buffer)
                .history_size(quality.history)
                .max_publishers(quality.publishers)
                .max_subscribers(quality.subscribers)
                .max_nodes(quality.nodes);
        }
        Ok(builder.open_or_create()?)
    }

    fn event(self, node: &Node<ipc::Service>, what: &str) -> Result<event::PortFactory<ipc::Service>> {
        let builder = node.service_builder(&self.service(what)?).event();
        let builder = if self == Self::OfNims { builder.max_listeners(EVENT_PLACES) } else { builder };
        Ok(builder.open_or_create()?)
    }
}

/// Samples of iceoryx2 alone.
struct RawSender(Node<ipc::Service>, RawPublisher<ipc::Service, [u8; BYTES], ()>);

impl RawSender {
    fn open(sizes: Sizes, service: &str) -> Result<Self> {
        let node = node()?;
        let port = sizes.samples(&node, service)?.publisher_builder().create()?;
        Ok(Self(node, port))
    }

    fn send(&mut self, sent_ns: u64) -> Result<()> {
        self.1.loan_uninit()?.write_payload(filled(sent_ns)).send()?;
        Ok(())
    }
}

struct RawReceiver(Node<ipc::Service>, RawSubscriber<ipc::Service, [u8; BYTES], ()>);

impl RawReceiver {
    fn open(sizes: Sizes, service: &str) -> Result<Self> {
        let node = node()?;
        let port = sizes.samples(&node, service)?.subscriber_builder().create()?;
        Ok(Self(node, port))
    }

    fn receive(&mut self) -> Result<Option<u64>> {
        self.1.receive()?.map(|sample| time_of(sample.payload())).transpose()
    }
}

const LISTENED: &str = "listened";
const DOORBELL: &str = "doorbell";

pub struct IceoryxSender(RawSender, Notifier<ipc::Service>);

impl IceoryxSender {
    pub fn open(sizes: Sizes) -> Result<Self> {
        let sender = RawSender::open(sizes, LISTENED)?;
        let notifier = sizes.event(&sender.0, LISTENED)?.notifier_builder().create()?;
        Ok(Self(sender, notifier))
    }
}

impl Sender for IceoryxSender {
    fn send(&mut self, sent_ns: u64) -> Result<()> {
        self.0.send(sent_ns)?;
        self.1.notify()?;
        Ok(())
    }
}

pub struct IceoryxReceiver(RawReceiver, Listener<ipc::Service>);

impl IceoryxReceiver {
    pub fn open(sizes: Sizes) -> Result<Self> {
        let receiver = RawReceiver::open(sizes, LISTENED)?;
        let listener = sizes.event(&receiver.0, LISTENED)?.listener_builder().create()?;
        Ok(Self(receiver, listener))
    }
}

impl Receiver for IceoryxReceiver {
    fn receive(&mut self) -> Result<u64> {
        loop {
            if let Some(sent_ns) = self.0.receive()? {
                return Ok(sent_ns);
            }
            self.1.blocking_wait(|_| {})?;
        }
    }
}

/// The eventfd is its standard output.
pub struct DoorbellSender(RawSender);

impl DoorbellSender {
    pub fn open() -> Result<Self> {
        Ok(Self(RawSender::open(Sizes::Default, DOORBELL)?))
    }
}

impl Sender for DoorbellSender {
    fn send(&mut self, sent_ns: u64) -> Result<()> {
        self.0.send(sent_ns)?;
        rustix::io::write(rustix::stdio::stdout(), &1_u64.to_ne_bytes())?;
        Ok(())
    }
}

/// The eventfd is its standard input.
pub struct DoorbellReceiver(RawReceiver);

impl DoorbellReceiver {
    pub fn open() -> Result<Self> {
        Ok(Self(RawReceiver::open(Sizes::Default, DOORBELL)?))
    }
}

impl Receiver for DoorbellReceiver {
    fn receive(&mut self) -> Result<u64> {
        loop {
            if let Some(sent_ns) = self.0.receive()? {
                return Ok(sent_ns);
            }
            rustix::io::read(rustix::stdio::stdin(), &mut [0; 8])?;
        }
    }
}
