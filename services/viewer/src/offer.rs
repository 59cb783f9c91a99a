//! A channel that is offered to tools, with a subscription while a tool requests it.

use std::collections::VecDeque;

use bus::{Bus, BusError, ChannelInfo, Tap};
use messages::schema::Schema as Layout;
use runlog::{CDR_HEADER, ChannelSpec, Definitions, RunClock, published_ns};

use crate::budget::Budget;
use crate::hub::Hub;
use crate::protocol::Advertised;

/// A sample in the form for tools.
#[derive(Debug, Default, Clone)]
struct Sample {
    /// UNIX time of its publication, ns.
    unix_ns: u64,
    /// [`CDR_HEADER`] and the bytes of the sample.
    body: Vec<u8>,
}

/// The subscription to a channel, and its samples.
#[derive(Debug)]
struct Subscription {
    tap: Tap,
    budget: Budget,
    /// The newest samples of one poll; reused.
    waiting: VecDeque<Sample>,
    spare: Vec<Sample>,
    /// The last sample, for tools that connect later: a channel may publish rarely.
    last: Sample,
}

/// A channel offered to tools.
pub(crate) struct Offer {
    info: ChannelInfo,
    /// Its number in the hub.
    id: u32,
    has_header: bool,
    subscription: Option<Subscription>,
    /// Whether a failed subscription was reported.
    reported: bool,
}

impl Offer {
    /// Offers a channel to every tool.
    pub(crate) fn new(hub: &Hub, info: ChannelInfo, definitions: &mut Definitions) -> Self {
        let spec = ChannelSpec {
            name: info.name.clone(),
            type_name: info.type_name.clone(),
            schema: info.schema.clone().unwrap_or_default(),
            size: info.size,
        };
        let has_header = Layout::parse(&spec.schema).is_ok_and(|layout| layout.has_header());
        let definition = definitions.definition_of(&spec);
        let id = hub.advertise(Advertised {
            id: 0,
            topic: format!("/{}", info.name),
            encoding: "cdr",
            schema_name: definition.schema_name,
            schema: definition.text,
            schema_encoding: "ros2msg",
        });
        Self { info, id, has_header, subscription: None, reported: false }
    }

    pub(crate) fn id(&self) -> u32 {
        self.id
    }

    pub(crate) fn info(&self) -> &ChannelInfo {
        &self.info
    }

    pub(crate) fn is_subscribed(&self) -> bool {
        self.subscription.is_some()
    }

    /// Withdraws the channel from all tools.
    pub(crate) fn withdraw(self, hub: &Hub) {
        hub.withdraw(self.id);
    }

    /// Subscribes when a tool requests the channel, and unsubscribes when none does.
    pub(crate) fn update_subscription(&mut self, hub: &Hub, bus: &Bus, rate_hz: f64, now_ns: u64) {
        if !hub.is_shown(self.id) {
            self.subscription = None;
        } else if self.subscription.is_none() {
            match bus.tap(&self.info.name) {
                Ok(tap) => {
                    let (budget, waiting) = (Budget::new(rate_hz, now_ns), VecDeque::new());
                    let (spare, last) = (Vec::new(), Sample::default());
                    self.subscription = Some(Subscription { tap, budget, waiting, spare, last });
                    self.reported = false;
                }
                // The channel was removed; it is subscribed to when it exists again.
                Err(BusError::NoChannel { .. }) => {}
                Err(error) if !self.reported => {
                    self.reported = true;
                    tracing::warn!("channel {} is not shown yet, retrying: {error}", self.info.name);
                }
                Err(_) => {}
            }
        }
    }

    /// Forwards the newest samples received since the last poll, as many as the rate allows.
    ///
    /// # Errors
    /// Shared memory is damaged.
    pub(crate) fn forward(&mut self, hub: &Hub, clock: RunClock, rate_hz: f64, now_ns: u64) -> Result<(), BusError> {
        let (has_header, most) = (self.has_header, rate_hz.max(1.0) as usize);
        let Some(Subscription { tap, budget, waiting, spare, last }) = &mut self.subscription else { return Ok(()) };
        let mut count = 0;
        loop {
            // Drop the oldest sample if more arrive than may be forwarded.
            let reused = if waiting.len() < most { spare.pop() } else { waiting.pop_front() };
            let mut sample = reused.unwrap_or_default();
            let received = tap.receive(|raw| {
                let stamp_ns = if has_header { raw.header.stamp_ns } else { now_ns };
                sample.unix_ns = clock.unix_of(published_ns(stamp_ns, now_ns));
                sample.body.clear();
                sample.body.extend_from_slice(&CDR_HEADER);
                sample.body.extend_from_slice(raw.bytes);
            })?;
            if received.is_none() {
                spare.push(sample);
                break;
            }
            waiting.push_back(sample);
            count += 1;
        }
        if count == 0 {
            return Ok(());
        }
        let granted = budget.spend(waiting.len(), now_ns);
        for sample in waiting.iter().skip(waiting.len() - granted) {
            hub.send(self.id, sample.unix_ns, &sample.body, None);
        }
        if let Some(newest) = waiting.back() {
            last.clone_from(newest);
        }
        spare.extend(waiting.drain(..));
        Ok(())
    }

    /// Sends the last sample to a tool that requests this channel after another one already did.
    pub(crate) fn send_last(&self, hub: &Hub, tool: u64) {
        let subscription = self.subscription.as_ref().filter(|subscription| !subscription.last.body.is_empty());
        if let Some(Subscription { last, .. }) = subscription {
            hub.send(self.id, last.unix_ns, &last.body, Some(tool));
        }
    }

    /// Returns the number of samples that were overwritten before this process received them.
    pub(crate) fn lost(&self) -> u64 {
        self.subscription.as_ref().map_or(0, |subscription| subscription.tap.lost())
    }
}
