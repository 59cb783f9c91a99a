//! Places of a robot that programs from before its start hold.

use iceoryx2::prelude::MessagingPattern;

use crate::error::THIS_PROCESS;
use crate::node::names_of;
use crate::{Bus, CHANNELS_EVENT};

/// Places of a robot that are not as many as its owner has stated, because they were reserved before.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FormerPlaces {
    /// Processes for which the robot has places.
    pub processes: usize,
    /// Processes for which it should have places.
    pub stated: usize,
    /// The other processes that hold them.
    pub holders: Vec<String>,
}

impl Bus {
    /// Returns the places of the robot if they are not as many as were stated when this process joined: they remain
    /// until the last process that holds them ends.
    #[must_use]
    pub fn former_places(&self) -> Option<FormerPlaces> {
        let found = self.details(CHANNELS_EVENT, MessagingPattern::Event)?;
        let (processes, stated) = (found.static_details.event().max_nodes(), self.processes);
        let mut holders = found.dynamic_details.map(|found| names_of(&found.nodes)).unwrap_or_default();
        holders.retain(|holder| holder != THIS_PROCESS);
        (processes != stated).then_some(FormerPlaces { processes, stated, holders })
    }
}
