//! Answers to requests, in place, because the loop does not allocate.

use arrayvec::ArrayString;
use messages::{MORE, parted};
use std::fmt::Write;

/// Longest answer, bytes: the room in `operator/request`.
pub const SENTENCE: usize = 512;

/// One sentence.
pub type Sentence = ArrayString<SENTENCE>;

/// Result of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Answer {
    /// Number of the request.
    pub id: u64,
    /// Verb of the request.
    pub verb: u8,
    /// One of [`OperatorRequest`](messages::OperatorRequest)'s constants for its field `accepted`.
    pub accepted: u8,
    /// What happens, or why it does not and what to do.
    pub sentence: Sentence,
}

impl Answer {
    /// Returns true if the request is accepted.
    #[must_use]
    pub fn is_accepted(&self) -> bool {
        self.accepted == messages::OperatorRequest::ACCEPTED
    }
}

/// Longest text searched for the end of a sentence, bytes.
const DRAFT: usize = 4 * SENTENCE;

/// Formats a sentence. One that is too long loses the part before its cure: see [`parted`].
#[must_use]
pub fn sentence(text: std::fmt::Arguments<'_>) -> Sentence {
    struct Cut<'a>(&'a mut ArrayString<DRAFT>);
    impl Write for Cut<'_> {
        fn write_str(&mut self, text: &str) -> std::fmt::Result {
            let mut end = text.len().min(self.0.remaining_capacity());
            while !text.is_char_boundary(end) {
                end -= 1;
            }
            self.0.push_str(&text[..end]);
            Ok(())
        }
    }
    let mut draft = ArrayString::new();
    // `Cut` never fails.
    let _ = Cut(&mut draft).write_fmt(text);
    let mut sentence = Sentence::new();
    let (end, from) = if draft.len() > SENTENCE { parted(&draft, SENTENCE) } else { (draft.len(), draft.len()) };
    let parts = [&draft[..end], if from > end { MORE } else { "" }, &draft[from..]];
    // `parted` leaves room for all three.
    parts.iter().for_each(|part| sentence.push_str(part));
    sentence
}

#[cfg(test)]
mod tests {
    use messages::faults::Faults;
    use robot_state::sentences::{FAULTS, FaultList};

    #[test]
    fn an_answer_holds_the_cures_of_whatever_has_failed() {
        let all = FAULTS.iter().fold(0, |all, (bit, _, _)| all | bit);
        let faults = Faults { bits: all, cables: [true; 8], units: [true; 8], ..Faults::default() };
        let answer = super::sentence(format_args!("Not armed: {}.", FaultList(&faults)));
        assert!(!answer.contains(messages::MORE) && answer.ends_with("names with their cures."), "{answer}");
        for (bit, what, cure) in FAULTS {
            let faults = Faults { bits: bit, cables: [true; 8], units: [true; 8], ..Faults::default() };
            let answer = super::sentence(format_args!("Not armed: {}.", FaultList(&faults)));
            assert!(answer.contains(what) && answer.contains(cure) && !answer.contains(messages::MORE), "{answer}");
        }
    }

    #[test]
    fn a_long_sentence_ends_at_a_word_or_at_least_a_character() {
        let words = super::sentence(format_args!("{} end.", "word ".repeat(200)));
        assert!(words.ends_with("word ...") && words.len() > super::SENTENCE - 10, "{words}");
        let text = "ü".repeat(400);
        assert!(super::sentence(format_args!("{text}")).ends_with("ü ..."));
        let whole = "x".repeat(super::SENTENCE);
        assert_eq!(super::sentence(format_args!("{whole}")).as_str(), whole);
    }
}
