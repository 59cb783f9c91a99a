//! What sensors publish, on a thread of its own with its own place on the bus.
//!
//! To create a channel can take seconds: memory is allocated, and an object that another process left half made is
//! waited for. A stop must not wait for it.

use crate::events::{OwnMessage, Ticket};
use crate::lane::failed;
use crate::lasting::Lasting;
use crate::own_channels::OwnChannels;
use bus::{Bus, Domain, Participant, Publisher};
use messages::{Header, Reading, RequestAnswer};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, SyncSender, TrySendError, channel, sync_channel};
use std::thread::JoinHandle;

/// Largest number of waiting samples, which have at most 64 KiB each.
const WAITING: usize = 64;

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
    /// Set when the robot is left.
    leaves: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl Outlet {
    /// Starts the thread, which joins the robot of this domain under this name.
    pub(crate) fn start(domain: &Domain, name: &'static str) -> std::io::Result<Self> {
        let (jobs, todo) = sync_channel(WAITING);
        let (done, results) = channel();
        let domain = domain.clone();
        let leaves = Arc::<AtomicBool>::default();
        let left = Arc::clone(&leaves);
        let thread = std::thread::Builder::new().name("outlet".to_owned()).spawn(move || {
            work(&domain, name, &left, (&todo, &done));
        })?;
        Ok(Self { jobs, results, waiting: Vec::new(), leaves, thread })
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

    /// Lets the thread leave the robot when it has done what it is at; returns it, and what has no result.
    pub(crate) fn leave(self) -> (JoinHandle<()>, Vec<Ticket>) {
        self.leaves.store(true, Ordering::Relaxed);
        (self.thread, self.waiting)
    }
}

/// The two ends that the thread has.
type Ends<'a> = (&'a Receiver<(Ticket, Delivered)>, &'a Sender<(Ticket, Published)>);

fn work(domain: &Domain, name: &str, leaves: &AtomicBool, (jobs, done): Ends<'_>) {
    // As a guest: it leaves the places and the memory that the robot's own processes need.
    let join = || Bus::join_as(domain, name, Participant::Guest);
    let (mut guests, mut channels) = (Lasting::default(), Channels::default());
    while let Ok((ticket, delivered)) = jobs.recv() {
        // Each of those that wait can take seconds, and its sensor is told that the robot has ended.
        if leaves.load(Ordering::Relaxed) {
            return;
        }
        let published = guests.get(join).and_then(|guests| channels.publish(guests, delivered));
        if done.send((ticket, published)).is_err() {
            return;
        }
    }
}

/// The channels of the sensors.
#[derive(Default)]
struct Channels {
    readings: BTreeMap<String, Lasting<Publisher<Reading>>>,
    declared: OwnChannels,
}

impl Channels {
    /// Publishes what a sensor has called for; `guests`: the place on the bus by which channels are created.
    fn publish(&mut self, guests: &Bus, delivered: Delivered) -> Published {
        match delivered {
            Delivered::Reading(sensor, mut reading) => {
                let channel = format!("sensor/{sensor}");
                // Its channel is created with the first one, and stays as long as the robot: connections that come and
                // go make no further channels.
                let readings = self.readings.entry(sensor).or_default();
                let publisher = readings.get(|| guests.publisher::<Reading>(&channel))?;
                publisher.send(&mut reading).map(|_| ()).map_err(|error| failed(&error))
            }
            Delivered::Declaration(sensor) => self.declared.open(guests, &sensor).map(|_| ()),
            Delivered::Sample(sensor, header, sample) => {
                let publisher = self.declared.open(guests, &sensor)?;
                publisher.send(header, &sample).map_err(|error| failed(&error))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_waits_when_the_robot_is_left_is_not_begun() {
        let domain = Domain::for_test();
        let reading = || Delivered::Reading("air".to_owned(), Box::default());
        for (leaves, results) in [(true, 0), (false, 3)] {
            let ((jobs, todo), (done, published)) = (sync_channel(WAITING), channel());
            (0..3).for_each(|ticket| jobs.send((ticket, reading())).unwrap());
            // Without its owner the thread ends when it has done everything.
            let _kept = leaves.then_some(jobs);
            work(&domain, "gateway", &AtomicBool::new(leaves), (&todo, &done));
            assert_eq!(published.try_iter().count(), results);
        }
    }
}
