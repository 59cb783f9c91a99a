//! A channel of a recording: counts of its written and lost samples, and its last sample.

use messages::blob::BlobType;
use messages::{RecorderGap, RecorderStatus, put_text};
use runlog::{ChannelId, ChannelSpec};

use crate::batch::ReceivedSample;

/// A channel of the session.
#[derive(Debug)]
pub struct Row {
    pub(crate) spec: ChannelSpec,
    is_blob: bool,
    /// Id of the channel in the present file.
    pub(crate) id: Option<ChannelId>,
    messages: u64,
    bytes: u64,
    lost: u64,
    gaps: u64,
    worst_lag_ns: u64,
    /// The last sample that is in a file.
    last: Option<ReceivedSample>,
    /// The last sample that was written; an error of the file can revert it.
    newest: Option<ReceivedSample>,
    newest_sample: Vec<u8>,
    /// Number of samples written since the file last settled.
    unsettled: u64,
    /// Bytes of these samples.
    unsettled_bytes: u64,
    /// Number of missing samples in the gaps written since the file last settled.
    unsettled_missing: u64,
    /// The last sample when the file last settled.
    settled: Option<ReceivedSample>,
    /// Number of samples since the last written one that are in no file.
    unwritten: u64,
}

impl Row {
    pub(crate) fn new(spec: ChannelSpec) -> Self {
        Self {
            is_blob: BlobType::of_name(&spec.type_name).is_some(),
            spec,
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
            unsettled_bytes: 0,
            unsettled_missing: 0,
            settled: None,
            unwritten: 0,
        }
    }

    /// Returns the specification of the channel.
    #[must_use]
    pub fn spec(&self) -> &ChannelSpec {
        &self.spec
    }

    /// Returns whether the samples are blobs.
    #[must_use]
    pub fn is_blob(&self) -> bool {
        self.is_blob
    }

    /// Returns the number of written samples.
    #[must_use]
    pub fn messages(&self) -> u64 {
        self.messages
    }

    /// Returns the number of samples that are not in the files.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Returns the number of gaps.
    #[must_use]
    pub fn gaps(&self) -> u64 {
        self.gaps
    }

    pub(crate) fn record_lag(&mut self, lag_ns: u64) {
        self.worst_lag_ns = self.worst_lag_ns.max(lag_ns);
    }

    /// Records a sample that was written.
    pub(crate) fn record_written(&mut self, received: &ReceivedSample, sample: &[u8]) {
        self.lost = self.lost.saturating_add(received.missing);
        self.gaps += u64::from(received.missing > 0);
        self.messages += 1;
        self.bytes += sample.len() as u64;
        self.unsettled += 1;
        self.unsettled_bytes += sample.len() as u64;
        self.unsettled_missing = self.unsettled_missing.saturating_add(received.missing);
        (self.last, self.newest) = (Some(*received), Some(*received));
        self.newest_sample.clear();
        self.newest_sample.extend_from_slice(sample);
    }

    /// Marks all written samples as permanent in the file.
    pub(crate) fn settle(&mut self) {
        (self.unsettled, self.unsettled_bytes, self.unsettled_missing, self.settled) = (0, 0, 0, self.last);
    }

    /// Reverts the samples written since the file last settled, which are in no file; returns their number and bytes.
    pub(crate) fn take_back(&mut self) -> (u64, u64) {
        let lost = std::mem::take(&mut self.unsettled);
        let bytes = std::mem::take(&mut self.unsettled_bytes);
        self.messages -= lost;
        self.bytes -= bytes;
        self.lost = self.lost.saturating_add(lost);
        // Gaps written since then must be written again.
        let missing = std::mem::take(&mut self.unsettled_missing);
        self.gaps += u64::from(lost > 0 && self.unwritten == 0 && missing == 0);
        self.unwritten = self.unwritten.saturating_add(lost).saturating_add(missing);
        self.last = self.settled;
        (lost, bytes)
    }

    /// Records that the newest sample starts the next file, if it was reverted; returns its bytes then.
    pub(crate) fn restore_newest(&mut self) -> Option<u64> {
        let taken_back = self.newest.is_some() && self.newest != self.last && self.unwritten > 0;
        if taken_back {
            (self.last, self.settled) = (self.newest, self.newest);
            self.messages += 1;
            self.bytes += self.newest_sample.len() as u64;
            self.lost = self.lost.saturating_sub(1);
            self.unwritten -= 1;
            self.gaps -= u64::from(self.unwritten == 0);
        }
        taken_back.then_some(self.newest_sample.len() as u64)
    }

    /// Records a sample that could not be written, and the missing ones before it.
    pub(crate) fn record_unwritten(&mut self, received: &ReceivedSample) {
        // Saturate: a publisher outside this project may send any sequence numbers.
        let lost = received.missing.saturating_add(1);
        self.lost = self.lost.saturating_add(lost);
        self.gaps += u64::from(self.unwritten == 0);
        self.unwritten = self.unwritten.saturating_add(lost);
    }

    /// Returns the gap between the last written sample and the next one, `received`, for the file.
    pub(crate) fn gap(&mut self, received: &ReceivedSample, cause: u8) -> Option<RecorderGap> {
        let unwritten = std::mem::take(&mut self.unwritten);
        let (missing, cause) = match received.missing.saturating_add(unwritten) {
            0 => return None,
            missing => (missing, if unwritten > 0 { cause } else { RecorderGap::CAUSE_OVERFLOW }),
        };
        self.unsettled_missing = self.unsettled_missing.saturating_add(unwritten);
        let (last_seq, last_ns) = self.last.map_or((0, 0), |last| (last.seq, last.logged_ns));
        let (next_seq, next_ns) = (received.seq, received.logged_ns);
        let mut gap = RecorderGap { missing, last_seq, next_seq, last_ns, next_ns, cause, ..RecorderGap::default() };
        put_text(&mut gap.channel, &self.spec.name);
        Some(gap)
    }

    /// Returns the last sample if none was published since `before_ns`.
    pub(crate) fn silent_since(&self, before_ns: u64) -> Option<(ReceivedSample, &[u8])> {
        let newest = self.newest.filter(|newest| newest.logged_ns < before_ns)?;
        Some((newest, &self.newest_sample))
    }

    /// Returns the sample of `recorder/status` for the channel.
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
