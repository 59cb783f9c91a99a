//! One channel as it is offered to tools, and listened to while one of them wants it.

use std::collections::VecDeque;
use std::sync::Arc;

use bus::{Bus, BusError, ChannelInfo, Tap};
use foxglove::{ChannelId, Context, FoxgloveError, PartialMetadata, RawChannel, Schema, SinkId};
use messages::schema::Schema as Layout;
use runlog::{CDR_HEADER, ChannelSpec, Definitions, RunClock, published_ns};

use crate::budget::Budget;

/// A sample as a tool gets it.
#[derive(Debug, Default, Clone)]
struct Sample {
    /// UNIX time of its publication, ns.
    unix_ns: u64,
    /// With [`CDR_HEADER`] before it.
    body: Vec<u8>,
}

/// What is there while somebody listens.
#[derive(Debug)]
struct Heard {
    tap: Tap,
    budget: Budget,
    /// The newest samples of one look; emptied and used again.
    waiting: VecDeque<Sample>,
    spare: Vec<Sample>,
    /// For whoever comes later: what rarely speaks would stay empty for long.
    last: Sample,
}

/// A channel of the robot, offered.
pub(crate) struct Offer {
    info: ChannelInfo,
    channel: Arc<RawChannel>,
    has_header: bool,
    heard: Option<Heard>,
    /// Said once.
    refused: bool,
}

impl Offer {
    /// Offers the channel to every tool.
    pub(crate) fn new(
        context: &Arc<Context>,
        info: ChannelInfo,
        definitions: &mut Definitions,
    ) -> Result<Self, FoxgloveError> {
        let spec = ChannelSpec {
            name: info.name.clone(),
            type_name: info.type_name.clone(),
            schema: info.schema.clone().unwrap_or_default(),
            size: info.size,
        };
        let has_header = Layout::parse(&spec.schema).is_ok_and(|layout| layout.has_header());
        let definition = definitions.of(&spec);
        let channel = context
            .channel_builder(format!("/{}", info.name))
            .message_encoding("cdr")
            .schema(Schema::new(definition.schema_name, "ros2msg", definition.text.into_bytes()))
            .metadata(definition.metadata)
            .build_raw()?;
        Ok(Self { info, channel, has_header, heard: None, refused: false })
    }

    pub(crate) fn id(&self) -> ChannelId {
        self.channel.id()
    }

    pub(crate) fn info(&self) -> &ChannelInfo {
        &self.info
    }

    pub(crate) fn is_heard(&self) -> bool {
        self.heard.is_some()
    }

    /// No tool is to see it any more.
    pub(crate) fn withdraw(self) {
        self.channel.close();
    }

    /// Begins to listen when some tool wants it, and ends when none does.
    pub(crate) fn attend(&mut self, bus: &Bus, rate_hz: f64, now_ns: u64) {
        if !self.channel.has_sinks() {
            self.heard = None;
        } else if self.heard.is_none() {
            match bus.tap(&self.info.name) {
                Ok(tap) => {
                    let (budget, waiting) = (Budget::new(rate_hz, now_ns), VecDeque::new());
                    self.heard = Some(Heard { tap, budget, waiting, spare: Vec::new(), last: Sample::default() });
                    self.refused = false;
                }
                // it went away; when it is back, it is listened to
                Err(BusError::NoChannel { .. }) => {}
                Err(error) if !self.refused => {
                    self.refused = true;
                    tracing::warn!("channel {} is not shown, will try again: {error}", self.info.name);
                }
                Err(_) => {}
            }
        }
    }

    /// Passes on what has come since the last look, as much as the rate allows, the newest.
    ///
    /// # Errors
    /// Shared memory is damaged.
    pub(crate) fn pass_on(&mut self, clock: RunClock, rate_hz: f64, now_ns: u64) -> Result<(), BusError> {
        let (has_header, most) = (self.has_header, rate_hz.max(1.0) as usize);
        let Some(Heard { tap, budget, waiting, spare, last }) = &mut self.heard else { return Ok(()) };
        let mut come = 0;
        loop {
            // of more than can pass, the oldest makes room
            let reused = if waiting.len() < most { spare.pop() } else { waiting.pop_front() };
            let mut sample = reused.unwrap_or_default();
            let heard = tap.receive(|raw| {
                let stamp_ns = if has_header { raw.header.stamp_ns } else { now_ns };
                sample.unix_ns = clock.unix_of(published_ns(stamp_ns, now_ns));
                sample.body.clear();
                sample.body.extend_from_slice(&CDR_HEADER);
                sample.body.extend_from_slice(raw.bytes);
            })?;
            if heard.is_none() {
                spare.push(sample);
                break;
            }
            waiting.push_back(sample);
            come += 1;
        }
        if come == 0 {
            return Ok(());
        }
        let granted = budget.spend(waiting.len(), now_ns);
        for sample in waiting.iter().skip(waiting.len() - granted) {
            self.channel.log_with_meta(&sample.body, PartialMetadata::with_log_time(sample.unix_ns));
        }
        if let Some(newest) = waiting.back() {
            last.clone_from(newest);
        }
        spare.extend(waiting.drain(..));
        Ok(())
    }

    /// The last sample, for a tool that has just begun to want this channel while another one already did.
    pub(crate) fn pass_last(&self, to: SinkId) {
        if let Some(Heard { last, .. }) = self.heard.as_ref().filter(|heard| !heard.last.body.is_empty()) {
            let time = PartialMetadata::with_log_time(last.unix_ns);
            self.channel.log_with_meta_to_sink(&last.body, time, Some(to));
        }
    }

    /// Samples that were overwritten before this process took them.
    pub(crate) fn lost(&self) -> u64 {
        self.heard.as_ref().map_or(0, |heard| heard.tap.lost())
    }
}
