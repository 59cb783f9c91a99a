//! How fast and how completely a drive answered.

use crate::question::{Asked, begin_of, first_question};
use crate::recording::{Chunk, Recording, Side};
use serde_json::{Value, json};
use std::fmt;

/// Bits of a byte on the wire: start, eight, stop.
const BITS: f64 = 10.0;

/// Longest time between two pieces of one question, s: what the recorder and the machine may put between them. A
/// program that asks again has waited longer for the answer.
const PIECES_S: f64 = 0.001;
/// Twice the steps of the times of a recording, s.
const ROUNDED_S: f64 = 0.000_002;

/// Statistics of a recording.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Timing {
    /// Length of the recording, s.
    pub recorded_s: f64,
    /// Questions: bytes of the program that a drive answers, until it answered or the program paused. Several questions
    /// that were sent together are one here.
    pub questions: usize,
    /// Those that nothing followed before the next question.
    pub unanswered: usize,
    /// From the end of a question to the begin of its answer on the wire, s: least, median, 99 %, largest. Of questions
    /// that were sent together, the first one that has an answer. The latency of an adapter is part of it.
    pub turnaround_s: Option<[f64; 4]>,
    /// Longest pause within an answer, s.
    pub longest_pause_s: f64,
    /// Bytes of the drive before the first question: it sends without being asked.
    pub unasked_bytes: usize,
    /// The baud rate of the recording, if the bytes came faster than it allows. Their time on the wire is not counted
    /// then.
    pub outrun_baud: Option<u32>,
}

/// Computes the statistics of a recording.
#[must_use]
pub fn timing(recording: &Recording) -> Timing {
    let byte_s = if recording.baud > 0 { BITS / f64::from(recording.baud) } else { 0.0 };
    let (timing, outran) = measured(recording, byte_s);
    if 2 * outran <= timing.questions - timing.unanswered {
        return timing;
    }
    Timing { outrun_baud: Some(recording.baud), ..measured(recording, 0.0).0 }
}

/// Statistics for a wire on which a byte takes `byte_s`, and the number of answers that came faster than that.
fn measured(recording: &Recording, byte_s: f64) -> (Timing, usize) {
    let mut timing = Timing { recorded_s: recording.chunks.last().map_or(0.0, |last| last.at_s), ..Timing::default() };
    let (mut turnarounds_s, mut outran) = (Vec::new(), 0);
    let mut exchange = Exchange::default();
    let mut close = |exchange: &Exchange| {
        if let Some(asked) = exchange.asked() {
            timing.questions += 1;
            timing.unanswered += usize::from(exchange.answer.bytes.is_empty());
            turnarounds_s.extend(asked.turnaround_s);
            outran += usize::from(asked.outran);
        }
        timing.longest_pause_s = timing.longest_pause_s.max(exchange.longest_pause_s);
    };
    for chunk in &recording.chunks {
        match chunk.side {
            Side::Program => {
                if exchange.is_over(chunk.at_s) {
                    close(&std::mem::take(&mut exchange));
                }
                exchange.question.send(chunk, byte_s);
            }
            Side::Drive if exchange.question.bytes.is_empty() => timing.unasked_bytes += chunk.bytes.len(),
            Side::Drive => exchange.answered(chunk, byte_s),
        }
    }
    close(&exchange);
    turnarounds_s.sort_by(f64::total_cmp);
    let at = |share: f64| turnarounds_s[((turnarounds_s.len() - 1) as f64 * share).round() as usize];
    timing.turnaround_s = (!turnarounds_s.is_empty()).then(|| [0.0, 0.5, 0.99, 1.0].map(at));
    (timing, outran)
}

/// Bytes of one side, with the time at which each is over on the wire, s.
#[derive(Debug, Default)]
struct Sent {
    bytes: Vec<u8>,
    over_s: Vec<f64>,
}

impl Sent {
    /// Bytes that were written at the time of the chunk: they go out one after the other.
    fn send(&mut self, chunk: &Chunk, byte_s: f64) {
        let mut over_s = self.over_s.last().map_or(chunk.at_s, |free_s| free_s.max(chunk.at_s));
        for byte in &chunk.bytes {
            over_s += byte_s;
            self.bytes.push(*byte);
            self.over_s.push(over_s);
        }
    }

    /// When the first of the bytes was over that were sent without a pause up to the one at `place`.
    fn sent_with(&self, place: usize, byte_s: f64) -> f64 {
        let follows = |pair: &&[f64]| pair[1] - pair[0] < 2.0 * byte_s + ROUNDED_S;
        let before = self.over_s[..=place].windows(2).rev().take_while(follows).count();
        self.over_s[place - before]
    }
}

/// A question, or several that were sent together, and what the drive said after it.
#[derive(Debug, Default)]
struct Exchange {
    question: Sent,
    answer: Sent,
    longest_pause_s: f64,
    byte_s: f64,
}

/// What an exchange shows.
struct Shown {
    turnaround_s: Option<f64>,
    /// The bytes came faster than the wire allows.
    outran: bool,
}

impl Exchange {
    /// True if bytes of the program at that time are another question.
    fn is_over(&self, at_s: f64) -> bool {
        !self.answer.bytes.is_empty() || self.question.over_s.last().is_some_and(|over_s| at_s > over_s + PIECES_S)
    }

    /// Bytes that were read at the time of the chunk: the last of them was just over.
    fn answered(&mut self, chunk: &Chunk, byte_s: f64) {
        let pause_s = self.answer.over_s.last().map_or(0.0, |last_s| chunk.at_s - last_s);
        self.longest_pause_s = self.longest_pause_s.max(pause_s);
        let count = chunk.bytes.len();
        self.answer.bytes.extend(&chunk.bytes);
        self.answer.over_s.extend((1..=count).map(|byte| chunk.at_s - (count - byte) as f64 * byte_s));
        self.byte_s = byte_s;
    }

    /// What it shows; `None` if the program asked nothing.
    fn asked(&self) -> Option<Shown> {
        let Asked::Question { end, answer } = first_question(&self.question.bytes) else { return None };
        let asked_s = *self.question.over_s.get(end.checked_sub(1)?)?;
        let begin = begin_of(&self.answer.bytes, &self.question.bytes, answer);
        // What was read before the question was over answers another one.
        let over_s = begin.map(|place| self.answer.sent_with(place, self.byte_s)).filter(|over_s| *over_s >= asked_s);
        let outran = begin.is_some_and(|place| {
            let least_s = asked_s + (self.answer.bytes.len() - place) as f64 * self.byte_s;
            self.answer.over_s.last().is_some_and(|last_s| *last_s < least_s)
        });
        Some(Shown { turnaround_s: over_s.map(|over_s| (over_s - self.byte_s - asked_s).max(0.0)), outran })
    }
}

impl Timing {
    /// As one object.
    #[must_use]
    pub fn to_json(&self) -> Value {
        json!({
            "recorded_s": self.recorded_s,
            "questions": self.questions,
            "unanswered": self.unanswered,
            "turnaround_s": self.turnaround_s,
            "longest_pause_s": self.longest_pause_s,
            "unasked_bytes": self.unasked_bytes,
            "outrun_baud": self.outrun_baud,
        })
    }
}

impl fmt::Display for Timing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} questions in {:.1} s, {} without an answer", self.questions, self.recorded_s, self.unanswered)?;
        if let Some(turnaround_s) = self.turnaround_s {
            let [least, median, most, largest] = turnaround_s.map(|s| 1e3 * s);
            write!(f, "\nan answer begins after {least:.2} to {largest:.2} ms, median {median:.2}, 99 % {most:.2} ms")?;
            write!(f, "\nlongest pause within an answer {:.2} ms", 1e3 * self.longest_pause_s)?;
            write!(f, "\n[motor_box] turnaround_s = {:.6} makes the virtual drive as fast", turnaround_s[1])?;
        }
        if let Some(baud) = self.outrun_baud {
            write!(
                f,
                "\nbytes came faster than {baud} baud allow, so their time is not counted: record USB with --usb"
            )?;
        }
        if self.unasked_bytes > 0 {
            write!(f, "\n{} bytes came before the first question", self.unasked_bytes)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::HEAD;

    fn of(text: &str) -> Timing {
        timing(&Recording::parse(&format!("{HEAD}\n{text}")).unwrap())
    }

    /// A line of a recording with this text.
    fn line(at_s: f64, side: Side, text: &str) -> String {
        format!("{}\n", Chunk { at_s, side, bytes: text.as_bytes().to_vec() })
    }

    fn is_about(found: Option<[f64; 4]>, least_s: f64, largest_s: f64) {
        let [least, _, _, largest] = found.unwrap();
        assert!((least - least_s).abs() < 1e-6 && (largest - largest_s).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn questions_answers_and_pauses_are_told_apart() {
        // 100 000 baud: 0.1 ms per byte.
        let found = of(
            "# baud 100000\n0.5 < ff\n1.0 > 01 02\n1.0012 < 0a\n1.002 < 0b 0c\n2.0 > 01\n2.00005 > 02\n3.0 > 01\n3.0031 < 8d\n4.0 > 09 01\n",
        );
        assert_eq!((found.questions, found.unanswered, found.unasked_bytes), (4, 2, 1));
        is_about(found.turnaround_s, 0.0009, 0.0029);
        assert!((found.longest_pause_s - 0.0008).abs() < 1e-9);
        assert_eq!((found.recorded_s, found.outrun_baud), (4.0, None));
        assert_eq!(timing(&Recording { baud: 0, chunks: Vec::new() }), Timing::default());
    }

    #[test]
    fn an_answer_counts_from_the_first_question_of_those_sent_together() {
        let [ask, say] = [Side::Program, Side::Drive];
        // 100 000 baud: 0.1 ms per byte. The first question of 5 bytes is over after 0.5 ms, answered 2 ms later, while
        // the others go out until 4.2 ms.
        let together =
            line(1.0, ask, "f 77\nr axis0.error\nr vbus_voltage\nf 78\n") + &line(1.0035, say, "in valid\r\n");
        let found = of(&format!("# baud 100000\n{together}"));
        is_about(found.turnaround_s, 0.002, 0.002);
        assert_eq!((found.questions, found.unanswered), (1, 0));
        // Silent commands come first, and in pieces that the recorder read apart. Alone they are no question.
        let silent = line(1.0, ask, "v 0 1\n") + &line(1.0003, ask, "v 1 1\nf 7\n") + &line(1.0056, say, "0.0 0.0\r\n");
        let found = of(&format!("# baud 100000\n{silent}{}", line(2.0, ask, "v 0 1\n")));
        is_about(found.turnaround_s, 0.0031, 0.0031);
        assert_eq!((found.questions, found.unanswered), (1, 0));
        // Commands that are acknowledged.
        let acknowledged = line(1.0, ask, "!M 5 5\r?V\r?C\r") + &line(1.0029, say, "+\r");
        is_about(of(&format!("# baud 100000\n{acknowledged}")).turnaround_s, 0.002, 0.002);
        // What was read before the first question was over answers an older one.
        let older = line(1.0, ask, "?V\r?C\r")
            + &line(1.0002, say, "+\r")
            + &line(2.0, ask, "?V\r")
            + &line(2.0015, say, "V\r");
        is_about(of(&format!("# baud 100000\n{older}")).turnaround_s, 0.001, 0.001);
    }

    #[test]
    fn a_unit_behind_an_adapter_counts_by_its_own_answer() {
        let [ask, say] = [Side::Program, Side::Drive];
        let frames = "can send 8001 11 E B F\ncan send 8002 11 E B F\n";
        let text = line(1.0, ask, frames) + &line(1.0001, say, "OK\r\nOK\r\n") + &line(1.002, say, "rcv 0180 21\r\n");
        let found = of(&format!("# baud 0\n{text}"));
        is_about(found.turnaround_s, 0.002, 0.002);
        // The adapter alone tells nothing about a unit.
        let found = of(&format!("# baud 0\n{}", line(1.0, ask, frames) + &line(1.0001, say, "OK\r\n")));
        assert_eq!((found.questions, found.unanswered, found.turnaround_s), (1, 0, None));
    }

    #[test]
    fn a_usb_port_that_was_recorded_with_a_baud_rate_is_found() {
        let [ask, say] = [Side::Program, Side::Drive];
        let answer = "rcv 0180 2104000a11000000\r\n".repeat(4);
        let text: String = (1..10)
            .map(|second| {
                let at_s = f64::from(second);
                line(at_s, ask, "can send 8001 11\n") + &line(at_s + 0.002, say, &answer)
            })
            .collect();
        let found = of(&format!("# baud 230400\n{text}"));
        assert_eq!(found.outrun_baud, Some(230_400));
        is_about(found.turnaround_s, 0.002, 0.002);
        assert_eq!(of(&format!("# baud 921600\n{text}")).outrun_baud, None);
    }
}
