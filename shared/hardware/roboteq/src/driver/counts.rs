//! Counts that no checksum protects.

use drives::{CommandName, Error, reply_text, within};
use serial::Transport;

use super::Bus;
use super::cycle::NOISY;
use super::filter::middle;
use super::parts::Answers;
use crate::codec::{AXES, Name};

/// Bytes of a question about the counters.
const ASK_BYTES: u64 = 3;
/// A controller may read its counters this much later than it was asked, ns, while the motor moves on.
const SAMPLE_JITTER_NS: u64 = 20_000_000;
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
        let same = self
            .axes()
            .all(|axis| within(self.config.bound, i64::from(second[axis].wrapping_sub(first[axis])), apart_ns));
        same.then_some([first, second])
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
        let Some(last) = self.counted.raw else {
            if self.report.setups == 0 && self.report.reboots == 0 {
                self.report.counts.value = first.map(i64::from);
            }
            self.report.counts.at_ns = at_ns;
            self.counted.raw = Some(first);
            return Ok(());
        };
        let passed_ns = at_ns.saturating_sub(self.report.counts.at_ns);
        let ahead = self.counted.motion.ahead(passed_ns);
        let moved: [i32; AXES] = std::array::from_fn(|axis| {
            let [first, second] = [first, second].map(|raw| raw[axis].wrapping_sub(last[axis]));
            ahead.map_or(first, |ahead| middle(first, second, ahead[axis] as i32))
        });
        let raw = std::array::from_fn(|axis| last[axis].wrapping_add(moved[axis]));
        // Both answers may have the same wrong digit.
        if !self.counted.motion.is_sure(self.config.bound, moved.map(i64::from), passed_ns, at_ns) {
            return Err(self.unclear_counters("an abrupt change, read again"));
        }
        let since_ns = passed_ns + SAMPLE_JITTER_NS;
        let explains = |axis: &usize| self.config.bound.explains(f64::from(moved[*axis]), since_ns);
        if let Some(axis) = self.axes().find(|axis| !explains(axis)) {
            if !std::mem::replace(&mut self.counted.held_back, true) {
                // A controller that has restarted begins at zero, which looks just like this: its variables tell.
                self.setup.doubt();
                let counts = i64::from(moved[axis]);
                return Err(self.error(|port, unit| Error::EncoderJump { port, unit, axis, counts }));
            }
            // It has not restarted; whether the count is credible is for the caller to judge.
            self.report.jumps += 1;
            self.counted.motion.forget();
        } else {
            self.counted.motion.record(moved.map(i64::from), passed_ns);
        }
        for (total, moved) in self.report.counts.value.iter_mut().zip(moved) {
            *total += i64::from(moved);
        }
        self.report.counts.at_ns = at_ns;
        (self.counted.raw, self.counted.held_back) = (Some(raw), false);
        Ok(())
    }
}
