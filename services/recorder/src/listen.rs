//! Subscriptions to every channel of the domain.

use std::any::Any;

use bus::{Bus, BusError, ChannelInfo, ChannelWatch, Raw, Tap};
use messages::ChannelVisitor;
use messages::ros::Payload;
use runlog::{ChannelSpec, published_ns};

use crate::batch::{Batch, ReceivedSample};
use crate::session::Session;

/// Largest size of a batch, bytes, which bounds the memory for a burst; further samples are in the next batch.
const BATCH_BYTES: usize = 2 << 20;

/// The taps of a recorder.
#[derive(Default)]
pub struct Listening {
    taps: Vec<(Tap, usize)>,
    /// The tap with which the next batch begins.
    first: usize,
    watch: ChannelWatch,
    /// Channels that could not be opened, and whether that was reported.
    waiting: Vec<(ChannelInfo, bool)>,
    exclude: Vec<String>,
}

impl Listening {
    /// Creates a recorder's subscriptions without channels. `exclude` are the names of channels not to record; a
    /// trailing `*` matches any ending.
    #[must_use]
    pub fn new(exclude: Vec<String>) -> Self {
        Self { exclude, ..Self::default() }
    }

    /// Subscribes to new channels, and retries those that could not be opened before.
    ///
    /// # Errors
    /// The channels cannot be listed.
    pub fn discover(&mut self, bus: &Bus, session: &mut Session) -> Result<(), BusError> {
        let mut waiting = std::mem::take(&mut self.waiting);
        waiting.extend(self.watch.new_channels(bus)?.into_iter().map(|info| (info, false)));
        for (info, reported) in waiting {
            let known = self.taps.iter().any(|(tap, _)| {
                tap.info().name == info.name && tap.info().type_name == info.type_name && tap.info().size == info.size
            });
            if known || self.excluded(&info.name) {
                continue;
            }
            match bus.tap_with_history(&info.name) {
                Ok(tap) => {
                    let row = session.declare(spec_of(tap.info()));
                    self.taps.push((tap, row));
                }
                // The channel was removed. If it is created again, it is a new one.
                Err(BusError::NoChannel { .. }) => {}
                Err(error) => {
                    if !reported {
                        tracing::warn!("channel {} is not recorded yet, retrying: {error}", info.name);
                    }
                    self.waiting.push((info, true));
                }
            }
        }
        Ok(())
    }

    /// Creates the channels whose first sample is recorded before their publishers do, and subscribes to them.
    ///
    /// # Errors
    /// As [`Listening::discover`].
    pub fn discover_first(&mut self, bus: &Bus, session: &mut Session) -> Result<(), BusError> {
        let mut open = OpenChannels { bus, subscribers: Vec::new() };
        messages::visit_first_channels(&mut open);
        self.discover(bus, session)
    }

    fn excluded(&self, name: &str) -> bool {
        self.exclude.iter().any(|pattern| match pattern.strip_suffix('*') {
            Some(beginning) => name.starts_with(beginning),
            None => name == pattern,
        })
    }

    /// Receives the samples of every channel into the batch; returns whether more samples are left than a batch holds.
    /// The next batch then begins with the next channel, so that none waits for one that never ends.
    pub fn drain(&mut self, batch: &mut Batch, now_ns: u64) -> bool {
        let count_of_taps = self.taps.len();
        for place in (self.first..count_of_taps).chain(0..self.first) {
            let Some((tap, row)) = self.taps.get_mut(place) else { continue };
            let has_header = tap.has_header();
            let mut count = tap.received();
            loop {
                if batch.bytes() >= BATCH_BYTES {
                    self.first = (place + 1) % count_of_taps;
                    return true;
                }
                count += 1;
                match tap.receive(|raw| batch.push(received_sample(*row, has_header, &raw, count, now_ns), raw.bytes)) {
                    Ok(Some(())) => {}
                    Ok(None) => break,
                    Err(error) => {
                        tracing::error!("{error}");
                        break;
                    }
                }
            }
        }
        false
    }
}

fn received_sample(row: usize, has_header: bool, raw: &Raw<'_>, count: u64, now_ns: u64) -> ReceivedSample {
    if !has_header {
        return ReceivedSample { row, logged_ns: now_ns, stamp_ns: now_ns, seq: count, missing: 0 };
    }
    let stamp_ns = raw.header.stamp_ns;
    let logged_ns = published_ns(stamp_ns, now_ns);
    let stamp_ns = if stamp_ns == 0 { logged_ns } else { stamp_ns };
    ReceivedSample { row, logged_ns, stamp_ns, seq: raw.header.seq, missing: raw.missing }
}

fn spec_of(info: &ChannelInfo) -> ChannelSpec {
    ChannelSpec {
        name: info.name.clone(),
        type_name: info.type_name.clone(),
        schema: info.schema.clone().unwrap_or_default(),
        size: info.size,
    }
}

/// Keeps channels open.
struct OpenChannels<'a> {
    bus: &'a Bus,
    subscribers: Vec<Box<dyn Any>>,
}

impl ChannelVisitor for OpenChannels<'_> {
    fn visit<T: Payload>(&mut self, name: &'static str) {
        // A channel that exists with another type is discovered like one of unknown type.
        if let Ok(subscriber) = self.bus.subscriber::<T>(name) {
            self.subscribers.push(Box::new(subscriber));
        }
    }
}
