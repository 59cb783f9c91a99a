//! Samples of a running robot.

use crate::link::RobotLink;
use command::Answer;
use messages::{Message, MotorAuthority, NodeEstimate, RecorderStatus, Rule, SLOT_NAMES, blended_estimate};
use std::time::Duration;

/// Returns the newest estimate in charge that arrives within `patience`.
///
/// # Errors
/// A channel cannot be opened.
pub fn estimate(link: &RobotLink, patience: Duration) -> Answer<Option<NodeEstimate>> {
    let mut authority = link.subscriber::<MotorAuthority>("motor/authority")?;
    let [a, b] = SLOT_NAMES.map(|slot| format!("node/estimate/{slot}"));
    let mut estimates = [link.subscriber::<NodeEstimate>(&a)?, link.subscriber::<NodeEstimate>(&b)?];
    let (mut newest, mut said) = ([None; 2], None);
    let deadline = bus::clock::now_ns() + patience.as_nanos() as u64;
    let mut waiter = link.waiter(&[&a, &b])?;
    loop {
        for (newest, estimates) in newest.iter_mut().zip(&mut estimates) {
            *newest = estimates.latest()?.or(*newest);
        }
        said = authority.latest()?.or(said);
        let late = bus::clock::now_ns() >= deadline;
        if late || (said.is_some() && newest.iter().any(Option::is_some)) {
            return Ok(blended_estimate(said.as_ref(), [newest[0].as_ref(), newest[1].as_ref()], Rule::History));
        }
        waiter.wait_until(Some(deadline))?;
    }
}

/// The recorder publishes its status every second; after this time without one it counts as failed, ns.
const RECORDER_NS: u64 = 2_500_000_000;

/// Returns why nothing is being recorded; `None` while recording.
///
/// # Errors
/// The channel cannot be opened.
pub fn unrecorded(link: &RobotLink) -> Answer<Option<String>> {
    let mut rows = link.subscriber::<RecorderStatus>("recorder/status")?;
    let deadline = bus::clock::now_ns() + RECORDER_NS;
    let mut waiter = link.waiter(&["recorder/status"])?;
    loop {
        // A sample of the history may be older than the failure of the recorder.
        let row = rows.latest()?.filter(|row| row.header.stamp_ns + RECORDER_NS > bus::clock::now_ns());
        if let Some(row) = row {
            return Ok(unrecorded_of(&row));
        }
        if bus::clock::now_ns() >= deadline {
            return Ok(Some("the recorder does not run or hangs; see nims status".to_owned()));
        }
        waiter.wait_until(Some(deadline))?;
    }
}

/// Returns why a recorder with this status records nothing.
#[must_use]
pub fn unrecorded_of(row: &RecorderStatus) -> Option<String> {
    let reason = messages::text_of(&row.reason);
    match row.state {
        RecorderStatus::STATE_RECORDING => None,
        _ if !reason.is_empty() => Some(reason),
        RecorderStatus::STATE_DISK_FULL => Some("the disk is full".to_owned()),
        _ => Some("the recorder cannot write".to_owned()),
    }
}

/// Returns the newest sample of a channel that arrives within `patience`.
///
/// # Errors
/// The channel cannot be opened.
pub fn newest<T: Message>(link: &RobotLink, channel: &str, patience: Duration) -> Answer<Option<T>> {
    let mut subscriber = link.subscriber::<T>(channel)?;
    let deadline = bus::clock::now_ns() + patience.as_nanos() as u64;
    let mut waiter = link.waiter(&[channel])?;
    loop {
        if let Some(sample) = subscriber.latest()? {
            return Ok(Some(sample));
        }
        if bus::clock::now_ns() >= deadline {
            return Ok(None);
        }
        waiter.wait_until(Some(deadline))?;
    }
}
