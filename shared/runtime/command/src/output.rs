//! What a command answers, and how it reaches the terminal.

use crate::Failure;
use serde_json::{Value, json};
use std::io::Write;

/// What a command answers: one JSON object, and the same in words.
#[derive(Debug, Clone, PartialEq)]
pub struct Output {
    /// For `--json`.
    pub value: Value,
    /// For people.
    pub words: String,
    /// For people, beside an answer that is JSON; printed on stderr, and not with `--json`.
    pub aside: String,
    /// Why the command fails although it has answered, such as a check that found an error.
    pub failure: Option<Failure>,
}

impl Output {
    /// An answer in both forms.
    pub fn new(value: Value, words: impl Into<String>) -> Self {
        Self { value, words: words.into(), aside: String::new(), failure: None }
    }

    /// An answer that is JSON for people too.
    #[must_use]
    pub fn json(value: Value) -> Self {
        let words = value.to_string();
        Self::new(value, words)
    }

    /// The answer to a request that was accepted.
    #[must_use]
    pub fn accepted(sentence: String) -> Self {
        Self::new(json!({ "accepted": true, "answer": sentence }), sentence)
    }

    /// The same answer, after which the command fails.
    #[must_use]
    pub fn failing(self, failure: Option<Failure>) -> Self {
        Self { failure, ..self }
    }

    /// Prints the answer. A closed pipe (`nims status | head -1`) is the reader's choice, not a failure.
    pub fn print(&self, json: bool) {
        if !json {
            eprint!("{}", self.aside);
        }
        let mut out = std::io::stdout().lock();
        let _ = if json { writeln!(out, "{}", self.value) } else { writeln!(out, "{}", self.words) };
    }
}

impl From<(Value, String)> for Output {
    fn from((value, words): (Value, String)) -> Self {
        Self::new(value, words)
    }
}

/// Prints one line of a stream and says whether the reader is still there.
#[must_use]
pub fn print_line(line: &str) -> bool {
    writeln!(std::io::stdout().lock(), "{line}").is_ok()
}
