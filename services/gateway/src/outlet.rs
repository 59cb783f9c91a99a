//! What sensors publish, on a thread of its own with its own place on the bus.
//!
//! To create a channel can take seconds: memory is allocated, and an object that another process left half made is
//! waited for. A stop must not wait for it.

use crate::events::{OwnMessage, Ticket};
use crate::lane::failed;
use crate::own_channels::OwnChannels;
use bus::{Bus, BusError, Domain, Participant, Publisher};
use messages::{Header, Reading, RequestAnswer};
use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, Sender, SyncSender, TrySendError, channel, sync_channel};
use std::thread::JoinHandle;

/// Largest number of waiting samples, which have at most 64 KiB each.
const WAITING: usize = 64;
/// Time between two attempts to create the channel of a sensor, or to join the robot, ns.
const AGAIN_NS: u64 = 1_000_000_000;

/// What a sensor has called for.
#[derive(Debug)]
pub(crate) enum Delivered {
    /// A reading of a plug-in.
    Reading(String, Box<Reading>),
    /// The channel of a declared message.
    Declaration(OwnMessage),
    /// A sample of a declared message, with its header.
    Sample(OwnMessage, Header, Vec<u8>),
}

/// What came of it: nothing, or why it was refused.
pub(crate) type Published = Result<(), Box<RequestAnswer>>;

/// The thread, as its owner sees it.
pub(crate) struct Outlet {
    jobs: SyncSender<(Ticket, Delivered)>,
    results: Receiver<(Ticket, Published)>,
    /// Those that wait for the thread.
    waiting: Vec<Ticket>,
    thread: JoinHandle<()>,
}

impl Outlet {
    /// Starts the thread, which joins the robot of this domain under this name.
    pub(crate) fn start(domain: &Domain, name: &'static str) -> std::io::Result<Self> {
        let (jobs, todo) = sync_channel(WAITING);
        let (done, results) = channel();
        let domain = domain.clone();
        let thread = std::thread::Builder::new().name("outlet".to_owned()).spawn(move || {
            work(&domain, name, &todo, &done);
        })?;
        Ok(Self { jobs, results, waiting: Vec::new(), thread })
    }

    /// Passes something on; false if too much waits.
    pub(crate) fn begin(&mut self, ticket: Ticket, delivered: Delivered) -> bool {
        match self.jobs.try_send((ticket, delivered)) {
            Ok(()) => self.waiting.push(ticket),
            Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => return false,
        }
        true
    }

    /// Returns the next result, if there is one.
    pub(crate) fn poll(&mut self) -> Option<(Ticket, Published)> {
        let (ticket, published) = self.results.try_recv().ok()?;
        self.waiting.retain(|one| *one != ticket);
        Some((ticket, published))
    }

    /// Returns whether something waits for the thread.
    pub(crate) fn is_busy(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// Lets the thread leave the robot when it has done what it has; returns it, and what has no result.
    pub(crate) fn leave(self) -> (JoinHandle<()>, Vec<Ticket>) {
        (self.thread, self.waiting)
    }
}

/// The channels of the sensors, and the place on the bus by which they are created.
struct Channels {
    guests: Bus,
    readings: BTreeMap<String, SensorChannel>,
    declared: OwnChannels,
}

/// The channel of a plug-in; or until when it is not tried to create it again, ns, with the reason.
type SensorChannel = Result<Publisher<Reading>, (u64, Box<RequestAnswer>)>;

fn work(domain: &Domain, name: &str, jobs: &Receiver<(Ticket, Delivered)>, done: &Sender<(Ticket, Published)>) {
    // As a guest: it leaves the places and the memory that the robot's own processes need.
    let join = || Bus::join_as(domain, name, Participant::Guest);
    let mut channels: Option<Channels> = None;
    let mut refused: Option<(u64, Box<RequestAnswer>)> = None;
    while let Ok((ticket, delivered)) = jobs.recv() {
        let now_ns = bus::clock::now_ns();
        if channels.is_none() && refused.as_ref().is_none_or(|(again_ns, _)| now_ns >= *again_ns) {
            match join() {
                Ok(guests) => channels = Some(Channels::new(guests)),
                Err(error) => refused = Some((now_ns + AGAIN_NS, failed(&error))),
            }
        }
        let published = match (&mut channels, &refused) {
            (Some(channels), _) => channels.publish(delivered, now_ns),
            (None, Some((_, answer))) => Err(answer.clone()),
            (None, None) => Ok(()),
        };
        if done.send((ticket, published)).is_err() {
            return;
        }
    }
}

impl Channels {
    fn new(guests: Bus) -> Self {
        Self { guests, readings: BTreeMap::new(), declared: OwnChannels::default() }
    }

    fn publish(&mut self, delivered: Delivered, now_ns: u64) -> Published {
        let sent = |result: Result<(), BusError>| result.map_err(|error| failed(&error));
        match delivered {
            Delivered::Reading(sensor, reading) => self.reading(sensor, *reading, now_ns),
            Delivered::Declaration(sensor) => self.declared.open(&self.guests, &sensor, now_ns).map(|_| ()),
            Delivered::Sample(sensor, header, sample) => {
                let publisher = self.declared.open(&self.guests, &sensor, now_ns)?;
                sent(publisher.send(header, &sample))
            }
        }
    }

    /// Publishes a reading of a plug-in. Its channel is created with the first one, and stays as long as the robot:
    /// connections that come and go make no further channels.
    fn reading(&mut self, sensor: String, mut reading: Reading, now_ns: u64) -> Published {
        let created = self.readings.get(&sensor);
        if created.is_none_or(|created| created.as_ref().is_err_and(|(again_ns, _)| now_ns >= *again_ns)) {
            let publisher = self.guests.publisher::<Reading>(&format!("sensor/{sensor}"));
            let publisher = publisher.map_err(|error| (now_ns + AGAIN_NS, failed(&error)));
            self.readings.insert(sensor.clone(), publisher);
        }
        match self.readings.get_mut(&sensor) {
            Some(Ok(publisher)) => publisher.send(&mut reading).map(|_| ()).map_err(|error| failed(&error)),
            Some(Err((_, answer))) => Err(answer.clone()),
            None => Ok(()),
        }
    }
}
