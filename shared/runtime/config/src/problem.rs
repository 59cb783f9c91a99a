//! A problem with a configuration value: its key, and a sentence about it.

use std::fmt;

/// A value that is not accepted, found after the file was parsed.
///
/// [`Source::error`](crate::toml_file::Source::error) adds file and line.
///
/// ```
/// use config::Problem;
/// let problem = Problem::with_clause("baud", "is 3; accepted: 9600").within("motor_io.ports.1", "port 2");
/// assert_eq!(problem.key(), "motor_io.ports.1.baud");
/// assert_eq!(problem.to_string(), "`baud` of port 2 is 3; accepted: 9600");
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    key: String,
    sentence: Sentence,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Sentence {
    /// The quoted key, and a clause that follows it.
    About { subject: String, clause: String },
    /// A complete sentence that names its keys itself.
    Whole(String),
}

impl Problem {
    /// Creates a problem from a dotted `key`, in which the tables of an array are numbered from 0, and the clause that
    /// follows the key in the sentence.
    pub fn with_clause(key: impl Into<String>, clause: impl Into<String>) -> Self {
        let key = key.into();
        Self { sentence: Sentence::About { subject: format!("`{key}`"), clause: clause.into() }, key }
    }

    /// Creates a problem at `key` from a complete sentence.
    pub fn with_sentence(key: impl Into<String>, sentence: impl Into<String>) -> Self {
        Self { key: key.into(), sentence: Sentence::Whole(sentence.into()) }
    }

    /// Returns the problem with its key moved into the table `table`, which the sentence names `owner`.
    #[must_use]
    pub fn within(self, table: &str, owner: &str) -> Self {
        let sentence = match self.sentence {
            Sentence::About { subject, clause } => Sentence::About { subject: format!("{subject} of {owner}"), clause },
            whole @ Sentence::Whole(_) => whole,
        };
        Self { key: format!("{table}.{}", self.key), sentence }
    }

    /// Returns the dotted key.
    #[must_use]
    pub fn key(&self) -> &str {
        &self.key
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.sentence {
            Sentence::About { subject, clause } => write!(f, "{subject} {clause}"),
            Sentence::Whole(sentence) => f.write_str(sentence),
        }
    }
}

impl From<Problem> for String {
    fn from(problem: Problem) -> Self {
        problem.to_string()
    }
}
