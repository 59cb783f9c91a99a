//! A channel of the run: its samples as types of this build, and their comparison with the recomputed ones.

use messages::Message;
use runlog::{Conversion, RecordedChannel, RecordedSample};
use serde::Serialize;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// Reason why a sample was not compared.
pub(super) type SkipReason = &'static str;

/// Its type is a different one or cannot be decoded.
const DEFINITION: SkipReason = "recorded by a build with another definition";
/// The process or the recording ended before the sample that names its inputs.
const ALONE: SkipReason = "the sample that names its inputs was not recorded";

/// The first sample that differs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// Control cycle.
    pub cycle: u64,
    /// Time since the start of the run, s.
    pub time_s: f64,
    /// Path of the field, e.g. `velocity_m_s[2]`.
    pub field: String,
    /// Recorded value.
    pub recorded: String,
    /// Recomputed value.
    pub replayed: String,
}

/// Result of the comparison for one channel.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct ChannelComparison {
    /// Channel name.
    pub channel: String,
    /// Number of samples in the run.
    pub recorded: u64,
    /// Number of samples that are equal bit for bit.
    pub equal: u64,
    /// Number of samples that differ.
    pub different: u64,
    /// Number of samples that were not compared, by reason.
    pub not_compared: BTreeMap<SkipReason, u64>,
    /// First sample that differs.
    pub first: Option<Difference>,
    /// Whether the definition of the message has changed since; only common fields were compared.
    pub definition_changed: bool,
}

/// The samples of one channel.
pub(super) struct Channel<T> {
    tally: ChannelComparison,
    known: Option<Arc<RecordedChannel>>,
    waiting: VecDeque<(u64, T)>,
    t0_ns: u64,
}

impl<T: Message> Channel<T> {
    pub(super) fn new(name: &str) -> Self {
        let tally = ChannelComparison { channel: name.to_owned(), ..ChannelComparison::default() };
        Self { tally, known: None, waiting: VecDeque::new(), t0_ns: 0 }
    }

    /// Decodes a recorded sample.
    pub(super) fn read(&mut self, recorded: &RecordedSample<'_>, t0_ns: u64) -> Option<T> {
        self.t0_ns = t0_ns;
        self.tally.recorded += 1;
        if !self.known.as_ref().is_some_and(|channel| Arc::ptr_eq(channel, recorded.channel)) {
            self.known = Some(Arc::clone(recorded.channel));
        }
        let sample = recorded.decode();
        match &sample {
            Some(_) => self.tally.definition_changed |= self.conversion().is_some_and(|by| !by.is_same()),
            None => self.skip(DEFINITION),
        }
        sample
    }

    fn conversion(&self) -> Option<&Conversion> {
        self.known.as_ref()?.conversion::<T>()
    }

    /// Stores a sample until all its inputs have been read too.
    pub(super) fn wait(&mut self, time_ns: u64, sample: T) {
        self.waiting.push_back((time_ns, sample));
    }

    /// Stores a sample as [`Channel::wait`] does, in the order of publication within an incarnation. The file is sorted
    /// by stamps, and the first samples of a run may have none.
    pub(super) fn wait_in_order(&mut self, time_ns: u64, sample: T, incarnation: impl Fn(&T) -> u32) {
        let later = |(_, other): &&(u64, T)| {
            incarnation(other) == incarnation(&sample) && other.header().seq > sample.header().seq
        };
        let behind = self.waiting.iter().rev().take_while(later).count();
        self.waiting.insert(self.waiting.len() - behind, (time_ns, sample));
    }

    /// Returns the next sample that was published by then.
    pub(super) fn next_due(&mut self, until_ns: u64) -> Option<(u64, T)> {
        if self.waiting.front()?.0 > until_ns { None } else { self.waiting.pop_front() }
    }

    pub(super) fn skip(&mut self, why: SkipReason) {
        *self.tally.not_compared.entry(why).or_default() += 1;
    }

    /// Compares all bits except those that publication sets.
    pub(super) fn compare(&mut self, time_ns: u64, recorded: &T, mut replayed: T) {
        replayed.header_mut().take_over_publication(recorded.header());
        let (was, is) = (bytemuck::bytes_of(recorded), bytemuck::bytes_of(&replayed));
        let Some(conversion) = self.conversion() else { return };
        if conversion.agree(was, is) {
            self.tally.equal += 1;
            return;
        }
        let first = self.tally.first.is_none().then(|| conversion.first_difference::<T>(was, is).unwrap_or_default());
        self.tally.different += 1;
        if let Some(first) = first {
            let (cycle, time_s) = (recorded.header().cycle, self.time_s(time_ns));
            let (field, recorded, replayed) = first;
            self.tally.first = Some(Difference { cycle, time_s, field, recorded, replayed });
        }
    }

    /// Compares one text of a sample.
    pub(super) fn compare_text(&mut self, time_ns: u64, cycle: u64, field: &str, recorded: &str, replayed: &str) {
        if recorded == replayed {
            self.tally.equal += 1;
            return;
        }
        self.tally.different += 1;
        let time_s = self.time_s(time_ns);
        self.tally.first.get_or_insert_with(|| Difference {
            cycle,
            time_s,
            field: field.to_owned(),
            recorded: recorded.to_owned(),
            replayed: replayed.to_owned(),
        });
    }

    fn time_s(&self, time_ns: u64) -> f64 {
        time_ns.saturating_sub(self.t0_ns) as f64 * 1e-9
    }

    /// Returns the result of a channel that also carries samples which are not recomputed.
    pub(super) fn end_of_some(mut self) -> Option<ChannelComparison> {
        self.tally.recorded = self.tally.equal + self.tally.different;
        self.end()
    }

    /// Returns the result, if anything was recorded.
    pub(super) fn end(mut self) -> Option<ChannelComparison> {
        let tally = &mut self.tally;
        let accounted = tally.equal + tally.different + tally.not_compared.values().sum::<u64>();
        if tally.recorded > accounted {
            *tally.not_compared.entry(ALONE).or_default() += tally.recorded - accounted;
        }
        (tally.recorded > 0).then_some(self.tally)
    }
}

/// The last samples of a channel, found by a number that they contain.
pub(super) struct History<T> {
    /// Number and time of each sample; separate from the samples, because they are searched often.
    keys: VecDeque<(u64, u64)>,
    samples: VecDeque<T>,
}

/// Capacity: five seconds at 200 Hz, far more than any lookup needs.
const KEPT: usize = 1024;

impl<T> History<T> {
    pub(super) fn new() -> Self {
        Self { keys: VecDeque::with_capacity(KEPT), samples: VecDeque::with_capacity(KEPT) }
    }

    pub(super) fn push(&mut self, number: u64, time_ns: u64, sample: T) {
        if self.keys.len() == KEPT {
            self.keys.pop_front();
            self.samples.pop_front();
        }
        self.keys.push_back((number, time_ns));
        self.samples.push_back(sample);
    }

    /// Returns the sample with this number; if a process restarted its count, the one nearest in time.
    pub(super) fn find(&self, number: u64, time_ns: u64) -> Option<&T> {
        // The samples are in the order of time, so the nearest of this number is the last one before or the first
        // after.
        let begin = self.keys.partition_point(|(_, its_ns)| *its_ns <= time_ns);
        let is = |at: &usize| self.keys[*at].0 == number;
        let (before, after) = ((0..begin).rev().find(is), (begin..self.keys.len()).find(is));
        let at = before.into_iter().chain(after).min_by_key(|at| self.keys[*at].1.abs_diff(time_ns))?;
        self.samples.get(at)
    }
}
