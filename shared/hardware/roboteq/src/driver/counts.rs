//! Counts that no checksum protects.

use drives::{CommandName, CountBound, Error, reply_text};
use serial::Transport;

use super::Bus;
use super::cycle::NOISY;
use super::filter::middle;
use super::parts::Answers;
use crate::codec::{AXES, Name};

/// Time between two reads of a counter by the controller that were asked one after the other, ns: its loop takes a
/// millisecond.
const SCAN_NS: u64 = 1_000_000;
/// Bytes of a question about the counters.
const ASK_BYTES: u64 = 3;
/// A controller may read its counters this much later than it was asked, ns, while the motor moves on.
const SAMPLE_JITTER_NS: u64 = 20_000_000;
/// Share of its highest speed by which a motor changes it from one sample to the next without being asked again. Both
/// answers may have the same wrong digit.
const ABRUPT: u64 = 8;

/// A motor can have moved from one count to the other in this time, without any margin.
fn agree(bound: CountBound, one: i32, other: i32, apart_ns: u64) -> bool {
    CountBound { margin: 1.0, ..bound }.explains(f64::from(other.wrapping_sub(one)), apart_ns + SCAN_NS)
}

impl<T: Transport> Bus<T> {
    /// The counters of an answer; the one of a motor that is not connected stays 0.
    fn counters(&self, answers: &Answers, nth: usize) -> Option<[i32; AXES]> {
        match self.config.axes {
            1 => answers.single(Name::Counts, nth).map(|count| [count, 0]),
            _ => answers.pair(Name::Counts, nth),
        }
    }

    /// The two answers about the counters, where they agree.
    fn two_counters(&self, answers: &Answers) -> Option<[[i32; AXES]; 2]> {
        let [first, second] = [self.counters(answers, 0)?, self.counters(answers, 1)?];
        let apart_ns = ASK_BYTES * self.byte_ns;
        let same = self.axes().all(|axis| agree(self.config.bound, first[axis], second[axis], apart_ns));
        same.then_some([first, second])
    }

    /// A motion that no earlier one leads to is used once it was read again.
    fn is_sure(&mut self, moved: [i32; AXES], raw: [i32; AXES], passed_ns: u64, at_ns: u64) -> bool {
        let Some(ahead) = self.track.ahead(passed_ns) else { return true };
        let bound = self.config.bound;
        let all =
            |from: [i32; AXES], to: [i32; AXES], ns| self.axes().all(|axis| agree(bound, from[axis], to[axis], ns));
        let expected = all(ahead, moved, passed_ns / ABRUPT);
        let again =
            self.track.abrupt.is_some_and(|(before, before_ns)| all(before, raw, at_ns.saturating_sub(before_ns)));
        self.track.abrupt = (!expected && !again).then_some((raw, at_ns));
        expected || again
    }

    /// The error of counters that are not used.
    fn unclear_counters(&mut self, said: &'static str) -> Error {
        self.counters.garbled += 1;
        let asked = CommandName { words: "read counters (?C)", code: None };
        let said = reply_text(format_args!("{said}"));
        self.error(|port, unit| Error::Unexpected { port, unit, asked, said })
    }

    /// Uses the two answers about the counters.
    pub(super) fn use_counts(&mut self, answers: &Answers) -> Result<(), Error> {
        let Some([first, second]) = self.two_counters(answers) else {
            self.noisy = NOISY;
            return Err(self.unclear_counters("two that disagree"));
        };
        let at_ns = answers.counts_at_ns;
        let Some(last) = self.track.raw else {
            if self.report.setups == 0 && self.report.reboots == 0 {
                self.report.counts.value = first.map(i64::from);
            }
            self.report.counts.at_ns = at_ns;
            self.track.raw = Some(first);
            return Ok(());
        };
        let passed_ns = at_ns.saturating_sub(self.report.counts.at_ns);
        let ahead = self.track.ahead(passed_ns);
        let moved: [i32; AXES] = std::array::from_fn(|axis| {
            let [first, second] = [first, second].map(|raw| raw[axis].wrapping_sub(last[axis]));
            ahead.map_or(first, |ahead| middle(first, second, ahead[axis]))
        });
        let raw = std::array::from_fn(|axis| last[axis].wrapping_add(moved[axis]));
        if !self.is_sure(moved, raw, passed_ns, at_ns) {
            return Err(self.unclear_counters("an abrupt change, read again"));
        }
        let since_ns = passed_ns + SAMPLE_JITTER_NS;
        let explains = |axis: &usize| self.config.bound.explains(f64::from(moved[*axis]), since_ns);
        if let Some(axis) = self.axes().find(|axis| !explains(axis)) {
            if !std::mem::replace(&mut self.track.held_back, true) {
                // A controller that has restarted begins at zero, which looks just like this: its variables tell.
                self.setup.doubt();
                let counts = i64::from(moved[axis]);
                return Err(self.error(|port, unit| Error::EncoderJump { port, unit, axis, counts }));
            }
            // It has not restarted; whether the count is credible is for the caller to judge.
            self.report.jumps += 1;
            self.track.pace = None;
        } else if passed_ns > 0 {
            self.track.pace = Some(moved.map(|counts| f64::from(counts) / passed_ns as f64));
        }
        for (total, moved) in self.report.counts.value.iter_mut().zip(moved) {
            *total += i64::from(moved);
        }
        self.report.counts.at_ns = at_ns;
        (self.track.raw, self.track.held_back) = (Some(raw), false);
        Ok(())
    }
}
