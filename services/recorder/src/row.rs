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
    /// The last sample written, and where it belongs.
    last: Option<Heard>,
    last_sample: Vec<u8>,
    /// Samples since the last one written that went to no file.
    unwritten: u64,
}

impl Row {
    pub(crate) fn new(spec: ChannelSpec) -> Self {
        let has_header = Schema::parse(&spec.schema).is_ok_and(|schema| schema.has_header());
        let (messages, bytes, lost, gaps, worst_lag_ns, unwritten) = (0, 0, 0, 0, 0, 0);
        let (id, last, last_sample) = (None, None, Vec::new());
        Self { spec, has_header, id, messages, bytes, lost, gaps, worst_lag_ns, last, last_sample, unwritten }
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

    /// Takes note of a sample that is in the file.
    pub(crate) fn written(&mut self, heard: &Heard, sample: &[u8]) {
        self.lost = self.lost.saturating_add(heard.missing);
        self.gaps += u64::from(heard.missing > 0);
        self.messages += 1;
        self.bytes += sample.len() as u64;
        self.last = Some(*heard);
        self.last_sample.clear();
        self.last_sample.extend_from_slice(sample);
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
            missing => (missing, if unwritten > 0 { cause } else { RecorderGap::CAUSE_NOT_HEARD }),
        };
        let (last_seq, last_ns) = self.last.map_or((0, 0), |last| (last.seq, last.logged_ns));
        let (next_seq, next_ns) = (heard.seq, heard.logged_ns);
        let mut gap = RecorderGap { missing, last_seq, next_seq, last_ns, next_ns, cause, ..RecorderGap::default() };
        put_text(&mut gap.channel, &self.spec.name);
        Some(gap)
    }

    /// The last sample, if the channel has been silent since `before_ns`.
    pub(crate) fn silent_since(&self, before_ns: u64) -> Option<(Heard, &[u8])> {
        let last = self.last.filter(|last| last.logged_ns < before_ns)?;
        Some((last, &self.last_sample))
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
