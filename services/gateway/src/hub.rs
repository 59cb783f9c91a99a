//! Subscriptions: one tap of each channel for all clients, and the newest samples for clients that come later.

use crate::events::ClientId;
use bus::{Bus, BusError, ChannelInfo, ChannelWatch, Tap};
use gateway_protocol::Reply;
use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::rc::Rc;

/// Time between two looks for new channels, ns. A name that does not exist costs nothing else.
const LOOK_NS: u64 = 50_000_000;
/// Time between two attempts to subscribe to a channel without a free place, ns.
const AGAIN_NS: u64 = 1_000_000_000;
/// Time for which a channel without a client stays subscribed, ns: to subscribe costs its publisher a moment.
const KEPT_NS: u64 = 10_000_000_000;
/// Largest number of samples of a channel that one poll takes, so that no channel delays the rest.
const AT_ONCE: usize = 64;
/// Bytes of samples of a channel after which a poll takes no more, because all of them are in memory at once.
const AT_ONCE_BYTES: usize = 4 << 20;

/// What is delivered to a client.
#[derive(Debug)]
pub(crate) enum Delivery {
    /// The definition of a channel.
    Definition(ClientId, Reply),
    /// A sample: the client, the subscription, the bytes, how many the gateway itself has missed, and the number that
    /// the subscription has not got.
    Sample(ClientId, u64, Rc<[u8]>, u64, Rc<Cell<u64>>),
}

/// A subscription of a client.
#[derive(Debug)]
struct Subscription {
    client: ClientId,
    id: u64,
    /// Time between two samples, ns; 0: every sample.
    every_ns: u64,
    due_ns: u64,
    /// The newest sample that came too early.
    early: Option<Rc<[u8]>>,
    defined: bool,
    dropped: Rc<Cell<u64>>,
}

/// A channel that clients have subscribed to.
#[derive(Default)]
struct Channel {
    tap: Option<Tap>,
    subscriptions: Vec<Subscription>,
    /// The newest samples, as many as a late subscriber of the bus gets.
    recent: VecDeque<Rc<[u8]>>,
    late: usize,
    missed: u64,
    again_ns: u64,
    unused_ns: u64,
}

/// All subscriptions.
#[derive(Default)]
pub(crate) struct Hub {
    channels: BTreeMap<String, Channel>,
    watch: ChannelWatch,
    /// Channels that exist.
    known: BTreeSet<String>,
    look_ns: u64,
}

impl Hub {
    /// Subscribes a client.
    pub(crate) fn subscribe(&mut self, client: ClientId, id: u64, channel: String, rate_hz: Option<f64>) {
        let every_ns = rate_hz.map_or(0, |rate_hz| (1e9 / rate_hz) as u64);
        let late = messages::quality_of(&channel).late;
        let channel = self.channels.entry(channel).or_default();
        channel.late = late;
        channel.subscriptions.push(Subscription {
            client,
            id,
            every_ns,
            due_ns: 0,
            early: None,
            defined: false,
            dropped: Rc::default(),
        });
    }

    /// Ends a subscription.
    pub(crate) fn unsubscribe(&mut self, client: ClientId, id: u64) {
        for channel in self.channels.values_mut() {
            channel.subscriptions.retain(|one| (one.client, one.id) != (client, id));
        }
        self.forget_unused();
    }

    /// Ends all subscriptions of a client.
    pub(crate) fn remove(&mut self, client: ClientId) {
        for channel in self.channels.values_mut() {
            channel.subscriptions.retain(|one| one.client != client);
        }
        self.forget_unused();
    }

    /// Forgets names without a channel, also while no robot runs and nothing is polled.
    fn forget_unused(&mut self) {
        self.channels.retain(|_, channel| channel.tap.is_some() || !channel.subscriptions.is_empty());
    }

    /// Returns whether there is a subscription.
    pub(crate) fn is_used(&self) -> bool {
        self.channels.values().any(|channel| !channel.subscriptions.is_empty())
    }

    /// The robot has ended: its channels come again with the next one.
    pub(crate) fn detach(&mut self) {
        (self.watch, self.look_ns) = (ChannelWatch::new(), 0);
        self.known.clear();
        for channel in self.channels.values_mut() {
            channel.detach();
        }
        self.channels.retain(|_, channel| !channel.subscriptions.is_empty());
    }

    /// Receives what has arrived.
    ///
    /// # Errors
    /// Shared memory cannot be read.
    pub(crate) fn poll(&mut self, bus: &Bus, now_ns: u64) -> Result<Vec<Delivery>, BusError> {
        let mut deliveries = Vec::new();
        if now_ns >= self.look_ns && self.channels.values().any(|channel| channel.tap.is_none()) {
            self.look_ns = now_ns + LOOK_NS;
            self.known.extend(self.watch.new_channels(bus)?.into_iter().map(|channel| channel.name));
        }
        let known = &self.known;
        for (name, channel) in self.channels.iter_mut().filter(|(name, _)| known.contains(*name)) {
            channel.poll(bus, name, now_ns, &mut deliveries)?;
        }
        self.channels.retain(|_, channel| {
            if channel.subscriptions.is_empty() {
                channel.unused_ns = if channel.unused_ns == 0 { now_ns } else { channel.unused_ns };
                return now_ns < channel.unused_ns + KEPT_NS;
            }
            channel.unused_ns = 0;
            true
        });
        Ok(deliveries)
    }
}

impl Channel {
    fn detach(&mut self) {
        (self.tap, self.missed) = (None, 0);
        self.recent.clear();
        for one in &mut self.subscriptions {
            (one.defined, one.early) = (false, None);
        }
    }

    fn poll(&mut self, bus: &Bus, name: &str, now_ns: u64, out: &mut Vec<Delivery>) -> Result<(), BusError> {
        if self.tap.is_none() && now_ns >= self.again_ns && !self.subscriptions.is_empty() {
            self.again_ns = now_ns + AGAIN_NS;
            // Without a free place it is tried again.
            self.tap = bus.tap(name).ok();
        }
        let Some(tap) = &mut self.tap else { return Ok(()) };
        let info = tap.info().clone();
        for one in self.subscriptions.iter_mut().filter(|one| !one.defined) {
            one.defined = true;
            out.push(Delivery::Definition(one.client, definition(one.id, &info)));
            for sample in &self.recent {
                out.push(one.delivery(Rc::clone(sample), self.missed));
            }
        }
        let mut bytes = 0;
        for _ in 0..AT_ONCE {
            if bytes >= AT_ONCE_BYTES {
                break;
            }
            let Some((sample, missing)) = tap.receive(|raw| (Rc::<[u8]>::from(raw.bytes), raw.missing))? else { break };
            self.missed += missing;
            bytes += sample.len();
            for one in &mut self.subscriptions {
                one.take(&sample, self.missed, now_ns, out);
            }
            if self.recent.len() >= self.late.max(1) {
                self.recent.pop_front();
            }
            self.recent.push_back(sample);
        }
        for one in &mut self.subscriptions {
            one.release(self.missed, now_ns, out);
        }
        Ok(())
    }
}

impl Subscription {
    fn delivery(&self, sample: Rc<[u8]>, missed: u64) -> Delivery {
        Delivery::Sample(self.client, self.id, sample, missed, Rc::clone(&self.dropped))
    }

    fn take(&mut self, sample: &Rc<[u8]>, missed: u64, now_ns: u64, out: &mut Vec<Delivery>) {
        if self.every_ns == 0 || now_ns >= self.due_ns {
            self.due_ns = now_ns + self.every_ns;
            // An older one that still waits is overtaken.
            if self.early.take().is_some() {
                count(&self.dropped);
            }
            out.push(self.delivery(Rc::clone(sample), missed));
        } else if self.early.replace(Rc::clone(sample)).is_some() {
            count(&self.dropped);
        }
    }

    /// The newest sample is sent when its time has come, so that the last one of a burst always arrives.
    fn release(&mut self, missed: u64, now_ns: u64, out: &mut Vec<Delivery>) {
        if now_ns >= self.due_ns
            && let Some(sample) = self.early.take()
        {
            self.due_ns = now_ns + self.every_ns;
            out.push(self.delivery(sample, missed));
        }
    }
}

/// Counts a sample that a subscription does not get.
pub(crate) fn count(dropped: &Cell<u64>) {
    dropped.set(dropped.get() + 1);
}

fn definition(id: u64, info: &ChannelInfo) -> Reply {
    let (type_name, schema) = (info.type_name.clone(), info.schema.clone());
    Reply::Definition { id, type_name, size_bytes: info.size, schema }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bus::Domain;
    use bus::clock::now_ns;
    use messages::{MotorState, PlanStatus};

    fn bytes_of(deliveries: &[Delivery]) -> Vec<(ClientId, u64)> {
        let sample = |delivery: &Delivery| match delivery {
            Delivery::Sample(client, id, ..) => Some((*client, *id)),
            Delivery::Definition(..) => None,
        };
        deliveries.iter().filter_map(sample).collect()
    }

    #[test]
    fn a_channel_that_comes_later_is_subscribed_to_and_defined_first() {
        let domain = Domain::for_test();
        let bus = Bus::join(&domain, "gateway").unwrap();
        let mut hub = Hub::default();
        hub.subscribe(1, 7, "plan/status".to_owned(), None);
        assert!(hub.poll(&bus, 1).unwrap().is_empty());
        let robot = Bus::join(&domain, "planner").unwrap();
        let mut plans = robot.publisher::<PlanStatus>("plan/status").unwrap();
        plans.send(&mut PlanStatus::default()).unwrap();
        let first = hub.poll(&bus, 1 + LOOK_NS).unwrap();
        assert!(matches!(first[..], [Delivery::Definition(1, Reply::Definition { id: 7, .. })]), "{first:?}");
        // The history comes with the next sample.
        plans.send(&mut PlanStatus::default()).unwrap();
        assert_eq!(bytes_of(&hub.poll(&bus, 1 + LOOK_NS).unwrap()), [(1, 7); 2]);
        // A client that comes later gets the samples that a late subscriber of the bus gets.
        hub.subscribe(2, 3, "plan/status".to_owned(), None);
        let second = hub.poll(&bus, 2 + LOOK_NS).unwrap();
        assert!(matches!(second.first(), Some(Delivery::Definition(2, _))), "{second:?}");
        assert_eq!(bytes_of(&second), [(2, 3); 2]);
        hub.remove(1);
        hub.unsubscribe(2, 3);
        assert!(!hub.is_used());
    }

    #[test]
    fn a_rate_leaves_out_samples_and_counts_them_but_never_the_last_one() {
        let domain = Domain::for_test();
        let bus = Bus::join(&domain, "gateway").unwrap();
        let robot = Bus::join(&domain, "motor-io").unwrap();
        let mut states = robot.publisher::<MotorState>("motor/state").unwrap();
        let mut hub = Hub::default();
        hub.subscribe(1, 1, "motor/state".to_owned(), Some(10.0));
        hub.poll(&bus, now_ns()).unwrap();
        let start = 1_000_000_000_000;
        for cycle in 0..20_u8 {
            states.send(&mut MotorState { cable_count: cycle, ..MotorState::default() }).unwrap();
        }
        let first = hub.poll(&bus, start).unwrap();
        assert_eq!(bytes_of(&first).len(), 1);
        let [.., Delivery::Sample(.., dropped)] = &first[..] else { panic!("{first:?}") };
        assert_eq!(dropped.get(), 18);
        assert!(bytes_of(&hub.poll(&bus, start + 99_000_000).unwrap()).is_empty());
        let last = hub.poll(&bus, start + 100_000_000).unwrap();
        let [Delivery::Sample(_, _, bytes, 0, _)] = &last[..] else { panic!("{last:?}") };
        let last: MotorState = bytemuck::pod_read_unaligned(bytes);
        assert_eq!(last.cable_count, 19);
    }
}
