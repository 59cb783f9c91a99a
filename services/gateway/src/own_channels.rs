//! Channels of sensors that have declared messages of their own.

use crate::events::OwnMessage;
use crate::lasting::Lasting;
use bus::{Bus, DeclaredPublisher};
use messages::{RequestAnswer, quality_for};
use robot_state::Reason;
use robot_state::answers::detail;
use std::collections::BTreeMap;

/// Most of them in one life of the robot: each stays as long as the robot.
const CHANNELS: usize = 32;
/// The channels by the names of their sensors.
#[derive(Default)]
pub(crate) struct OwnChannels(BTreeMap<String, Lasting<DeclaredPublisher>>);

impl OwnChannels {
    /// Returns the publisher of a sensor, and creates it with the first call: connections that come and go make no
    /// further channels.
    ///
    /// # Errors
    /// The channel has another type, too many sensors have declared one, or it cannot be created: the answer.
    pub(crate) fn open(
        &mut self,
        guests: &Bus,
        sensor: &OwnMessage,
    ) -> Result<&mut DeclaredPublisher, Box<RequestAnswer>> {
        let refused = |why: std::fmt::Arguments<'_>| Err(Box::new(Reason::NotAsked { why: detail(why) }.answer()));
        let OwnMessage { name, message, rate_hz } = sensor;
        let channel = format!("sensor/{name}");
        if !self.0.contains_key(name) && self.0.len() >= CHANNELS {
            return refused(format_args!(
                "{CHANNELS} sensors of this run have declared messages; start the robot again, or use one of their names"
            ));
        }
        let publisher = self.0.entry(name.clone()).or_default().get(|| {
            let quality = quality_for(&channel, message.size()).at_rate(*rate_hz);
            // As a guest: it leaves the places and the memory that the robot's own processes need.
            guests.declared_publisher(&channel, message, quality)
        })?;
        if publisher.type_name() != message.type_name() {
            return refused(format_args!(
                "{channel} has other fields in this run; a changed message needs a new name, e.g. {name}-2"
            ));
        }
        Ok(publisher)
    }
}
