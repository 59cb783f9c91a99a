//! What is not received yet, what is silent, and what is wrong: only the last alarms.

use messages::{MotorAuthority, ProcessState, RecorderStatus};
use robot_state::Periods;
use serde_json::{Value, json};
use std::collections::VecDeque;

/// The recorder publishes once a second; it is silent after this time, s.
const SILENT_S: f64 = 2.5;
/// A recorder that is silent for this time records nothing as far as anyone can tell, s. A loaded machine delays its
/// status by seconds while it records; the supervisor finds one that died or hangs before.
const GONE_S: f64 = 15.0;
/// Time for which periods that were not steered are shown, ns.
const MISSED_NS: u64 = 60_000_000_000;

/// Time since a stamp, s; 0 for one of the future.
pub(crate) fn since_s(stamp_ns: u64, now_ns: u64) -> f64 {
    now_ns.saturating_sub(stamp_ns) as f64 * 1e-9
}

/// The recorder for browsers: `problem` is why nothing is recorded, `silent_s` the age of its newest status. `row`:
/// that status; `process`: the state of its process; `seen_s`: for how long the robot has been received.
pub(crate) fn recorder(row: Option<&RecorderStatus>, process: Option<u8>, seen_s: f64, now_ns: u64) -> Value {
    let age_s = row.map_or(seen_s, |row| since_s(row.header.stamp_ns, now_ns));
    let gone = (age_s > GONE_S).then(|| format!("no message from the recorder for {age_s:.0} s"));
    let lost =
        process.filter(|state| is_lost(*state)).map(|state| format!("the recorder: {}", client::state_name(state)));
    let problem = row.and_then(client::unrecorded_of).or(lost).or(gone);
    if row.is_none() && problem.is_none() {
        return Value::Null;
    }
    json!({ "problem": problem, "silent_s": row.and((age_s > SILENT_S).then_some(age_s.round())),
        "bytes": row.map(|row| row.total_bytes), "disk_free_bytes": row.map(|row| row.disk_free_bytes) })
}

/// A process in this state records nothing, whatever its last status was.
fn is_lost(state: u8) -> bool {
    matches!(
        state,
        ProcessState::STATE_STOPPED
            | ProcessState::STATE_DIED
            | ProcessState::STATE_SILENT
            | ProcessState::STATE_GAVE_UP
            | ProcessState::STATE_GONE
    )
}

/// The periods that were not steered, over the last minute.
#[derive(Debug, Default)]
pub(crate) struct Missed {
    /// The number since motor-io began and when it was first seen, ns; oldest first.
    seen: VecDeque<(u64, u64)>,
}

impl Missed {
    pub(crate) fn take(&mut self, authority: &MotorAuthority) {
        let (at_ns, count) = (authority.header.stamp_ns, Periods::from_authority(authority).unsteered());
        match self.seen.back() {
            // Another life of motor-io counts from 0.
            Some((_, before)) if count < *before => self.seen.clear(),
            Some((_, before)) if count == *before => return,
            _ => {}
        }
        self.seen.push_back((at_ns, count));
        // The newest one of before the minute is what the minute began with.
        while self.seen.get(1).is_some_and(|(next_ns, _)| at_ns.saturating_sub(*next_ns) > MISSED_NS) {
            self.seen.pop_front();
        }
    }

    /// Their number in the last minute, as far as it was seen.
    pub(crate) fn last_minute(&self, now_ns: u64) -> u64 {
        let began = |(at_ns, _): &&(u64, u64)| now_ns.saturating_sub(*at_ns) > MISSED_NS;
        let base = self.seen.iter().rev().find(began).or(self.seen.front());
        self.seen.back().zip(base).map_or(0, |((_, now), (_, then))| now - then)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Header;

    fn header(s: u64) -> Header {
        Header { stamp_ns: s * 1_000_000_000, ..Header::default() }
    }

    #[test]
    fn a_silent_recorder_is_told_from_one_that_does_not_record() {
        let row = RecorderStatus { header: header(10), state: RecorderStatus::STATE_RECORDING, ..Default::default() };
        let at = |s: u64, process: Option<u8>| recorder(Some(&row), process, 0.0, header(s).stamp_ns);
        assert_eq!((&at(11, None)["problem"], &at(11, None)["silent_s"]), (&Value::Null, &Value::Null));
        // On a loaded machine its status is late, and it records.
        assert_eq!((&at(15, None)["problem"], &at(15, None)["silent_s"]), (&Value::Null, &json!(5.0)));
        assert_eq!(at(15, Some(ProcessState::STATE_RUNNING))["problem"], Value::Null);
        // Its process is known to be lost before its status is old, also where an operator stopped it.
        for (state, name) in [
            (ProcessState::STATE_DIED, "DIED"),
            (ProcessState::STATE_STOPPED, "stopped"),
            (ProcessState::STATE_GONE, "gone"),
        ] {
            assert_eq!(at(11, Some(state))["problem"], format!("the recorder: {name}"));
        }
        assert!(at(40, None)["problem"].as_str().unwrap().contains("30 s"));
        let full = RecorderStatus { state: RecorderStatus::STATE_DISK_FULL, ..row };
        assert!(recorder(Some(&full), None, 0.0, header(11).stamp_ns)["problem"].is_string());
    }

    #[test]
    fn a_recorder_without_a_status_is_a_problem_when_it_is_lost_or_late() {
        let of = |process: Option<u8>, seen_s: f64| recorder(None, process, seen_s, header(100).stamp_ns);
        assert_eq!(of(None, 14.0), Value::Null);
        assert_eq!(of(Some(ProcessState::STATE_STARTING), 14.0), Value::Null);
        let lost = of(Some(ProcessState::STATE_GAVE_UP), 1.0);
        assert!(
            lost["problem"].is_string() && lost["silent_s"].is_null() && lost["disk_free_bytes"].is_null(),
            "{lost}"
        );
        for process in [None, Some(ProcessState::STATE_READY)] {
            assert!(of(process, 16.0)["problem"].as_str().unwrap().contains("16 s"));
        }
    }

    #[test]
    fn periods_count_for_a_minute_and_not_from_before_the_page_looked() {
        let mut missed = Missed::default();
        let mut at = |s: u64, lost_computer: u64| {
            missed.take(&MotorAuthority { header: header(s), lost_computer, ..Default::default() });
            missed.last_minute(header(s).stamp_ns)
        };
        assert_eq!(at(0, 301), 0);
        assert_eq!(at(10, 303), 2);
        assert_eq!(at(30, 303), 2);
        assert_eq!(at(50, 304), 3);
        assert_eq!(at(75, 304), 1);
        assert_eq!(at(120, 304), 0);
        // Another life.
        assert_eq!((at(130, 0), at(131, 4)), (0, 4));
    }
}
