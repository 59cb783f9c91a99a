//! Whether the run is being recorded. A gap is reported at once, and again at the end of the run: samples that are not
//! recorded are lost.

use bus::{Bus, Subscriber};
use command::Answer;
use messages::{RecorderStatus, text_of};
use std::collections::BTreeMap;
use std::path::Path;

/// Losses at most this far apart are reported as one, ns.
const SPELL_NS: u64 = 10_000_000_000;
/// Time within which the rows of all channels arrive, ns: until then the count of a loss is incomplete.
const ROUND_NS: u64 = 1_500_000_000;
/// Time after a gap in which rows still count its losses, ns: each channel has one row per second.
const RESUMED_NS: u64 = 2_000_000_000;

/// Event to report, with its sentence.
#[derive(Debug, PartialEq, Eq)]
pub enum RecordingEvent {
    /// Nothing is being recorded.
    Stopped(String),
    /// Recording has resumed.
    Resumed(String),
    /// The run is being recorded, but samples are missing.
    Lost(String),
}

/// Follows `recorder/status`.
pub struct Recording {
    status: Subscriber<RecorderStatus>,
    ledger: Ledger,
}

impl Recording {
    /// Subscribes to the recorder of that domain.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn new(bus: &Bus) -> Answer<Self> {
        Ok(Self { status: bus.subscriber("recorder/status")?, ledger: Ledger::default() })
    }

    /// Receives the recorder's status and returns the events to report.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn poll(&mut self, now_ns: u64) -> Answer<Vec<RecordingEvent>> {
        let (mut said, mut lost) = (Vec::new(), 0_u64);
        while let Some(row) = self.status.receive()? {
            self.ledger.removed |= row.removed == 1;
            said.extend(self.ledger.record(row.state, &text_of(&row.reason), now_ns));
            lost = lost.saturating_add(self.ledger.count(row.header.seq, text_of(&row.channel), row.lost, now_ns));
        }
        said.extend(self.ledger.lose(lost, now_ns));
        Ok(said)
    }

    /// Adds a failure of the recorder process itself.
    pub fn record_failure(&mut self, why: &str) {
        self.ledger.add_trouble(why);
    }

    /// Returns whether a reason for a gap begins with this file: its recorder said why it could not write it.
    #[must_use]
    pub fn has_reason_for(&self, file: &Path) -> bool {
        self.ledger.names(file)
    }

    /// Reasons for the gaps in the recording.
    #[must_use]
    pub fn gap_reasons(&self) -> Vec<String> {
        let lost = (self.ledger.lost > 0).then(|| self.ledger.missing(""));
        self.ledger.troubles.iter().cloned().chain(lost).collect()
    }
}

/// Gaps and losses, with their reasons.
#[derive(Debug, Default)]
struct Ledger {
    /// Start of the present gap, ns, and its reasons so far.
    since_ns: Option<u64>,
    reasons: Vec<String>,
    /// In the present gap a file was removed.
    removed: bool,
    /// End of the last gap, ns.
    resumed_ns: Option<u64>,
    /// Sequence number of the last row.
    seq: u64,
    /// Largest count of lost samples of each channel; a name with several types has a row for each type.
    counted: BTreeMap<String, u64>,
    /// The recorder was restarted, so the losses in between are unknown.
    restarted: bool,
    /// Lost samples by the recorder's count: all of them, and those lost outside gaps.
    all: u64,
    lost: u64,
    /// Time of the last loss, and time at which it is reported, ns.
    lost_ns: Option<u64>,
    due_ns: Option<u64>,
    troubles: Vec<String>,
}

impl Ledger {
    fn record(&mut self, state: u8, reason: &str, now_ns: u64) -> Option<RecordingEvent> {
        if state == RecorderStatus::STATE_RECORDING {
            let since_ns = self.since_ns.take()?;
            self.resumed_ns = Some(now_ns);
            self.reasons.clear();
            // Samples that had not reached the disk before the gap are lost too.
            let lost = format!("at least {:.1} s", now_ns.saturating_sub(since_ns) as f64 * 1e-9);
            return Some(RecordingEvent::Resumed(if std::mem::take(&mut self.removed) {
                format!(
                    "the run is recorded again, in a new file; what the removed files held is not in the run, and neither is what happened in {lost}"
                )
            } else {
                format!("the run is recorded again; what happened in {lost} is not in it")
            }));
        }
        self.since_ns.get_or_insert(now_ns);
        let why = if reason.is_empty() { "the recorder cannot write" } else { reason };
        // A later, different reason may be the actual cause, so it is reported too.
        if self.reasons.iter().any(|known| known == why) {
            return None;
        }
        self.reasons.push(why.to_owned());
        self.add_trouble(why);
        Some(RecordingEvent::Stopped(format!("NOTHING IS BEING RECORDED: {why}")))
    }

    /// Returns the samples that a channel has lost since its last row; 0 in a gap, which is reported as a duration.
    fn count(&mut self, seq: u64, channel: String, lost: u64, now_ns: u64) -> u64 {
        // A restarted recorder restarts its row numbers and its counts.
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

    /// Adds losses outside gaps; reports them once per spell, after the rows of all channels have arrived.
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

    /// Sentence with the number of missing samples, as the run file counts them.
    fn missing(&self, so_far: &str) -> String {
        let samples = if self.all == 1 { "sample is" } else { "samples are" };
        let least = if self.restarted { "at least " } else { "" };
        format!("{least}{} {samples} missing in the run file{so_far}: `nims report` names the channels", self.all)
    }

    fn add_trouble(&mut self, why: &str) {
        // A recurring reason, such as a full disk, is listed once.
        if !self.troubles.iter().any(|known| known == why) {
            self.troubles.push(why.to_owned());
        }
    }

    fn names(&self, file: &Path) -> bool {
        let beginning = format!("{}: ", file.display());
        self.troubles.iter().any(|trouble| trouble.starts_with(&beginning))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use runlog::RunError;

    /// The whole numbers of a sentence.
    fn numbers(sentence: &str) -> Vec<u64> {
        sentence.split(' ').filter_map(|word| word.parse().ok()).collect()
    }

    #[test]
    fn each_gap_is_reported_once_and_kept_until_the_end() {
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
    fn a_file_that_could_not_be_written_has_its_reason() {
        let files = ["/runs/one/run.mcap.part", "/runs/one/run-0002.mcap.part"].map(Path::new);
        let stopped = RunError::Write { path: files[0].into(), why: "File too large".to_owned() }.to_string();
        let mut ledger = Ledger::default();
        ledger.record(RecorderStatus::STATE_FAILED, &stopped, 1);
        assert_eq!(files.map(|file| ledger.names(file)), [true, false]);
    }

    #[test]
    fn a_changed_reason_is_reported_once_and_a_removed_file_is_no_gap_of_a_second() {
        let (well, failed) = (RecorderStatus::STATE_RECORDING, RecorderStatus::STATE_FAILED);
        let removed = RunError::Removed { path: "/runs/one/run.mcap.part".into() }.to_string();
        let mut ledger = Ledger::default();
        for (reason, told) in [(&*removed, true), (&*removed, false), ("Permission denied", true), (&*removed, false)] {
            let said = ledger.record(failed, reason, 1);
            assert_eq!(said.is_some(), told, "{reason}: {said:?}");
        }
        assert_eq!(ledger.troubles, [removed.as_str(), "Permission denied"]);
        ledger.removed = true;
        let said = ledger.record(well, "", 1_000_000_001);
        assert!(matches!(&said, Some(RecordingEvent::Resumed(said)) if said.contains("removed")), "{said:?}");
        // The next gap starts with an empty list of reasons.
        assert!(ledger.record(failed, "Permission denied", 3).is_some());
        let said = ledger.record(well, "", 4);
        assert!(matches!(&said, Some(RecordingEvent::Resumed(said)) if !said.contains("removed")), "{said:?}");
        assert_eq!(ledger.troubles.len(), 2);
    }

    #[test]
    fn a_loss_is_reported_once_per_period() {
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
        assert_eq!(rows(2, [3, 0]), None, "rows of some channels are missing");
        assert_eq!(rows(3, [4, 1]), None);
        assert!(matches!(rows(4, [4, 2]), Some(RecordingEvent::Lost(said)) if numbers(&said) == [6]));
        assert_eq!(rows(5, [4, 2]), None, "no further loss");
        assert_eq!(rows(21, [5, 2]), None);
        assert!(matches!(rows(23, [0, 2]), Some(RecordingEvent::Lost(said)) if numbers(&said) == [7]), "total count");
        assert_eq!((ledger.lost, ledger.all), (7, 7));
        assert_eq!(ledger.count(1, "b".to_owned(), 1, 40 * SECOND_NS), 1, "restarted recorder");
        assert_eq!(ledger.count(2, "b".to_owned(), 1, 41 * SECOND_NS), 0);
        assert!(ledger.restarted && numbers(&ledger.missing("")) == [8], "{}", ledger.missing(""));
        // A bound, because the restarted recorder does not know what was lost before.
        let exact = Ledger { all: 8, ..Ledger::default() };
        assert!(ledger.missing("").ends_with(&exact.missing("")) && ledger.missing("") != exact.missing(""));
    }

    #[test]
    fn a_loss_while_nothing_is_recorded_is_reported_as_that() {
        let (well, full) = (RecorderStatus::STATE_RECORDING, RecorderStatus::STATE_DISK_FULL);
        let mut ledger = Ledger::default();
        assert!(ledger.record(full, "", 1).is_some());
        assert_eq!(ledger.count(1, "a".to_owned(), 7, 1), 0);
        assert!(ledger.record(well, "", 2).is_some());
        assert_eq!(ledger.count(2, "a".to_owned(), 9, 2), 0, "losses during the gap");
        assert_eq!(ledger.count(3, "a".to_owned(), 10, 2 + RESUMED_NS), 1);
    }
}
