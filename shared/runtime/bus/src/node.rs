//! A process's place on the bus, and how it opens channels.

use std::cell::{OnceCell, RefCell};
use std::collections::HashMap;
use std::time::Duration;

use iceoryx2::node::Node;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::{
    CallbackProgression, EventId, LogLevel, MessagingPattern, NodeBuilder, NodeName, NodeState, PortFactory as _,
    PortName, Service, ServiceName, SignalHandlingMode, ipc, set_log_level,
};
use iceoryx2::service::ServiceDetails;
use iceoryx2::service::builder::event::EventOpenOrCreateError;
use iceoryx2::service::builder::publish_subscribe::{PublishSubscribeCreateError, PublishSubscribeOpenError};
use iceoryx2::service::port_factory::{event, publish_subscribe};
use messages::ros::Payload;
use messages::{Quality, quality_for};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use crate::clock::{SECOND_NS, now_ns, sleep_until};
use crate::definition::{self, SchemaContinuation};
use crate::domain::info_of;
use crate::error::{PlaceKind, THIS_PROCESS};
use crate::places::{Party, Refused, listed};
use crate::shm_sample::ShmSample;
use crate::{BusError, CHANNELS_EVENT, Domain};

/// A channel half made by another process: longer than a virtual machine's longest stall, and than what makes it count as abandoned.
const OPENING_PATIENCE_NS: u64 = 4 * SECOND_NS;
/// Joining while somebody else sweeps fails for as long as that takes: milliseconds.
const JOINING_PATIENCE_NS: u64 = SECOND_NS;
const JOINING_PAUSE: Duration = Duration::from_millis(20);
/// Every process on `system/channels`; and one notifier more than publishers elsewhere, so that a successor can be there already.
const EVENT_PORTS: usize = 64;
/// Samples a publisher loans at once: it copies into one, sends it, and has none.
pub(crate) const LOANS: usize = 1;
/// Samples a subscriber borrows at once: it copies out of one.
pub(crate) const BORROWS: usize = 1;
/// 40 channels at 5 descriptors each, and room for files and ports.
const DESCRIPTORS: u64 = 4096;

pub(crate) type PubSub<P> = publish_subscribe::PortFactory<ipc::Service, P, ()>;

/// A process's place on the bus of its robot; makes ports.
#[derive(Debug)]
pub struct Bus {
    pub(crate) node: Node<ipc::Service>,
    domain: Domain,
    process: String,
    pub(crate) party: Party,
    pub(crate) port_name: PortName,
    announcer: OnceCell<Notifier<ipc::Service>>,
    /// What long definitions need beside their channels, by type name, held open as long as this process is there.
    sheets: RefCell<HashMap<&'static str, Vec<SchemaContinuation>>>,
}

impl Bus {
    /// Joins a domain under a process name as one of the robot's processes, and removes what processes that were killed have left there.
    ///
    /// # Errors
    /// [`BusError::Join`] if the name is longer than 63 bytes or the folder is unusable, [`BusError::NoMemory`] if the system has no room.
    pub fn join(domain: &Domain, process: &str) -> Result<Self, BusError> {
        Self::join_as(domain, process, Party::Member)
    }

    /// [`Bus::join`] as one that leaves places to others.
    ///
    /// # Errors
    /// As [`Bus::join`].
    pub fn join_as(domain: &Domain, process: &str, party: Party) -> Result<Self, BusError> {
        let failed =
            |why: String| BusError::Join { process: process.to_owned(), domain: domain.name().to_owned(), why };
        set_log_level(LogLevel::Fatal); // what matters comes back as an error
        raise_descriptor_limit();
        let port_name = party
            .port_name(process)
            .map_err(|_| failed("its name is longer than 63 bytes or not plain ASCII".to_owned()))?;
        crate::memory::need(0, party, process)?;
        if domain.lies_elsewhere() {
            return Err(failed(
                "its shared memory is in another /dev/shm: that of its service, which `nims-at NAME ..` enters"
                    .to_owned(),
            ));
        }
        let node_name = NodeName::new(process).map_err(|error| failed(error.to_string()))?;
        let give_up = now_ns() + JOINING_PATIENCE_NS;
        let node = loop {
            domain.before_cleaning(); // making a node cleans up after the dead
            let node = NodeBuilder::new()
                .name(&node_name)
                .config(domain.config())
                .signal_handling_mode(SignalHandlingMode::Disabled)
                .create::<ipc::Service>();
            match node {
                Ok(node) => break node,
                // Whoever starts the robot in this very moment removes what lies there from before, folders too.
                Err(_) if now_ns() < give_up => std::thread::sleep(JOINING_PAUSE),
                Err(error) => {
                    // Memory that has run out meanwhile is the cause.
                    crate::memory::need(0, party, process)?;
                    let place = domain.root().display();
                    return Err(failed(format!("shared memory cannot be set up in {place} ({error:?})")));
                }
            }
        };
        domain.shut();
        let (announcer, sheets) = (OnceCell::new(), RefCell::default());
        Ok(Self { node, domain: domain.clone(), process: process.to_owned(), party, port_name, announcer, sheets })
    }

    /// The domain joined.
    #[must_use]
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// The name it was joined under.
    #[must_use]
    pub fn process(&self) -> &str {
        &self.process
    }

    /// Opens or makes the channel with the table's quality of service; the schema text becomes part of it.
    pub(crate) fn open_typed<T: Payload>(&self, channel: &str) -> Result<PubSub<ShmSample<T>>, BusError> {
        let name = service_name(channel)?;
        self.need(0, channel)?;
        let quality = quality_for(channel, size_of::<T>());
        let attributes = definition::attributes(T::type_name(), T::schema())?;
        if !self.sheets.borrow().contains_key(T::type_name()) {
            let sheets = definition::sheets(&self.node, &self.domain, T::schema())?;
            self.sheets.borrow_mut().insert(T::type_name(), sheets);
        }
        let builder = || {
            self.node
                .service_builder(&name)
                .publish_subscribe::<ShmSample<T>>()
                .enable_safe_overflow(true)
                .subscriber_max_borrowed_samples(BORROWS)
        };
        let give_up = now_ns() + OPENING_PATIENCE_NS;
        let mut cleaned = false;
        loop {
            // open first: a peer from another language, or a tunnel, may have made it without the schema text; the type's name decides
            let error = match builder().open() {
                Ok(service) => return Ok(service),
                Err(error) => error,
            };
            let passing = match error {
                PublishSubscribeOpenError::DoesNotExist => match builder()
                    .subscriber_max_buffer_size(quality.buffer)
                    .history_size(quality.history)
                    .max_publishers(quality.publishers)
                    .max_subscribers(quality.subscribers)
                    .max_nodes(quality.nodes)
                    .create_with_attributes(&attributes)
                {
                    Ok(service) => {
                        self.announce();
                        return Ok(service);
                    }
                    Err(
                        PublishSubscribeCreateError::AlreadyExists
                        | PublishSubscribeCreateError::IsBeingCreatedByAnotherInstance,
                    ) => true,
                    Err(error) => return Err(BusError::failed(channel, "be made", &error)),
                },
                PublishSubscribeOpenError::ExceedsMaxNumberOfNodes if !cleaned => {
                    self.clean();
                    cleaned = true;
                    true
                }
                PublishSubscribeOpenError::HangsInCreation
                | PublishSubscribeOpenError::IsMarkedForDestruction
                | PublishSubscribeOpenError::Interrupt
                | PublishSubscribeOpenError::ServiceInCorruptedState => true,
                _ => false,
            };
            if !passing || now_ns() > give_up {
                return Err(self.explain(channel, error, T::type_name(), &quality));
            }
            self.domain.remove_half_made();
            sleep_until(now_ns() + 2_000_000);
        }
    }

    fn explain(&self, channel: &str, error: PublishSubscribeOpenError, wanted: &str, quality: &Quality) -> BusError {
        use PublishSubscribeOpenError as E;
        let channel_name = channel.to_owned();
        let holders = self.held_by(channel, MessagingPattern::PublishSubscribe);
        match error {
            E::IncompatibleTypes => {
                let found = self.carried_by(channel);
                BusError::TypeMismatch { channel: channel_name, found, wanted: wanted.to_owned(), holders }
            }
            E::ExceedsMaxNumberOfNodes => {
                BusError::Full { channel: channel_name, limit: quality.nodes, what: PlaceKind::Processes, holders }
            }
            E::DoesNotSupportRequestedMinSubscriberBorrowedSamples | E::IncompatibleOverflowBehavior => {
                quality_mismatch(channel_name, "it was not made by this project's bus", holders)
            }
            E::VersionMismatch => {
                quality_mismatch(channel_name, "it was made with another version of iceoryx2", holders)
            }
            other => BusError::failed(channel, "be opened", &other),
        }
    }

    fn details(&self, channel: &str, pattern: MessagingPattern) -> Option<ServiceDetails<ipc::Service>> {
        let name = ServiceName::new(channel).ok()?;
        ipc::Service::details(&name, self.domain.config(), pattern).ok().flatten()
    }

    /// The type name that the channel carries.
    fn carried_by(&self, channel: &str) -> String {
        self.details(channel, MessagingPattern::PublishSubscribe).map_or_else(
            || "nothing".to_owned(),
            |details| details.static_details.publish_subscribe().message_type_details().payload.type_name().to_string(),
        )
    }

    /// Who holds the channel, or the event or the requests of that name, in words; empty where that is not known.
    fn held_by(&self, channel: &str, pattern: MessagingPattern) -> String {
        let details = self.details(channel, pattern);
        let Some(dynamic) = details.and_then(|details| details.dynamic_details) else { return String::new() };
        let mut holders: Vec<String> = Vec::new();
        for node in &dynamic.nodes {
            if let NodeState::Alive(node) = node {
                let info = info_of(node);
                holders.push(if info.pid == std::process::id() {
                    THIS_PROCESS.to_owned()
                } else {
                    format!("{} (process {})", info.name, info.pid)
                });
            }
        }
        holders.dedup();
        if holders.is_empty() { "a process that has died".to_owned() } else { holders.join(", ") }
    }

    /// Opens or makes the event beside a channel.
    pub(crate) fn open_event(&self, channel: &str) -> Result<event::PortFactory<ipc::Service>, BusError> {
        let name = service_name(channel)?;
        self.need(0, channel)?;
        let give_up = now_ns() + OPENING_PATIENCE_NS;
        loop {
            let made = self
                .node
                .service_builder(&name)
                .event()
                .max_notifiers(EVENT_PORTS)
                .max_listeners(EVENT_PORTS)
                .max_nodes(EVENT_PORTS)
                .open_or_create();
            match made {
                Ok(service) => return Ok(service),
                Err(error) if now_ns() > give_up => return Err(BusError::failed(channel, "open its event", &error)),
                Err(EventOpenOrCreateError::EventOpenError(_) | EventOpenOrCreateError::SystemInFlux) => {
                    self.domain.remove_half_made();
                    sleep_until(now_ns() + 2_000_000);
                }
                Err(error) => return Err(BusError::failed(channel, "make its event", &error)),
            }
        }
    }

    pub(crate) fn notifier(&self, channel: &str) -> Result<Notifier<ipc::Service>, BusError> {
        let service = self.open_event(channel)?;
        let make = || service.notifier_builder().name(&self.port_name).default_event_id(EventId::new(0)).create();
        let taken = || {
            listed(|note| {
                service.dynamic_config().list_notifiers(|port| {
                    note(port.notifier_name);
                    CallbackProgression::Continue
                });
            })
        };
        self.take_place(EVENT_PORTS, taken, make).map_err(|refused| match refused {
            Refused::NoPlace(limit) => self.full(channel, MessagingPattern::Event, limit, PlaceKind::Wakers),
            Refused::Error(error) => BusError::failed(channel, "make its event", &error),
        })
    }

    pub(crate) fn listener(&self, channel: &str) -> Result<Listener<ipc::Service>, BusError> {
        let service = self.open_event(channel)?;
        let make = || service.listener_builder().name(&self.port_name).create();
        let taken = || {
            listed(|note| {
                service.dynamic_config().list_listeners(|port| {
                    note(port.listener_name);
                    CallbackProgression::Continue
                });
            })
        };
        self.take_place(EVENT_PORTS, taken, make).map_err(|refused| match refused {
            Refused::NoPlace(limit) => self.full(channel, MessagingPattern::Event, limit, PlaceKind::Waiters),
            Refused::Error(error) => BusError::failed(channel, "be waited for", &error),
        })
    }

    /// That a channel, or the event or the requests of that name, has all the ports of this kind that it may have.
    pub(crate) fn full(&self, channel: &str, pattern: MessagingPattern, limit: usize, what: PlaceKind) -> BusError {
        BusError::Full { channel: channel.to_owned(), limit, what, holders: self.held_by(channel, pattern) }
    }

    /// A place may be held by a process that has died since this one joined.
    pub(crate) fn after_cleaning<R>(&self, make: impl Fn() -> R) -> R {
        self.clean();
        make()
    }

    /// Tells whoever waits for [`CHANNELS_EVENT`] that there is something new. Nobody may be there: that is no error.
    pub(crate) fn announce(&self) {
        if self.announcer.get().is_none()
            && let Ok(notifier) = self.notifier(CHANNELS_EVENT)
        {
            let _ = self.announcer.set(notifier);
        }
        if let Some(announcer) = self.announcer.get() {
            let _ = announcer.notify();
        }
    }

    /// Removes what processes that were killed have left, e.g. their places in channels. About a millisecond per dead process.
    pub fn clean(&self) {
        self.domain.before_cleaning();
        self.node.try_cleanup_dead_nodes();
    }
}

fn quality_mismatch(channel: String, why: &str, holders: String) -> BusError {
    BusError::QualityMismatch { channel, why: why.to_owned(), holders }
}

pub(crate) fn service_name(channel: &str) -> Result<ServiceName, BusError> {
    let bad = || BusError::ChannelName { name: channel.to_owned() };
    let word = |word: &str| {
        !word.is_empty()
            && word
                .bytes()
                .all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'_' || byte == b'-')
    };
    if channel.len() > 64 || !channel.split('/').all(word) {
        return Err(bad());
    }
    ServiceName::new(channel).map_err(|_| bad())
}

/// Each port takes about five descriptors; many systems begin with a limit of 1024.
fn raise_descriptor_limit() {
    let limit = getrlimit(Resource::Nofile);
    let wanted = limit.maximum.map_or(DESCRIPTORS, |most| most.min(DESCRIPTORS));
    if limit.current.is_some_and(|now| now < wanted) {
        let _ = setrlimit(Resource::Nofile, Rlimit { current: Some(wanted), maximum: limit.maximum });
    }
}
