//! The output of a command, and its printing.

use crate::Failure;
use serde_json::{Value, json};
use std::io::Write;

/// The output of a command: one JSON object, and the same as text.
#[derive(Debug, Clone, PartialEq)]
pub struct Output {
    /// JSON object, printed with `--json`.
    pub value: Value,
    /// Text, printed without `--json`.
    pub words: String,
    /// Why the command fails although it has an output, e.g. because a check found an error.
    pub failure: Option<Failure>,
}

impl Output {
    /// Creates an output in both forms.
    pub fn new(value: Value, words: impl Into<String>) -> Self {
        Self { value, words: words.into(), failure: None }
    }

    /// Creates an output that is printed as JSON in both cases.
    #[must_use]
    pub fn json(value: Value) -> Self {
        let words = value.to_string();
        Self::new(value, words)
    }

    /// Creates the output for an accepted request.
    #[must_use]
    pub fn accepted(sentence: String) -> Self {
        Self::new(json!({ "accepted": true, "answer": sentence }), sentence)
    }

    /// Returns the output with a failure, which is reported after it is printed.
    #[must_use]
    pub fn failing(self, failure: Option<Failure>) -> Self {
        Self { failure, ..self }
    }

    /// Prints the output. A closed pipe (`nims status | head -1`) is no failure.
    pub fn print(&self, json: bool) {
        let mut out = std::io::stdout().lock();
        let _ = if json { writeln!(out, "{}", self.value) } else { writeln!(out, "{}", self.words) };
    }
}

impl From<(Value, String)> for Output {
    fn from((value, words): (Value, String)) -> Self {
        Self::new(value, words)
    }
}

/// Prints one text line; returns false if standard output is closed.
#[must_use]
pub fn print_line(line: &str) -> bool {
    writeln!(std::io::stdout().lock(), "{line}").is_ok()
}
