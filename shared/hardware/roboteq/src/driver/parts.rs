//! Parts of a batch: numbers, lines, answers.

use arrayvec::ArrayVec;

use crate::codec::{Line, Name, Numbers, Text};

/// Numbered variables of the controller.
pub(super) const MARKS: usize = 16;
/// Most lines of a batch, with the question about the number.
pub(super) const MAX_ITEMS: usize = 12;
/// Most questions of a batch.
const MAX_ASKS: usize = 8;
/// Number in a variable: any two differ in two digits.
pub(super) fn mark(variable: u8) -> i32 {
    let tens = 9 + i32::from(variable);
    tens * 10 + (tens / 10 + tens % 10) % 10
}

/// Bytes of an answer with its end: long ones of each kind.
pub(super) const fn answer_bytes(name: Name) -> usize {
    match name {
        Name::Faults => 7,
        Name::Variable | Name::Status => 8,
        Name::Mode | Name::EchoOff => 10,
        Name::MotorFaults | Name::Watchdog => 11,
        Name::Amps | Name::Power | Name::Speed | Name::Applied => 14,
        Name::Command | Name::Volts | Name::Pulses => 16,
        Name::MaxRpm => 18,
        Name::Counts => 20,
        Name::Model => 26,
        Name::Firmware => 44,
    }
}

/// A part of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Item {
    /// The end of whatever was sent before.
    End,
    /// A line that is acknowledged at most.
    Order(Line),
    /// A question.
    Ask(Name, Option<u8>),
}

impl Item {
    pub(super) fn text(self) -> Text {
        match self {
            Item::End => Text::new(),
            Item::Order(line) => line.encode(),
            Item::Ask(name, channel) => Line::Ask(name, channel).encode(),
        }
    }
}

/// Lines to the controller in their order.
#[derive(Debug, Clone, Default)]
pub(super) struct Batch {
    pub(super) items: ArrayVec<Item, MAX_ITEMS>,
    /// It begins with a question about a number.
    pub(super) marked: bool,
    /// Other lines between the answers are skipped.
    pub(super) lenient: bool,
    /// Last questions that are not waited for.
    pub(super) tail: usize,
}

/// Questions whose answers are not waited for.
#[derive(Debug, Clone)]
pub(super) struct Tail {
    pub(super) asks: ArrayVec<Name, 2>,
    pub(super) at_ns: u64,
    pub(super) until_ns: u64,
}

/// A value of an answer.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value {
    Numbers(Numbers),
    Text(Text),
}

/// Answers to the questions of a batch, in their order.
#[derive(Debug, Clone, Default)]
pub(super) struct Answers {
    pub(super) names: ArrayVec<Name, MAX_ASKS>,
    pub(super) values: ArrayVec<Value, MAX_ASKS>,
    /// Time of the batch on the machine's clock, ns.
    pub(super) at_ns: u64,
    /// The same of the first question about the counters.
    pub(super) counts_at_ns: u64,
}

impl Answers {
    fn all(&self, name: Name) -> impl Iterator<Item = &Value> {
        let named = self.names.iter().zip(&self.values).filter(move |(asked, _)| **asked == name);
        named.map(|(_, value)| value)
    }

    /// The values of each channel, of the answer so many from the first to this question.
    pub(super) fn pair(&self, name: Name, nth: usize) -> Option<[i32; 2]> {
        match self.all(name).nth(nth)? {
            Value::Numbers(values) => values.as_slice().try_into().ok(),
            Value::Text(_) => None,
        }
    }

    /// The same of a question with one value.
    pub(super) fn single(&self, name: Name, nth: usize) -> Option<i32> {
        match self.all(name).nth(nth)? {
            Value::Numbers(values) => <[i32; 1]>::try_from(values.as_slice()).ok().map(|[value]| value),
            Value::Text(_) => None,
        }
    }

    /// The answer to two questions about each channel, where both answers are the same.
    pub(super) fn twice(&self, name: Name) -> Option<[i32; 2]> {
        self.pair(name, 0).filter(|first| self.pair(name, 1) == Some(*first))
    }

    /// A text.
    pub(super) fn text(&self, name: Name) -> Option<&str> {
        match self.all(name).next()? {
            Value::Text(text) => Some(text.as_str()),
            Value::Numbers(_) => None,
        }
    }
}

/// A line without the acknowledgements before it; `None` for one that is nothing else. Those of commands prove nothing
/// that a command read back does not, so a changed one does no harm.
pub(super) fn unacknowledged(line: &[u8]) -> Option<&[u8]> {
    let start = line.iter().position(|&byte| byte != b'+')?;
    line.get(start..).filter(|rest| rest.len() > 2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_two_numbers_differ_in_two_digits() {
        let digits = |number: i32| [number / 100, number / 10 % 10, number % 10];
        for (one, two) in (1..=16_u8).flat_map(|one| (one + 1..=16).map(move |two| (one, two))) {
            let [one, two] = [mark(one), mark(two)].map(digits);
            assert!(one.iter().zip(two).filter(|(one, two)| *one != two).count() >= 2, "{one:?} {two:?}");
        }
    }
}
