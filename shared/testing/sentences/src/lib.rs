//! Compares all sentences of a crate with one file, `tests/sentences.txt`. After a change of wording, read the
//! difference that the test prints and renew the file. Other tests compare variants, codes, exit codes and counts; of a
//! text they compare the names, numbers and commands in it, and more only where the text itself is what they test,
//! which a comment there states.
#![forbid(unsafe_code)]

use std::collections::BTreeMap;
use std::fmt::{Display, Write};
use std::path::Path;

/// Set to `1`, the file is written, and not compared.
pub const RENEW: &str = "NIMS_RENEW";

/// Compares named sentences with `tests/sentences.txt` in `folder`, which is the `CARGO_MANIFEST_DIR` of the test: one
/// text line for each sentence, its name and its text, in the order given.
///
/// # Panics
/// The file differs: with every text line that differs, and how to renew it.
pub fn compare<N: Display, S: Display>(folder: &str, sentences: impl IntoIterator<Item = (N, S)>) {
    compare_with(&Path::new(folder).join("tests/sentences.txt"), sentences);
}

/// Compares named sentences with another file, as [`compare`] does.
///
/// # Panics
/// As [`compare`].
pub fn compare_with<N: Display, S: Display>(file: &Path, sentences: impl IntoIterator<Item = (N, S)>) {
    let text: String = sentences.into_iter().fold(String::new(), |mut text, (name, sentence)| {
        let _ = writeln!(text, "{name}: {}", sentence.to_string().replace('\n', "\\n"));
        text
    });
    if std::env::var_os(RENEW).is_some_and(|value| value == "1") {
        #[allow(clippy::panic)]
        std::fs::write(file, text).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        return;
    }
    let before = std::fs::read_to_string(file).unwrap_or_default();
    assert!(
        before == text,
        "{} has other sentences:\n{}If these are meant, run this test again with {RENEW}=1: it writes the file.",
        file.display(),
        difference(&before, &text)
    );
}

/// The lines that are gone (`-`) and those that are new (`+`), in the order of the text; where only the order has
/// changed, it reports that.
fn difference(before: &str, after: &str) -> String {
    let mut counts: BTreeMap<&str, i64> = BTreeMap::new();
    before.lines().for_each(|line| *counts.entry(line).or_default() += 1);
    after.lines().for_each(|line| *counts.entry(line).or_default() -= 1);
    let gone = before.lines().filter(|line| counts[line] > 0).map(|line| format!("- {line}\n"));
    let new = after.lines().filter(|line| counts[line] < 0).map(|line| format!("+ {line}\n"));
    let lines: String = gone.chain(new).collect();
    if lines.is_empty() { "(the same lines in another order)\n".to_owned() } else { lines }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_changes_is_shown_as_it_was_and_as_it_is() {
        assert_eq!(difference("a: 1\nb: 2\nc: 3\n", "a: 1\nb: 4\nc: 3\n"), "- b: 2\n+ b: 4\n");
        assert_eq!(difference("a: 1\n", "a: 1\nb: 1\n"), "+ b: 1\n");
        assert!(difference("a: 1\nb: 2\n", "b: 2\na: 1\n").starts_with('('));
    }
}
