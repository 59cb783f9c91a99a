//! A drive that answers what it answered in a recording.

use crate::recording::{Recording, Side};
use std::collections::{BTreeMap, BTreeSet};

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
    /// Places of each question in `exchanges`, in order.
    places: BTreeMap<Vec<u8>, Vec<usize>>,
    /// Every begin of a question.
    begins: BTreeSet<Vec<u8>>,
    /// Where the next answer is looked for first.
    next: usize,
    received: Vec<u8>,
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
        let (mut places, mut begins) = (BTreeMap::<_, Vec<usize>>::new(), BTreeSet::new());
        for (place, exchange) in exchanges.iter().enumerate() {
            let question = &exchange.question;
            places.entry(question.clone()).or_default().push(place);
            if !begins.contains(question) {
                begins.extend((1..=question.len()).map(|end| question[..end].to_vec()));
            }
        }
        Self { exchanges, places, begins, next: 0, received: Vec::new(), answered: 0, unknown_bytes: 0 }
    }

    /// Takes a byte of the program. Returns the answer if it ends a recorded question: times from now, s, and bytes.
    /// Where a question is the begin of the one that was asked next in the recording, it waits for the rest.
    pub fn receive(&mut self, byte: u8) -> Option<&[(f64, Vec<u8>)]> {
        self.received.push(byte);
        while !self.received.is_empty() && !self.begins.contains(&self.received) {
            self.received.remove(0);
            self.unknown_bytes += 1;
        }
        let expected = self.exchanges.get(self.next).map_or(&[][..], |it| &it.question);
        if expected.len() > self.received.len() && expected.starts_with(&self.received) {
            return None;
        }
        let places = self.places.get(&self.received)?;
        let place = places.iter().find(|place| **place >= self.next).or(places.first())?;
        self.next = (place + 1) % self.exchanges.len();
        self.answered += 1;
        self.received.clear();
        Some(&self.exchanges[*place].answer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::HEAD;

    fn answered(replay: &mut Replay, bytes: &[u8]) -> Vec<u8> {
        let mut all = Vec::new();
        for byte in bytes {
            all.extend(replay.receive(*byte).into_iter().flatten().flat_map(|(_, bytes)| bytes.clone()));
        }
        all
    }

    #[test]
    fn answers_come_in_their_order_and_unknown_bytes_are_passed_over() {
        let text = format!("{HEAD}\n0.1 < 99\n1 > 01 02\n1.1 < 0a\n1.2 < 0b\n2 > 03\n2.1 < 0c\n3 > 01 02\n3.1 < 0d\n");
        let mut replay = Replay::new(&Recording::parse(&text).unwrap());
        assert_eq!(answered(&mut replay, &[1, 2]), [0x0a, 0x0b]);
        assert_eq!(answered(&mut replay, &[1, 2]), [0x0d]);
        assert_eq!(answered(&mut replay, &[1, 2, 3]), [0x0a, 0x0b, 0x0c]);
        assert_eq!(answered(&mut replay, &[7, 1, 1, 2]), [0x0d]);
        assert_eq!((replay.answered, replay.unknown_bytes), (5, 2));
        // 01 is also the begin of the question before it.
        let text = format!("{HEAD}\n1 > 01 02\n1.1 < 0a\n2 > 01\n2.1 < 0b\n");
        let mut replay = Replay::new(&Recording::parse(&text).unwrap());
        assert_eq!(answered(&mut replay, &[1, 2, 1, 1, 2]), [0x0a, 0x0b, 0x0a]);
    }
}
