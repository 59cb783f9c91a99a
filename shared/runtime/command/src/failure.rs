//! How a command fails: with one sentence and an exit code.

use messages::OperatorRequest;
use std::fmt::Display;

/// Why a command did not answer.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// What was given cannot be used; exit code 2.
    #[error("{0}")]
    BadInput(String),
    /// It could not be done now; exit code 1.
    #[error("{0}")]
    NotNow(String),
}

impl Failure {
    /// Bad input, in the words of another error.
    pub fn bad(error: impl Display) -> Self {
        Self::BadInput(one_line(&error))
    }

    /// Not now, in the words of another error.
    pub fn not_now(error: impl Display) -> Self {
        Self::NotNow(one_line(&error))
    }

    /// What the process returns to the shell.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::BadInput(_) => 2,
            Self::NotNow(_) => 1,
        }
    }

    /// How a process answers that fails so: `accepted` of [`OperatorRequest`].
    #[must_use]
    pub fn verdict(&self) -> u8 {
        match self {
            Self::BadInput(_) => OperatorRequest::BAD_INPUT,
            Self::NotNow(_) => OperatorRequest::REFUSED,
        }
    }

    /// The answer of a process: its sentence, or how the command fails.
    ///
    /// # Errors
    /// Whatever is not accepted.
    pub fn of(answer: &OperatorRequest) -> Answer<String> {
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

/// What is wrong with what was given is bad input; what is wrong with the disk is not.
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

/// A sentence stays on one line, whatever it quotes.
fn one_line(error: &impl Display) -> String {
    error.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}
