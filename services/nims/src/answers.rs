//! How an answer reaches the terminal: one JSON object, or words.

use serde_json::Value;
use std::io::Write;

/// Prints an answer. A closed pipe (`nims status | head -1`) is the reader's choice, not a failure.
pub fn print(json: bool, value: &Value, words: &str) {
    let mut out = std::io::stdout().lock();
    let _ = if json { writeln!(out, "{value}") } else { writeln!(out, "{words}") };
}

/// Prints a line of a stream and says whether anyone still reads.
#[must_use]
pub fn stream(line: &str) -> bool {
    writeln!(std::io::stdout().lock(), "{line}").is_ok()
}
