//! Answers to requests, in a fixed place: the loop does not allocate.

use arrayvec::ArrayString;
use std::fmt::Write;

/// Longest answer, bytes.
pub const SENTENCE: usize = 320;

/// One sentence.
pub type Sentence = ArrayString<SENTENCE>;

/// What became of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Answer {
    /// Of the request.
    pub id: u64,
    /// Of the request.
    pub verb: u8,
    /// Whether it is being done, or done: one of the numbers of [`OperatorRequest`](messages::OperatorRequest) for its `accepted`.
    pub accepted: u8,
    /// What happens, or why not and what to do.
    pub sentence: Sentence,
}

impl Answer {
    /// It is being done, or done.
    #[must_use]
    pub fn is_accepted(&self) -> bool {
        self.accepted == messages::OperatorRequest::ACCEPTED
    }
}

/// A sentence from format arguments; what does not fit is cut off.
#[must_use]
pub fn sentence(text: std::fmt::Arguments<'_>) -> Sentence {
    struct Cut<'a>(&'a mut Sentence);
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
    let mut sentence = Sentence::new();
    // Cut never fails.
    let _ = Cut(&mut sentence).write_fmt(text);
    sentence
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_long_sentence_is_cut_at_a_character() {
        let text = "ü".repeat(400);
        assert_eq!(super::sentence(format_args!("{text}")).len(), super::SENTENCE);
    }
}
