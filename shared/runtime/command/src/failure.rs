//! The failure of a command: one sentence and an exit code.

use messages::OperatorRequest;
use std::fmt::Display;

/// Failure of a command.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// The input is not accepted; exit code 2.
    #[error("{0}")]
    BadInput(String),
    /// It could not be done now; exit code 1.
    #[error("{0}")]
    NotNow(String),
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

    /// Returns the exit code of the program.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::BadInput(_) => 2,
            Self::NotNow(_) => 1,
        }
    }

    /// Returns `accepted` of [`OperatorRequest`] for an answer with this failure.
    #[must_use]
    pub fn verdict(&self) -> u8 {
        match self {
            Self::BadInput(_) => OperatorRequest::BAD_INPUT,
            Self::NotNow(_) => OperatorRequest::REFUSED,
        }
    }

    /// Converts the answer of a process to its sentence or a failure.
    ///
    /// # Errors
    /// The request was not accepted.
    pub fn unless_accepted(answer: &OperatorRequest) -> Answer<String> {
        let sentence = messages::text_of(&answer.answer);
        match answer.accepted {
            OperatorRequest::ACCEPTED => Ok(sentence),
            OperatorRequest::BAD_INPUT => Err(Self::BadInput(sentence)),
            _ => Err(Self::NotNow(sentence)),
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
