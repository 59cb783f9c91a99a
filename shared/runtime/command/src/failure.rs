//! The failure of a command: one sentence and an exit code.

use messages::OperatorRequest;
use serde_json::{Value, json};
use std::fmt::Display;

/// Failure of a command.
///
/// A program decides by the exit code, and for the refusal of a process by the number of its reason, which `--json`
/// prints. The sentences are for a person: no program reads them. They come from typed errors of libraries, which have
/// the variants; a caller that needs them calls the library. Tests compare the names and numbers in a sentence; its
/// wording stands in the files of sentences only (`shared/testing/sentences`).
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// The input is not accepted; exit code 2.
    #[error("{0}")]
    BadInput(String),
    /// It could not be done now; exit code 1.
    #[error("{0}")]
    NotNow(String),
    /// A process refused the request; the exit code follows from its verdict.
    #[error("{sentence}")]
    Refused {
        /// Verdict of the process, `accepted` of [`OperatorRequest`].
        verdict: u8,
        /// Number of the reason in the catalogue of answers; 0 if the process gave none.
        reason: u16,
        /// The reason in English.
        sentence: String,
    },
}

impl Failure {
    /// Converts another error to bad input.
    pub fn bad(error: impl Display) -> Self {
        Self::BadInput(one_line(&error))
    }

    /// Converts another error to [`Failure::NotNow`].
    pub fn not_now(error: impl Display) -> Self {
        Self::NotNow(one_line(&error))
    }

    /// Returns the same failure with another sentence.
    #[must_use]
    pub fn with_sentence(&self, sentence: String) -> Self {
        match *self {
            Self::BadInput(_) => Self::BadInput(sentence),
            Self::NotNow(_) => Self::NotNow(sentence),
            Self::Refused { verdict, reason, .. } => Self::Refused { verdict, reason, sentence },
        }
    }

    /// Returns the exit code of the program.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::BadInput(_) | Self::Refused { verdict: OperatorRequest::BAD_INPUT, .. } => 2,
            Self::NotNow(_) | Self::Refused { .. } => 1,
        }
    }

    /// Returns `accepted` of [`OperatorRequest`] for an answer with this failure.
    #[must_use]
    pub fn verdict(&self) -> u8 {
        match self {
            Self::BadInput(_) => OperatorRequest::BAD_INPUT,
            Self::NotNow(_) => OperatorRequest::REFUSED,
            Self::Refused { verdict, .. } => *verdict,
        }
    }

    /// Returns the refusal of a process as JSON; `None` for another failure.
    #[must_use]
    pub fn to_json(&self) -> Option<Value> {
        let Self::Refused { reason, sentence, .. } = self else { return None };
        Some(json!({ "accepted": false, "reason": reason, "answer": sentence }))
    }

    /// Converts the answer of a process to its sentence or a failure.
    ///
    /// # Errors
    /// The request was not accepted.
    pub fn unless_accepted(answer: &OperatorRequest) -> Answer<String> {
        let sentence = messages::text_of(&answer.answer);
        match answer.accepted {
            OperatorRequest::ACCEPTED => Ok(sentence),
            verdict => Err(Self::Refused { verdict, reason: answer.reason, sentence }),
        }
    }
}

impl From<messages::EncodeError> for Failure {
    fn from(error: messages::EncodeError) -> Self {
        Self::bad(error)
    }
}

impl From<bus::BusError> for Failure {
    fn from(error: bus::BusError) -> Self {
        if error.is_bad_input() { Self::bad(error) } else { Self::not_now(error) }
    }
}

/// A path that is no run, or that already exists, is bad input; other problems are not.
impl From<runlog::RunError> for Failure {
    fn from(error: runlog::RunError) -> Self {
        match error {
            runlog::RunError::NotARun { .. } => Self::bad(error),
            runlog::RunError::Io { ref source, .. } if source.kind() == std::io::ErrorKind::AlreadyExists => {
                Self::BadInput(format!("{error}; give another folder with --out, or move it away"))
            }
            other => Self::not_now(other),
        }
    }
}

/// The result of a command.
pub type Answer<T = ()> = Result<T, Failure>;

/// Joins a message to one text line.
fn one_line(error: &impl Display) -> String {
    error.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_keeps_the_verdict_and_the_number_of_its_reason() {
        for (accepted, exit_code) in [(OperatorRequest::REFUSED, 1), (OperatorRequest::BAD_INPUT, 2)] {
            let mut answer = OperatorRequest { accepted, reason: 111, ..OperatorRequest::default() };
            messages::put_sentence(&mut answer.answer, "no");
            let failure = Failure::unless_accepted(&answer).map_or_else(|failure| failure, Failure::NotNow);
            assert_eq!((failure.exit_code(), failure.verdict()), (exit_code, accepted));
            assert_eq!(failure.to_json(), Some(json!({ "accepted": false, "reason": 111, "answer": "no" })));
        }
        assert_eq!(Failure::BadInput(String::new()).to_json(), None);
    }
}
