//! Channels of sensors that have declared messages of their own.

use crate::events::OwnMessage;
use crate::lane::failed;
use bus::{Bus, DeclaredPublisher};
use messages::{RequestAnswer, quality_for};
use robot_state::Reason;
use robot_state::answers::detail;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

/// Most of them in one life of the robot: each stays as long as the robot.
const CHANNELS: usize = 32;
/// Time between two attempts to create one, ns.
const AGAIN_NS: u64 = 1_000_000_000;

/// A channel; or until when it is not tried to create it again, ns, with the reason.
type OwnChannel = Result<DeclaredPublisher, (u64, Box<RequestAnswer>)>;

/// The channels by the names of their sensors.
#[derive(Default)]
pub(crate) struct OwnChannels(BTreeMap<String, OwnChannel>);

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
        now_ns: u64,
    ) -> Result<&mut DeclaredPublisher, Box<RequestAnswer>> {
        let refused = |why: std::fmt::Arguments<'_>| Err(Box::new(Reason::NotAsked { why: detail(why) }.answer()));
        let OwnMessage { name, message, rate_hz } = sensor;
        let channel = format!("sensor/{name}");
        let create = || {
            let quality = quality_for(&channel, message.size()).at_rate(*rate_hz);
            // As a guest: it leaves the places and the memory that the robot's own processes need.
            let created = guests.declared_publisher(&channel, message, quality);
            created.map_err(|error| (now_ns + AGAIN_NS, failed(&error)))
        };
        let count = self.0.len();
        let opened = match self.0.entry(name.clone()) {
            Entry::Vacant(_) if count >= CHANNELS => {
                return refused(format_args!(
                    "{CHANNELS} sensors of this run have declared messages; start the robot again, or use one of their names"
                ));
            }
            Entry::Vacant(place) => place.insert(create()),
            Entry::Occupied(mut place) => {
                if place.get().as_ref().is_err_and(|(again_ns, _)| now_ns >= *again_ns) {
                    *place.get_mut() = create();
                }
                place.into_mut()
            }
        };
        match opened {
            Ok(publisher) if publisher.type_name() != message.type_name() => refused(format_args!(
                "{channel} has other fields in this run; a changed message needs a new name, e.g. {name}-2"
            )),
            Ok(publisher) => Ok(publisher),
            Err((_, answer)) => Err(answer.clone()),
        }
    }
}
