//! A channel of a recording: what was written of it, what was not, and its last sample.

use messages::schema::Schema;
use messages::{RecorderGap, RecorderStatus, put_text};
use runlog::{ChannelId, ChannelSpec};

use crate::batch::Heard;

/// A channel of the session.
#[derive(Debug)]
pub struct Row {
    pub(crate) spec: ChannelSpec,
    /// Number and time of a sample can be read.
    has_header: bool,
    /// In the present file.
    pub(crate) id: Option<ChannelId>,
    messages: u64,
    bytes: u64,
    lost: u64,
    gaps: u64,
    worst_lag_ns: u64,
    /// The last sample that is in a file.
    last: Option<Heard>,
    /// The last sample that was written, and where it belongs: an error of the file can take it back.
    newest: Option<Heard>,
    newest_sample: Vec<u8>,
    /// What has been written since the file last settled: samples, and those that its gaps say are missing.
    unsettled: u64,
    unsettled_missing: u64,
    settled: Option<Heard>,
    /// Samples since the last one written that went to no file.
    unwritten: u64,
}

impl Row {
    pub(crate) fn new(spec: ChannelSpec) -> Self {
        let has_header = Schema::parse(&spec.schema).is_ok_and(|schema| schema.has_header());
        Self {
            spec,
            has_header,
            id: None,
            messages: 0,
            bytes: 0,
            lost: 0,
            gaps: 0,
            worst_lag_ns: 0,
            last: None,
            newest: None,
            newest_sample: Vec::new(),
            unsettled: 0,
            unsettled_missing: 0,
            settled: None,
            unwritten: 0,
        }
    }

    /// The channel.
    #[must_use]
    pub fn spec(&self) -> &ChannelSpec {
        &self.spec
    }

    /// Whether a sample begins with the header that all of this project's samples have.
    #[must_use]
    pub fn has_header(&self) -> bool {
        self.has_header
    }

    /// Samples written.
    #[must_use]
    pub fn messages(&self) -> u64 {
        self.messages
    }

    /// Samples that are not in the files.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Times that samples are missing.
    #[must_use]
    pub fn gaps(&self) -> u64 {
        self.gaps
    }

    pub(crate) fn lagged(&mut self, lag_ns: u64) {
        self.worst_lag_ns = self.worst_lag_ns.max(lag_ns);
    }

    /// Takes note of a sample that was written.
    pub(crate) fn written(&mut self, heard: &Heard, sample: &[u8]) {
        self.lost = self.lost.saturating_add(heard.missing);
        self.gaps += u64::from(heard.missing > 0);
        self.messages += 1;
        self.bytes += sample.len() as u64;
        self.unsettled += 1;
        self.unsettled_missing = self.unsettled_missing.saturating_add(heard.missing);
        (self.last, self.newest) = (Some(*heard), Some(*heard));
        self.newest_sample.clear();
        self.newest_sample.extend_from_slice(sample);
    }

    /// All that was written stays in the file.
    pub(crate) fn settle(&mut self) {
        (self.unsettled, self.unsettled_missing, self.settled) = (0, 0, self.last);
    }

    /// What was written since the file last settled is in no file; how many samples that are.
    pub(crate) fn take_back(&mut self) -> u64 {
        let lost = std::mem::take(&mut self.unsettled);
        self.messages -= lost;
        self.bytes -= lost * self.spec.size as u64;
        self.lost = self.lost.saturating_add(lost);
        // the gaps that were written there have to be written again
        let missing = std::mem::take(&mut self.unsettled_missing);
        self.gaps += u64::from(lost > 0 && self.unwritten == 0 && missing == 0);
        self.unwritten = self.unwritten.saturating_add(lost).saturating_add(missing);
        self.last = self.settled;
        lost
    }

    /// The last sample, which had been taken back, begins the next file; true if it had been.
    pub(crate) fn found_again(&mut self) -> bool {
        let taken_back = self.newest.is_some() && self.newest != self.last && self.unwritten > 0;
        if taken_back {
            (self.last, self.settled) = (self.newest, self.newest);
            self.messages += 1;
            self.bytes += self.spec.size as u64;
            self.lost = self.lost.saturating_sub(1);
            self.unwritten -= 1;
            self.gaps -= u64::from(self.unwritten == 0);
        }
        taken_back
    }

    /// Takes note of a sample that no file took, and of those that are missing before it.
    pub(crate) fn not_written(&mut self, heard: &Heard) {
        // a publisher of another build may number as it likes
        let lost = heard.missing.saturating_add(1);
        self.lost = self.lost.saturating_add(lost);
        self.gaps += u64::from(self.unwritten == 0);
        self.unwritten = self.unwritten.saturating_add(lost);
    }

    /// The hole between the last sample written and the next, `heard`, as it stands in the file.
    pub(crate) fn gap(&mut self, heard: &Heard, cause: u8) -> Option<RecorderGap> {
        let unwritten = std::mem::take(&mut self.unwritten);
        let (missing, cause) = match heard.missing.saturating_add(unwritten) {
            0 => return None,
            missing => (missing, if unwritten > 0 { cause } else { RecorderGap::CAUSE_OVERFLOW }),
        };
        self.unsettled_missing = self.unsettled_missing.saturating_add(unwritten);
        let (last_seq, last_ns) = self.last.map_or((0, 0), |last| (last.seq, last.logged_ns));
        let (next_seq, next_ns) = (heard.seq, heard.logged_ns);
        let mut gap = RecorderGap { missing, last_seq, next_seq, last_ns, next_ns, cause, ..RecorderGap::default() };
        put_text(&mut gap.channel, &self.spec.name);
        Some(gap)
    }

    /// The last sample, if the channel has been silent since `before_ns`.
    pub(crate) fn silent_since(&self, before_ns: u64) -> Option<(Heard, &[u8])> {
        let newest = self.newest.filter(|newest| newest.logged_ns < before_ns)?;
        Some((newest, &self.newest_sample))
    }

    /// What `recorder/status` says of the channel.
    pub(crate) fn status(&self) -> RecorderStatus {
        let mut status = RecorderStatus {
            messages: self.messages,
            bytes: self.bytes,
            lost: self.lost,
            gaps: self.gaps,
            worst_lag_ns: self.worst_lag_ns,
            ..RecorderStatus::default()
        };
        put_text(&mut status.channel, &self.spec.name);
        status
    }
}
