//! What is not heard yet, what is silent, and what is wrong: only the last alarms.

use messages::{MotorAuthority, RecorderStatus};
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

/// The recorder for browsers: `problem` is why nothing is recorded, `silent_s` since when it is not heard. `row`: its
/// newest status; `lost`: its process died or hangs.
pub(crate) fn recorder(row: &RecorderStatus, lost: Option<String>, now_ns: u64) -> Value {
    let age_s = since_s(row.header.stamp_ns, now_ns);
    let gone = (age_s > GONE_S).then(|| format!("no message from the recorder for {age_s:.0} s"));
    json!({ "problem": client::unrecorded_of(row).or(lost).or(gone), "silent_s": (age_s > SILENT_S).then_some(age_s.round()),
        "bytes": row.total_bytes, "disk_free_bytes": row.disk_free_bytes })
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
        let at = |s: u64, lost: Option<&str>| recorder(&row, lost.map(str::to_owned), header(s).stamp_ns);
        assert_eq!((&at(11, None)["problem"], &at(11, None)["silent_s"]), (&Value::Null, &Value::Null));
        // On a loaded machine its status is late, and it records.
        assert_eq!((&at(15, None)["problem"], &at(15, None)["silent_s"]), (&Value::Null, &json!(5.0)));
        assert_eq!(at(15, Some("it died"))["problem"], "it died");
        assert!(at(40, None)["problem"].as_str().unwrap().contains("30 s"));
        let full = RecorderStatus { state: RecorderStatus::STATE_DISK_FULL, ..row };
        assert!(recorder(&full, None, header(11).stamp_ns)["problem"].is_string());
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
