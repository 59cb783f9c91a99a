//! The connection of a process to the bus, through which it opens channels.

use std::cell::{Cell, OnceCell, RefCell};
use std::collections::HashMap;
use std::fmt::Debug;
use std::time::Duration;

use iceoryx2::node::Node;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::{
    AttributeSpecifier, CallbackProgression, EventId, IceoryxSend, LogLevel, MessagingPattern, NodeBuilder, NodeName,
    NodeState, PortFactory as _, PortName, Service, ServiceName, SignalHandlingMode, ZeroCopySend, ipc, set_log_level,
};
use iceoryx2::service::ServiceDetails;
use iceoryx2::service::attribute::AttributeSet;
use iceoryx2::service::builder::event::Builder as EventBuilder;
use iceoryx2::service::builder::publish_subscribe::{Builder, PublishSubscribeCreateError, PublishSubscribeOpenError};
use iceoryx2::service::port_factory::publish_subscribe;
use messages::ros::Payload;
use messages::{Quality, quality_for};

use crate::clock::{SECOND_NS, now_ns, sleep_until};
use crate::definition;
use crate::domain::{NodeInfo, info_of};
use crate::error::{PlaceKind, THIS_PROCESS};
use crate::event::{self, Event};
use crate::limits::raise_descriptor_limit;
use crate::places::{Participant, Refused, collect_listed};
use crate::shm_sample::ShmSample;
use crate::{BusError, CHANNELS_EVENT, Domain};

/// Time to wait while another process creates a channel, ns: longer than the stalls of a virtual machine, and than the
/// age from which an incomplete object is abandoned.
const OPEN_TIMEOUT_NS: u64 = 4 * SECOND_NS;
/// Time for which joining is retried, ns: it fails for some milliseconds while another process sweeps.
const JOIN_TIMEOUT_NS: u64 = SECOND_NS;
/// Time between two attempts to join.
const JOIN_PAUSE: Duration = Duration::from_millis(20);
/// Number of clean-ups without an effect after which a place counts as taken, and the time between two. Another process
/// removes a dead one in about a millisecond, plus the stalls of the machine.
const IDLE_CLEANINGS: usize = 25;
const CLEANING_PAUSE: Duration = Duration::from_millis(20);
/// Largest number of notifiers, of listeners and of processes of a channel's event, which may have one notifier more
/// than publishers, that of a successor. That of new channels has a place for each process of the robot.
const EVENT_PORTS: usize = 64;
/// Largest event id: all notifiers have the one that iceoryx2 gives by default. A listener that wakes up clears a
/// counter for each possible one, which are 256 if another program has created the event.
const MOST_EVENT_ID: usize = 0;
/// Samples that a publisher loans at once: it fills one and sends it.
pub(crate) const LOANS: usize = 1;
/// Samples that a subscriber borrows at once: it copies one and returns it.
pub(crate) const BORROWS: usize = 1;

pub(crate) type PubSub<P> = publish_subscribe::PortFactory<ipc::Service, P, ()>;

/// The type of the samples of a channel.
pub(crate) struct SampleType<'a> {
    pub(crate) name: &'a str,
    pub(crate) schema: &'a str,
    pub(crate) quality: Quality,
}

/// An open channel, whose attributes have the schema text.
pub(crate) trait WithAttributes {
    fn stored_attributes(&self) -> &AttributeSet;
}

impl<P: IceoryxSend + Debug + ?Sized, H: ZeroCopySend + Debug> WithAttributes
    for publish_subscribe::PortFactory<ipc::Service, P, H>
{
    fn stored_attributes(&self) -> &AttributeSet {
        self.attributes()
    }
}

/// The connection of a process to the bus of its robot; creates ports.
#[derive(Debug)]
pub struct Bus {
    pub(crate) node: Node<ipc::Service>,
    domain: Domain,
    process: String,
    pub(crate) party: Participant,
    pub(crate) port_name: PortName,
    /// Processes for which this one reserves places in what it creates.
    pub(crate) processes: usize,
    /// Time to wait while another process creates a channel, ns.
    patience_ns: Cell<u64>,
    /// Announces new channels; the error if all places are taken, which stays so.
    announcer: OnceCell<Result<Notifier<ipc::Service>, BusError>>,
    /// Continuations of long schema texts by type name, open as long as this value exists.
    continuations: RefCell<HashMap<String, Vec<Event>>>,
}

impl Bus {
    /// Joins a domain under a process name as one of the robot's processes. Removes the objects of killed processes,
    /// unless another process owns the domain and does so ([`Domain::claim`]).
    ///
    /// # Errors
    /// [`BusError::Join`] if the name is longer than 63 bytes or the folder cannot be used, [`BusError::NoMemory`] if
    /// there is not enough shared memory.
    pub fn join(domain: &Domain, process: &str) -> Result<Self, BusError> {
        Self::join_as(domain, process, Participant::Member)
    }

    /// As [`Bus::join`], as a participant of this kind, which leaves places to more important kinds.
    ///
    /// # Errors
    /// As [`Bus::join`].
    pub fn join_as(domain: &Domain, process: &str, party: Participant) -> Result<Self, BusError> {
        let failed =
            |why: String| BusError::Join { process: process.to_owned(), domain: domain.name().to_owned(), why };
        set_log_level(LogLevel::Fatal); // iceoryx2 also returns its problems as errors
        let processes = domain.processes();
        raise_descriptor_limit(processes);
        let port_name = party
            .port_name(process)
            .map_err(|_| failed("its name is longer than 63 bytes or not plain ASCII".to_owned()))?;
        crate::memory::need(0, party, process)?;
        if domain.lies_elsewhere() {
            return Err(failed(
                "its shared memory is in the /dev/shm of its service; use `nims-at NAME ..`".to_owned(),
            ));
        }
        let node_name = NodeName::new(process).map_err(|error| failed(error.to_string()))?;
        let give_up = now_ns() + JOIN_TIMEOUT_NS;
        let cleans = !domain.has_other_owner();
        let mut config = domain.config().clone();
        config.global.node.cleanup_dead_nodes_on_creation = cleans;
        let node = loop {
            if cleans {
                domain.before_cleaning();
            }
            let node = NodeBuilder::new()
                .name(&node_name)
                .config(&config)
                .signal_handling_mode(SignalHandlingMode::Disabled)
                .create::<ipc::Service>();
            match node {
                Ok(node) => break node,
                // A supervisor that is just starting may be removing the objects of a former run, including folders.
                Err(_) if now_ns() < give_up => std::thread::sleep(JOIN_PAUSE),
                Err(error) => {
                    // Report exhausted memory as the cause, if it is.
                    crate::memory::need(0, party, process)?;
                    let place = domain.root().display();
                    return Err(failed(format!("shared memory cannot be set up in {place} ({error:?})")));
                }
            }
        };
        if cleans {
            // The owner has done so when it joined.
            domain.restrict_access();
        }
        let (announcer, continuations) = (OnceCell::new(), RefCell::default());
        Ok(Self {
            node,
            domain: domain.clone(),
            process: process.to_owned(),
            party,
            port_name,
            processes,
            patience_ns: Cell::new(OPEN_TIMEOUT_NS),
            announcer,
            continuations,
        })
    }

    /// Returns the domain.
    #[must_use]
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// Returns the process name under which the domain was joined.
    #[must_use]
    pub fn process(&self) -> &str {
        &self.process
    }

    /// Sets for how long opening a channel waits while another process creates it; 4 s if it is not set. Afterwards the
    /// channel counts as broken. A process that answers within milliseconds sets 0, and tries again later: an attempt
    /// itself takes up to 0.2 s.
    pub fn set_patience(&self, patience: Duration) {
        self.patience_ns.set(u64::try_from(patience.as_nanos()).unwrap_or(u64::MAX));
    }

    /// The instant at which an attempt to open that begins now is given up, ns.
    pub(crate) fn give_up_ns(&self) -> u64 {
        now_ns().saturating_add(self.patience_ns.get())
    }

    /// Opens or creates a channel with the quality of service of the channel table, and stores the schema text with it.
    pub(crate) fn open_typed<T: Payload>(&self, channel: &str) -> Result<PubSub<ShmSample<T>>, BusError> {
        let name = service_name(channel)?;
        let quality = quality_for(channel, size_of::<T>());
        let builder = || shared(self.node.service_builder(&name).publish_subscribe::<ShmSample<T>>());
        self.open_or_create(
            channel,
            SampleType { name: T::type_name(), schema: T::schema(), quality },
            || builder().open(),
            |attributes| sized(builder(), &quality).create_with_attributes(attributes),
        )
    }

    /// Opens or creates a channel by these functions, and stores the schema text with it.
    pub(crate) fn open_or_create<S: WithAttributes>(
        &self,
        channel: &str,
        sample: SampleType<'_>,
        open: impl Fn() -> Result<S, PublishSubscribeOpenError>,
        create: impl Fn(&AttributeSpecifier) -> Result<S, PublishSubscribeCreateError>,
    ) -> Result<S, BusError> {
        self.need(0, channel)?;
        let SampleType { name: type_name, schema, quality } = sample;
        let text = definition::stored(type_name, schema);
        let attributes = definition::attributes(type_name, &text)?;
        if !self.continuations.borrow().contains_key(type_name) {
            let continuations = self.hold_text(&text)?;
            self.continuations.borrow_mut().insert(type_name.to_owned(), continuations);
        }
        let give_up = self.give_up_ns();
        let mut cleaned = false;
        loop {
            // Open first: a peer in another language, or a tunnel, may have created the channel without the schema
            // text. Only the type name is compared.
            let error = match open() {
                Ok(service) => {
                    let others = definition::hold_others(&self.node, &text, service.stored_attributes());
                    self.continuations.borrow_mut().entry(type_name.to_owned()).or_default().extend(others);
                    return Ok(service);
                }
                Err(error) => error,
            };
            let temporary = match error {
                PublishSubscribeOpenError::DoesNotExist => match create(&attributes) {
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
            if !temporary || now_ns() > give_up {
                return Err(self.explain(channel, error, type_name, &quality));
            }
            self.domain.remove_half_made();
            sleep_until(now_ns() + 2_000_000);
        }
    }

    /// Creates or opens the continuations of a schema text, after a clean-up if all places are taken.
    fn hold_text(&self, text: &str) -> Result<Vec<Event>, BusError> {
        let held = || definition::continuations(&self.node, &self.domain, text, self.processes, self.give_up_ns());
        match held() {
            Err(BusError::Full { .. }) => self.after_cleaning(held),
            held => held,
        }
    }

    fn explain(&self, channel: &str, error: PublishSubscribeOpenError, wanted: &str, quality: &Quality) -> BusError {
        use PublishSubscribeOpenError as E;
        let channel_name = channel.to_owned();
        let holders = self.holders_of(channel, MessagingPattern::PublishSubscribe);
        match error {
            E::IncompatibleTypes => {
                let found = self.type_of(channel);
                BusError::TypeMismatch { channel: channel_name, found, wanted: wanted.to_owned(), holders }
            }
            E::ExceedsMaxNumberOfNodes => {
                BusError::Full { channel: channel_name, limit: quality.nodes, what: PlaceKind::Processes, holders }
            }
            E::DoesNotSupportRequestedMinSubscriberBorrowedSamples | E::IncompatibleOverflowBehavior => {
                quality_mismatch(channel_name, "it was not created by this project's bus", holders)
            }
            E::VersionMismatch => {
                quality_mismatch(channel_name, "it was created with another version of iceoryx2", holders)
            }
            other => BusError::failed(channel, "be opened", &other),
        }
    }

    pub(crate) fn details(&self, channel: &str, pattern: MessagingPattern) -> Option<ServiceDetails<ipc::Service>> {
        let name = ServiceName::new(channel).ok()?;
        ipc::Service::details(&name, self.domain.config(), pattern).ok().flatten()
    }

    /// Returns the type name of a channel.
    fn type_of(&self, channel: &str) -> String {
        self.details(channel, MessagingPattern::PublishSubscribe).map_or_else(
            || "nothing".to_owned(),
            |details| details.static_details.publish_subscribe().message_type_details().payload.type_name().to_string(),
        )
    }

    /// Returns the processes that have a channel, event or requests of that name open, in words; empty if unknown.
    fn holders_of(&self, channel: &str, pattern: MessagingPattern) -> String {
        let details = self.details(channel, pattern);
        let Some(dynamic) = details.and_then(|details| details.dynamic_details) else { return String::new() };
        let mut holders = names_of(&dynamic.nodes);
        holders.dedup();
        if holders.is_empty() { "a process that has died".to_owned() } else { holders.join(", ") }
    }

    /// Opens or creates the event of a channel, after a clean-up if all places are taken.
    pub(crate) fn open_event(&self, channel: &str) -> Result<Event, BusError> {
        let name = service_name(channel)?;
        self.need(0, channel)?;
        let give_up = self.give_up_ns();
        let places = if channel == CHANNELS_EVENT { self.processes } else { EVENT_PORTS };
        let builder = || self.node.service_builder(&name).event();
        let sized = |event: EventBuilder<ipc::Service>| {
            event.event_id_max_value(MOST_EVENT_ID).max_notifiers(places).max_listeners(EVENT_PORTS).max_nodes(places)
        };
        let opened = || event::open_or_create(&self.domain, channel, builder, |event| sized(event).create(), give_up);
        if let Some(service) = opened()? {
            return Ok(service);
        }
        self.clean();
        if let Some(service) = opened()? {
            return Ok(service);
        }
        let found = self.details(channel, MessagingPattern::Event);
        let limit = found.map_or(places, |found| found.static_details.event().max_nodes());
        Err(self.full(channel, MessagingPattern::Event, limit, of_robot(channel, PlaceKind::Processes)))
    }

    pub(crate) fn notifier(&self, channel: &str) -> Result<Notifier<ipc::Service>, BusError> {
        let service = self.open_event(channel)?;
        let places = service.static_config().max_notifiers();
        let make = || service.notifier_builder().name(&self.port_name).default_event_id(EventId::new(0)).create();
        let taken = || {
            collect_listed(|note| {
                service.dynamic_config().list_notifiers(|port| {
                    note(port.notifier_name);
                    CallbackProgression::Continue
                });
            })
        };
        self.take_place(places, taken, make).map_err(|refused| match refused {
            Refused::NoPlace(limit) => {
                self.full(channel, MessagingPattern::Event, limit, of_robot(channel, PlaceKind::Wakers))
            }
            Refused::Error(error) => BusError::failed(channel, "make its event", &error),
        })
    }

    pub(crate) fn listener(&self, channel: &str) -> Result<Listener<ipc::Service>, BusError> {
        let service = self.open_event(channel)?;
        let make = || service.listener_builder().name(&self.port_name).create();
        let taken = || {
            collect_listed(|note| {
                service.dynamic_config().list_listeners(|port| {
                    note(port.listener_name);
                    CallbackProgression::Continue
                });
            })
        };
        let places = service.static_config().max_listeners();
        self.take_place(places, taken, make).map_err(|refused| match refused {
            Refused::NoPlace(limit) => self.full(channel, MessagingPattern::Event, limit, PlaceKind::Waiters),
            Refused::Error(error) => BusError::failed(channel, "be waited for", &error),
        })
    }

    /// Returns the error for a channel, event or requests without a free place of this kind.
    pub(crate) fn full(&self, channel: &str, pattern: MessagingPattern, limit: usize, what: PlaceKind) -> BusError {
        // A robot has too many processes for a sentence.
        let is_all = what == PlaceKind::RobotProcesses;
        let holders = if is_all { String::new() } else { self.holders_of(channel, pattern) };
        BusError::Full { channel: channel.to_owned(), limit, what, holders }
    }

    /// Calls `make` after a clean-up, because a process that has died since this one joined may hold a place. Only one
    /// process at a time can clean up: if another one has begun, this one waits for it and tries again, as long as dead
    /// processes disappear.
    pub(crate) fn after_cleaning<R, E>(&self, make: impl Fn() -> Result<R, E>) -> Result<R, E> {
        let (mut least, mut idle) = (usize::MAX, 0);
        loop {
            let dead = self.domain.dead();
            idle = if dead < least { 0 } else { idle + 1 };
            least = least.min(dead);
            self.clean();
            let made = make();
            if made.is_ok() || dead == 0 || idle >= IDLE_CLEANINGS {
                return made;
            }
            std::thread::sleep(CLEANING_PAUSE);
        }
    }

    /// Raises [`CHANNELS_EVENT`]. It is no error if no process waits for it, or if all its places are taken: who looks
    /// for channels also looks without it, once a second.
    pub(crate) fn announce(&self) {
        if self.announcer.get().is_none() {
            match self.notifier(CHANNELS_EVENT) {
                Ok(notifier) => drop(self.announcer.set(Ok(notifier))),
                Err(error @ BusError::Full { .. }) => drop(self.announcer.set(Err(error))),
                Err(_) => {}
            }
        }
        if let Some(Ok(announcer)) = self.announcer.get() {
            let _ = announcer.notify();
        }
    }

    /// Returns why this process cannot announce its channels, if so: the robot has as many processes as it has places
    /// for. Its channels work, and are found up to a second later.
    #[must_use]
    pub fn unannounced(&self) -> Option<&BusError> {
        self.announcer.get()?.as_ref().err()
    }

    /// Removes the objects of killed processes, e.g. their places in channels. Takes about a millisecond per process.
    pub fn clean(&self) {
        self.domain.before_cleaning();
        self.node.try_cleanup_dead_nodes();
    }
}

/// The living ones of these processes, in words.
pub(crate) fn names_of(nodes: &[NodeState<ipc::Service>]) -> Vec<String> {
    let living =
        nodes.iter().filter_map(|node| if let NodeState::Alive(node) = node { Some(info_of(node)) } else { None });
    let name = |info: NodeInfo| format!("{} (process {})", info.name, info.pid);
    living.map(|info| if info.pid == std::process::id() { THIS_PROCESS.to_owned() } else { name(info) }).collect()
}

/// The settings with which every process opens a channel.
pub(crate) fn shared<P: IceoryxSend + Debug + ?Sized, H: ZeroCopySend + Debug>(
    builder: Builder<P, H, ipc::Service>,
) -> Builder<P, H, ipc::Service> {
    builder.enable_safe_overflow(true).subscriber_max_borrowed_samples(BORROWS)
}

/// The settings with which a process creates a channel.
pub(crate) fn sized<P: IceoryxSend + Debug + ?Sized, H: ZeroCopySend + Debug>(
    builder: Builder<P, H, ipc::Service>,
    quality: &Quality,
) -> Builder<P, H, ipc::Service> {
    builder
        .subscriber_max_buffer_size(quality.buffer)
        .history_size(quality.history)
        .max_publishers(quality.publishers)
        .max_subscribers(quality.subscribers)
        .max_nodes(quality.nodes)
}

/// The kind of the places of an event: every process of a robot has one in that of new channels.
fn of_robot(channel: &str, what: PlaceKind) -> PlaceKind {
    if channel == CHANNELS_EVENT { PlaceKind::RobotProcesses } else { what }
}

fn quality_mismatch(channel: String, why: &str, holders: String) -> BusError {
    BusError::QualityMismatch { channel, why: why.to_owned(), holders }
}

/// Returns whether a channel can have this name: at most 64 of a-z, 0-9, `_`, `-`, in words between `/`.
#[must_use]
pub fn is_channel_name(name: &str) -> bool {
    service_name(name).is_ok()
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
