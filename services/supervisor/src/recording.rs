//! Whether the run is being recorded. That nothing is, is said at once, and once more at the end: what is not recorded
//! is lost.

use bus::{Bus, Subscriber};
use command::Answer;
use messages::{RecorderStatus, text_of};
use runlog::RunError;
use std::collections::BTreeMap;

/// What is lost within this time after the last loss belongs to the same spell, ns.
const SPELL_NS: u64 = 10_000_000_000;
/// The rows of all channels come within this time, ns: before that a loss is not counted whole.
const ROUND_NS: u64 = 1_500_000_000;
/// Rows of the first moments after a stop still count what was lost during it, ns: each channel has one a second.
const RESUMED_NS: u64 = 2_000_000_000;

/// What is to be said.
#[derive(Debug, PartialEq, Eq)]
pub enum RecordingEvent {
    /// Nothing is being recorded.
    Stopped(String),
    /// It goes on.
    Resumed(String),
    /// The run is being recorded, and samples are missing in it.
    Lost(String),
}

/// Follows the recorder's own account.
pub struct Recording {
    status: Subscriber<RecorderStatus>,
    ledger: Ledger,
}

impl Recording {
    /// Of the recorder of that domain.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn new(bus: &Bus) -> Answer<Self> {
        Ok(Self { status: bus.subscriber("recorder/status")?, ledger: Ledger::default() })
    }

    /// Takes in what the recorder says.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn poll(&mut self, now_ns: u64) -> Answer<Vec<RecordingEvent>> {
        let (mut said, mut lost) = (Vec::new(), 0_u64);
        while let Some(row) = self.status.receive()? {
            said.extend(self.ledger.record(row.state, &text_of(&row.reason), now_ns));
            lost = lost.saturating_add(self.ledger.count(row.header.seq, text_of(&row.channel), row.lost, now_ns));
        }
        said.extend(self.ledger.lose(lost, now_ns));
        Ok(said)
    }

    /// The recorder itself is in trouble.
    pub fn record_failure(&mut self, why: &str) {
        self.ledger.add_trouble(why);
    }

    /// Why, each time, a part of the run was not recorded.
    #[must_use]
    pub fn troubles(&self) -> Vec<String> {
        let lost = (self.ledger.lost > 0).then(|| self.ledger.missing(""));
        self.ledger.troubles.iter().cloned().chain(lost).collect()
    }
}

/// What was not recorded, and why.
#[derive(Debug, Default)]
struct Ledger {
    /// Since when nothing is, ns, and the reasons so far.
    since_ns: Option<u64>,
    reasons: Vec<String>,
    /// Since when something is again, ns.
    resumed_ns: Option<u64>,
    /// Number of the last row.
    seq: u64,
    /// The most that each channel had lost so far; a name that had several types has a row of each.
    counted: BTreeMap<String, u64>,
    /// A recorder that was started again does not know what was lost between the two.
    restarted: bool,
    /// Samples lost, by the recorder's own count, and those of them that were lost while the run was recorded.
    all: u64,
    lost: u64,
    /// When the last ones were, and when they are to be said, ns.
    lost_ns: Option<u64>,
    due_ns: Option<u64>,
    troubles: Vec<String>,
}

impl Ledger {
    fn record(&mut self, state: u8, reason: &str, now_ns: u64) -> Option<RecordingEvent> {
        if state == RecorderStatus::STATE_RECORDING {
            let since_ns = self.since_ns.take()?;
            self.resumed_ns = Some(now_ns);
            let reasons = std::mem::take(&mut self.reasons);
            // What had not come to the disk before is lost too.
            let lost = format!("at least {:.1} s", now_ns.saturating_sub(since_ns) as f64 * 1e-9);
            return Some(RecordingEvent::Resumed(if reasons.iter().any(|reason| reason.contains(RunError::REMOVED)) {
                format!(
                    "the run is recorded again, in a new file; what the removed files held is not in the run, and neither is what happened in {lost}"
                )
            } else {
                format!("the run is recorded again; what happened in {lost} is not in it")
            }));
        }
        self.since_ns.get_or_insert(now_ns);
        let why = if reason.is_empty() { "the recorder cannot write" } else { reason };
        // A reason that comes later may be the true one.
        if self.reasons.iter().any(|known| known == why) {
            return None;
        }
        self.reasons.push(why.to_owned());
        self.add_trouble(why);
        Some(RecordingEvent::Stopped(format!("NOTHING IS BEING RECORDED: {why}")))
    }

    /// How many more samples that channel has lost than at its last row; none where that is already told as a time
    /// without a recording.
    fn count(&mut self, seq: u64, channel: String, lost: u64, now_ns: u64) -> u64 {
        // A recorder that was started again numbers its rows, and counts, anew.
        if std::mem::replace(&mut self.seq, seq) >= seq {
            self.counted.clear();
            self.restarted = true;
        }
        let most = self.counted.entry(channel).or_default();
        let more = lost.saturating_sub(*most);
        *most += more;
        self.all = self.all.saturating_add(more);
        let told = self.since_ns.is_some()
            || self.resumed_ns.is_some_and(|resumed_ns| now_ns.saturating_sub(resumed_ns) < RESUMED_NS);
        if told { 0 } else { more }
    }

    /// Samples were lost although the run is recorded: said once per spell, when every channel has told of it.
    fn lose(&mut self, lost: u64, now_ns: u64) -> Option<RecordingEvent> {
        if lost > 0 {
            self.lost = self.lost.saturating_add(lost);
            let before_ns = self.lost_ns.replace(now_ns);
            if before_ns.is_none_or(|at_ns| now_ns.saturating_sub(at_ns) >= SPELL_NS) {
                self.due_ns = Some(now_ns.saturating_add(ROUND_NS));
            }
        }
        self.due_ns.take_if(|due_ns| now_ns >= *due_ns)?;
        Some(RecordingEvent::Lost(self.missing(" so far")))
    }

    /// How many samples are missing, by the same count as in the run file.
    fn missing(&self, so_far: &str) -> String {
        let samples = if self.all == 1 { "sample is" } else { "samples are" };
        let least = if self.restarted { "at least " } else { "" };
        format!("{least}{} {samples} missing in the run file{so_far}: `nims report` names the channels", self.all)
    }

    fn add_trouble(&mut self, why: &str) {
        // A disk that fills again and again is one trouble.
        if !self.troubles.iter().any(|known| known == why) {
            self.troubles.push(why.to_owned());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_time_is_said_once_and_kept_until_the_end() {
        let (well, full) = (RecorderStatus::STATE_RECORDING, RecorderStatus::STATE_DISK_FULL);
        let mut ledger = Ledger::default();
        assert_eq!(ledger.record(well, "", 0), None);
        assert!(
            matches!(ledger.record(full, "the disk is full", 1), Some(RecordingEvent::Stopped(said)) if said.contains("disk"))
        );
        assert_eq!(ledger.record(full, "the disk is full", 2), None);
        assert!(
            matches!(ledger.record(well, "", 2_000_000_001), Some(RecordingEvent::Resumed(said)) if said.contains("2.0 s"))
        );
        assert_eq!(ledger.record(well, "", 3), None);
        assert!(ledger.record(RecorderStatus::STATE_FAILED, "it was removed", 4).is_some());
        assert_eq!(ledger.troubles, ["the disk is full", "it was removed"]);
    }

    #[test]
    fn a_reason_that_changes_is_said_once_and_a_removed_file_is_no_gap_of_a_second() {
        let (well, failed) = (RecorderStatus::STATE_RECORDING, RecorderStatus::STATE_FAILED);
        let removed = RunError::Removed { path: "/runs/one/run.mcap.part".into() }.to_string();
        let mut ledger = Ledger::default();
        for (reason, told) in [(&*removed, true), (&*removed, false), ("Permission denied", true), (&*removed, false)] {
            let said = ledger.record(failed, reason, 1);
            assert_eq!(said.is_some(), told, "{reason}: {said:?}");
        }
        assert_eq!(ledger.troubles, [removed.as_str(), "Permission denied"]);
        let said = ledger.record(well, "", 1_000_000_001);
        assert!(
            matches!(&said, Some(RecordingEvent::Resumed(said)) if said.contains("what the removed files held")),
            "{said:?}"
        );
        // The next time has reasons of its own.
        assert!(ledger.record(failed, "Permission denied", 3).is_some());
        let said = ledger.record(well, "", 4);
        assert!(matches!(&said, Some(RecordingEvent::Resumed(said)) if !said.contains("removed")), "{said:?}");
        assert_eq!(ledger.troubles.len(), 2);
    }

    #[test]
    fn a_removed_file_is_known_by_a_reason_that_was_cut() {
        let path = format!("/a/long/{}/run.mcap.part", "folder/".repeat(40));
        for path in [path.as_str(), &path[path.len() - 120..]] {
            let mut row = RecorderStatus::default();
            messages::put_sentence(&mut row.reason, &RunError::Removed { path: path.into() }.to_string());
            let reason = text_of(&row.reason);
            assert!(reason.contains(RunError::REMOVED), "{reason}");
        }
    }

    #[test]
    fn what_is_lost_is_said_once_per_spell() {
        const SECOND_NS: u64 = 1_000_000_000;
        let mut ledger = Ledger::default();
        let mut seq = 0;
        let mut rows = |at_s: u64, lost: [u64; 2]| {
            let (at_ns, mut more) = (at_s * SECOND_NS, 0);
            for (name, lost) in ["a", "b"].into_iter().zip(lost) {
                seq += 1;
                more += ledger.count(seq, name.to_owned(), lost, at_ns);
            }
            ledger.lose(more, at_ns)
        };
        assert_eq!(rows(1, [0, 0]), None);
        assert_eq!(rows(2, [3, 0]), None, "not every channel has told of it");
        assert_eq!(rows(3, [4, 1]), None);
        assert!(
            matches!(rows(4, [4, 2]), Some(RecordingEvent::Lost(said)) if said.starts_with("6 samples are missing in the run file so far"))
        );
        assert_eq!(rows(5, [4, 2]), None, "nothing more");
        assert_eq!(rows(21, [5, 2]), None);
        assert!(
            matches!(rows(23, [0, 2]), Some(RecordingEvent::Lost(said)) if said.starts_with("7 samples are")),
            "in all"
        );
        assert_eq!((ledger.lost, ledger.all), (7, 7));
        assert_eq!(ledger.count(1, "b".to_owned(), 1, 40 * SECOND_NS), 1, "of another recorder");
        assert_eq!(ledger.count(2, "b".to_owned(), 1, 41 * SECOND_NS), 0);
        assert!(ledger.missing("").starts_with("at least 8 samples are missing in the run file: "));
    }

    #[test]
    fn what_is_lost_while_nothing_is_recorded_is_told_as_such() {
        let (well, full) = (RecorderStatus::STATE_RECORDING, RecorderStatus::STATE_DISK_FULL);
        let mut ledger = Ledger::default();
        assert!(ledger.record(full, "", 1).is_some());
        assert_eq!(ledger.count(1, "a".to_owned(), 7, 1), 0);
        assert!(ledger.record(well, "", 2).is_some());
        assert_eq!(ledger.count(2, "a".to_owned(), 9, 2), 0, "until the recording went on");
        assert_eq!(ledger.count(3, "a".to_owned(), 10, 2 + RESUMED_NS), 1);
    }
}
