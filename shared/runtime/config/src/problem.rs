//! What is wrong with a value that was read: at which key, and why.

use std::fmt;

/// A value that does not fit, found after the file was read.
///
/// [`Source::error`](crate::toml_file::Source::error) adds file and line.
///
/// ```
/// use config::Problem;
/// let problem = Problem::of("baud", "is 3; accepted: 9600").within("motor_io.ports.1", "port 2");
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
    /// The key, and a clause about it.
    About { subject: String, clause: String },
    /// One that names the key itself, or several.
    Whole(String),
}

impl Problem {
    /// A dotted `key`, tables of an array numbered from 0, and the clause that follows it in the sentence.
    pub fn of(key: impl Into<String>, clause: impl Into<String>) -> Self {
        let key = key.into();
        Self { sentence: Sentence::About { subject: format!("`{key}`"), clause: clause.into() }, key }
    }

    /// A whole sentence about what stands at `key`.
    pub fn at(key: impl Into<String>, sentence: impl Into<String>) -> Self {
        Self { key: key.into(), sentence: Sentence::Whole(sentence.into()) }
    }

    /// The same for a key of the table at `table`, which a sentence calls `owner`.
    #[must_use]
    pub fn within(self, table: &str, owner: &str) -> Self {
        let sentence = match self.sentence {
            Sentence::About { subject, clause } => Sentence::About { subject: format!("{subject} of {owner}"), clause },
            whole @ Sentence::Whole(_) => whole,
        };
        Self { key: format!("{table}.{}", self.key), sentence }
    }

    /// The dotted key.
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
