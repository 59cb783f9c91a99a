//! How fast and how completely a drive answered.

use crate::recording::{Recording, Side};
use serde_json::{Value, json};
use std::fmt;

/// Bits of a byte on the wire: start, eight, stop.
const BITS: f64 = 10.0;

/// Statistics of a recording.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Timing {
    /// Length of the recording, s.
    pub recorded_s: f64,
    /// Questions: bytes of the program after which the drive or nothing followed.
    pub questions: usize,
    /// Those that nothing followed before the next question.
    pub unanswered: usize,
    /// From the end of a question to the begin of its answer on the wire, s: least, median, 99 %, largest. The latency
    /// of an adapter is part of it.
    pub turnaround_s: Option<[f64; 4]>,
    /// Longest pause within an answer, s.
    pub longest_pause_s: f64,
    /// Bytes of the drive before the first question: it sends without being asked.
    pub unasked_bytes: usize,
}

/// Computes the statistics of a recording.
#[must_use]
pub fn timing(recording: &Recording) -> Timing {
    let mut timing = Timing { recorded_s: recording.chunks.last().map_or(0.0, |last| last.at_s), ..Timing::default() };
    let byte_s = if recording.baud > 0 { BITS / f64::from(recording.baud) } else { 0.0 };
    let mut turnarounds_s = Vec::new();
    // When the present question is over on the wire, and when the last bytes of its answer came.
    let mut asked_s: Option<f64> = None;
    let mut answered_s: Option<f64> = None;
    for chunk in &recording.chunks {
        match chunk.side {
            Side::Program => {
                if answered_s.take().is_some() || asked_s.is_none() {
                    timing.questions += 1;
                    asked_s = None;
                } else if asked_s.is_some_and(|over_s| chunk.at_s > over_s) {
                    timing.questions += 1;
                    timing.unanswered += 1;
                    asked_s = None;
                }
                asked_s = Some(asked_s.unwrap_or(chunk.at_s) + chunk.bytes.len() as f64 * byte_s);
            }
            Side::Drive => {
                match (asked_s, answered_s) {
                    (None, _) => timing.unasked_bytes += chunk.bytes.len(),
                    (Some(over_s), None) => {
                        let began_s = chunk.at_s - chunk.bytes.len() as f64 * byte_s;
                        turnarounds_s.push((began_s - over_s).max(0.0));
                    }
                    (Some(_), Some(last_s)) => timing.longest_pause_s = timing.longest_pause_s.max(chunk.at_s - last_s),
                }
                answered_s = Some(chunk.at_s);
            }
        }
    }
    timing.unanswered += usize::from(asked_s.is_some() && answered_s.is_none());
    turnarounds_s.sort_by(f64::total_cmp);
    let at = |share: f64| turnarounds_s[((turnarounds_s.len() - 1) as f64 * share).round() as usize];
    timing.turnaround_s = (!turnarounds_s.is_empty()).then(|| [0.0, 0.5, 0.99, 1.0].map(at));
    timing
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

    #[test]
    fn questions_answers_and_pauses_are_told_apart() {
        // 100 000 baud: 0.1 ms per byte.
        let text = format!(
            "{HEAD}\n# baud 100000\n0.5 < ff\n1.0 > 01 02\n1.0012 < 0a\n1.002 < 0b 0c\n2.0 > 01\n2.00005 > 02\n3.0 > 01\n3.0031 < 0d\n4.0 > 09\n"
        );
        let found = timing(&Recording::parse(&text).unwrap());
        assert_eq!((found.questions, found.unanswered, found.unasked_bytes), (4, 2, 1));
        let [least, _, _, largest] = found.turnaround_s.unwrap();
        assert!((least - 0.0009).abs() < 1e-9 && (largest - 0.0029).abs() < 1e-9, "{found:?}");
        assert!((found.longest_pause_s - 0.0008).abs() < 1e-9);
        assert_eq!(found.recorded_s, 4.0);
        assert_eq!(timing(&Recording { baud: 0, chunks: Vec::new() }), Timing::default());
    }
}
