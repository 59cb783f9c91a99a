//! A process that will replace another of the same name.

use super::managed_process::ManagedProcess;
use bus::{Bus, Raw, Tap};
use command::Answer;
use messages::Reading;
use messages::ros::Payload;
use rustix::process::{Pid, getpgid};
use std::collections::BTreeSet;

/// A process that takes over the name of another once it has published a valid sample.
#[derive(Debug)]
pub struct Successor {
    /// The new process.
    pub child: ManagedProcess,
    pub(super) tap: Tap,
    pub(super) given_up: bool,
}

impl Successor {
    /// Whether it has published a valid sample since the last poll.
    pub(super) fn has_published(&mut self, bus: &Bus) -> Answer<bool> {
        let (has_header, is_reading) = (self.tap.has_header(), self.tap.info().type_name == Reading::type_name());
        let mut publishers = BTreeSet::new();
        let mut take = |raw: Raw<'_>| {
            if is_valid(&raw, has_header, is_reading) {
                publishers.insert(raw.publisher);
            }
        };
        while self.tap.receive(&mut take)?.is_some() {}
        if publishers.is_empty() {
            return Ok(false);
        }
        let known = bus.publishers(&self.tap.info().name)?;
        Ok(known.iter().any(|(publisher, pid)| publishers.contains(publisher) && is_of(*pid, &self.child)))
    }
}

/// Whether a sample is valid: it has a stamp, and a reading is neither stale nor invalid.
fn is_valid(raw: &Raw<'_>, has_header: bool, is_reading: bool) -> bool {
    let reading = raw.bytes.get(..size_of::<Reading>()).filter(|_| is_reading);
    let says_nothing = reading
        .map(bytemuck::pod_read_unaligned)
        .is_some_and(|reading: Reading| matches!(reading.quality, Reading::QUALITY_STALE | Reading::QUALITY_INVALID));
    !says_nothing && (!has_header || raw.header.stamp_ns > 0)
}

/// Whether a process belongs to that child: each child has its own process group.
pub(super) fn is_of(pid: u32, child: &ManagedProcess) -> bool {
    let group = Pid::from_raw(pid.cast_signed()).and_then(|pid| getpgid(Some(pid)).ok());
    group.is_some_and(|group| group.as_raw_nonzero().get().unsigned_abs() == child.pid)
}
