//! A drive that answers what it answered in a recording.

use crate::recording::{Recording, Side};

/// What a drive said after a question.
#[derive(Debug, Clone, PartialEq, Default)]
struct Exchange {
    question: Vec<u8>,
    /// Time after the end of the question, s, and bytes.
    answer: Vec<(f64, Vec<u8>)>,
}

/// The drive of a recording. A question that was asked several times is answered by the next of its answers, and from
/// the first one again after the last.
#[derive(Debug, Clone)]
pub struct Replay {
    exchanges: Vec<Exchange>,
    /// Where the next answer is looked for first.
    next: usize,
    heard: Vec<u8>,
    /// Questions answered, also by silence as the drive did.
    pub answered: u64,
    /// Bytes that are in no recorded question at this place.
    pub unknown_bytes: u64,
}

impl Replay {
    /// The drive of a recording.
    #[must_use]
    pub fn new(recording: &Recording) -> Self {
        let mut exchanges: Vec<Exchange> = Vec::new();
        let mut asked_s = 0.0;
        for chunk in &recording.chunks {
            match chunk.side {
                Side::Program => {
                    match exchanges.last_mut().filter(|last| last.answer.is_empty()) {
                        Some(last) => last.question.extend(&chunk.bytes),
                        None => exchanges.push(Exchange { question: chunk.bytes.clone(), answer: Vec::new() }),
                    }
                    asked_s = chunk.at_s;
                }
                // What came before the first question answers none.
                Side::Drive => {
                    if let Some(last) = exchanges.last_mut() {
                        last.answer.push((chunk.at_s - asked_s, chunk.bytes.clone()));
                    }
                }
            }
        }
        Self { exchanges, next: 0, heard: Vec::new(), answered: 0, unknown_bytes: 0 }
    }

    /// Hears a byte. Returns the answer if it ends a recorded question: times from now, s, and bytes.
    pub fn hear(&mut self, byte: u8) -> Option<&[(f64, Vec<u8>)]> {
        self.heard.push(byte);
        while !self.heard.is_empty() && !self.exchanges.iter().any(|it| it.question.starts_with(&self.heard)) {
            self.heard.remove(0);
            self.unknown_bytes += 1;
        }
        let count = self.exchanges.len();
        let found = (0..count).map(|k| (self.next + k) % count).find(|i| self.exchanges[*i].question == self.heard);
        let found = found.filter(|_| !self.heard.is_empty())?;
        self.next = (found + 1) % count;
        self.answered += 1;
        self.heard.clear();
        Some(&self.exchanges[found].answer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::HEAD;

    fn said(replay: &mut Replay, bytes: &[u8]) -> Vec<u8> {
        let mut all = Vec::new();
        for byte in bytes {
            all.extend(replay.hear(*byte).into_iter().flatten().flat_map(|(_, bytes)| bytes.clone()));
        }
        all
    }

    #[test]
    fn answers_come_in_their_order_and_unknown_bytes_are_passed_over() {
        let text = format!("{HEAD}\n0.1 < 99\n1 > 01 02\n1.1 < 0a\n1.2 < 0b\n2 > 03\n2.1 < 0c\n3 > 01 02\n3.1 < 0d\n");
        let mut replay = Replay::new(&Recording::parse(&text).unwrap());
        assert_eq!(said(&mut replay, &[1, 2]), [0x0a, 0x0b]);
        assert_eq!(said(&mut replay, &[1, 2]), [0x0d]);
        assert_eq!(said(&mut replay, &[1, 2, 3]), [0x0a, 0x0b, 0x0c]);
        assert_eq!(said(&mut replay, &[7, 1, 1, 2]), [0x0d]);
        assert_eq!((replay.answered, replay.unknown_bytes), (5, 2));
    }
}
