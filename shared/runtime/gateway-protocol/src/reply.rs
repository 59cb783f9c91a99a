//! What a gateway sends.

use messages::{OperatorRequest, RequestAnswer, put_text, text_of};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Whether a request was accepted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Accepted {
    /// It is carried out.
    Accepted,
    /// It cannot be done now.
    Refused,
    /// What was given makes no sense, whenever it is requested.
    BadInput,
}

impl Accepted {
    fn of(number: u8) -> Self {
        match number {
            OperatorRequest::ACCEPTED => Self::Accepted,
            OperatorRequest::BAD_INPUT => Self::BadInput,
            _ => Self::Refused,
        }
    }

    fn number(self) -> u8 {
        match self {
            Self::Accepted => OperatorRequest::ACCEPTED,
            Self::Refused => OperatorRequest::REFUSED,
            Self::BadInput => OperatorRequest::BAD_INPUT,
        }
    }
}

/// A reply of the gateway, or a sample.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "reply", rename_all = "kebab-case")]
pub enum Reply {
    /// To `hello`.
    Welcome {
        /// [`crate::VERSION`].
        version: u32,
        /// Name of the robot for which the gateway runs.
        robot: String,
        /// Name with which requests are recorded.
        user: String,
        /// `look`, `stop` or `fly`.
        role: String,
    },
    /// To `ask`; also to any other call that is refused.
    Answer {
        /// Of the call; 0: of a call that could not be read.
        id: u64,
        /// Whether it was accepted.
        accepted: Accepted,
        /// Number in the catalogue of answers.
        reason: u16,
        /// The answer in English.
        sentence: String,
        /// Parameters of the reason.
        numbers: [u64; 6],
        /// Parameters of the reason; null: not a finite number.
        values: [Option<f64>; 6],
        /// Text parameter of the reason.
        detail: String,
    },
    /// To `robot`.
    Robot {
        /// Of the call.
        id: u64,
        /// `None`: no robot runs.
        robot: Option<RobotFacts>,
    },
    /// To `configuration`; body: the files one after the other.
    Configuration {
        /// Of the call.
        id: u64,
        /// The files, in the order of the body.
        files: Vec<FileRow>,
    },
    /// To `channels`.
    Channels {
        /// Of the call.
        id: u64,
        /// The channels by name.
        channels: Vec<ChannelRow>,
    },
    /// To `subscribe` and `unsubscribe`.
    Done {
        /// Of the call.
        id: u64,
    },
    /// Before the first sample of a subscription, and again when the channel was created again.
    Definition {
        /// Of the subscription.
        id: u64,
        /// Type of the samples.
        type_name: String,
        /// Size of a sample, bytes.
        size_bytes: usize,
        /// Definition of the type.
        schema: Option<String>,
    },
    /// A sample; body: its bytes.
    Sample {
        /// Of the subscription.
        id: u64,
        /// Samples of this subscription that were left out so far: by its rate, or because the client reads too slowly.
        dropped: u64,
        /// Samples of the channel that the gateway itself has missed so far.
        missed: u64,
    },
    /// To `runs`.
    Runs {
        /// Of the call.
        id: u64,
        /// The finished runs by name.
        runs: Vec<RunRow>,
        /// The disk on which they are.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        disk: Option<DiskFigures>,
    },
    /// To `files`.
    Files {
        /// Of the call.
        id: u64,
        /// The files of the run.
        files: Vec<FileRow>,
    },
    /// To `doctor`.
    Findings {
        /// Of the call.
        id: u64,
        /// The findings, the worst ones first.
        findings: Vec<FindingRow>,
    },
    /// To `open`, with the descriptor.
    Opened {
        /// Of the call.
        id: u64,
        /// Size of the file, bytes.
        bytes: u64,
    },
    /// To clients that are pages, whenever it changes: who flies from a page.
    Seat {
        /// 0.
        id: u64,
        /// Who flies; null: the seat is free.
        flyer: Option<String>,
        /// Who asks to take over.
        asks: Option<String>,
        /// Time until that happens, s.
        within_s: f64,
    },
    /// To `code-add`.
    Code {
        /// Of the call.
        id: u64,
        /// The code.
        code: String,
        /// Time for which it is valid, s.
        valid_s: f64,
    },
    /// To `token-add` and `code-use`.
    Token {
        /// Of the call.
        id: u64,
        /// The secret, which is shown only here.
        secret: String,
    },
    /// To `token-list`.
    Tokens {
        /// Of the call.
        id: u64,
        /// The tokens by name.
        tokens: Vec<TokenRow>,
    },
}

/// The robot that runs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RobotFacts {
    /// Name of its domain.
    pub domain: String,
    /// The folder of its domain.
    pub folder: PathBuf,
    /// Process id of its supervisor.
    pub pid: u32,
    /// System file.
    pub system_file: PathBuf,
    /// Run folder.
    pub run: PathBuf,
    /// Names and ids of the processes in the domain.
    pub processes: Vec<(String, u32)>,
    /// Its shared memory.
    pub memory: MemoryFigures,
}

/// Shared memory, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct MemoryFigures {
    /// Whole size.
    pub total: u64,
    /// Free.
    pub free: u64,
    /// Used by the robot.
    pub used: u64,
    /// Of the robot's files, but not allocated.
    pub unreserved: u64,
}

/// A channel.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChannelRow {
    /// Name.
    pub name: String,
    /// Type of its samples.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Size of a sample, bytes.
    pub size_bytes: usize,
    /// Buffer of a deep subscriber, samples.
    pub buffer: usize,
    /// Number of samples stored for late subscribers.
    pub history: usize,
    /// Whether the definition of the type is known.
    pub has_schema: bool,
    /// Processes that have it open.
    pub processes: Vec<String>,
}

/// A file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileRow {
    /// Name, in the folder of the run; `log/motor-io.txt` is in a folder of it.
    pub name: String,
    /// Size, bytes.
    pub bytes: u64,
}

/// The disk of the runs, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiskFigures {
    /// Whole size.
    pub total: u64,
    /// What the robot's user can still write.
    pub free: u64,
    /// Above this size of all runs the machine deletes the oldest ones; `None`: it deletes none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quota: Option<u64>,
}

/// A finding about the robot's machine.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FindingRow {
    /// `error`, `warning` or `note`.
    pub level: String,
    /// The fact.
    pub finding: String,
    /// What to do about it; empty for a note.
    pub cure: String,
}

/// A finished run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunRow {
    /// Name of its folder.
    pub name: String,
    /// Number of files.
    pub files: usize,
    /// Size of all its files, bytes.
    pub bytes: u64,
}

/// A token.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TokenRow {
    /// Name of its holder.
    pub name: String,
    /// Role of its holder.
    pub role: String,
    /// When it was created, UTC.
    pub created: String,
}

impl Reply {
    /// The answer to a request, as the robot or the gateway makes it.
    #[must_use]
    pub fn answer(id: u64, answer: &RequestAnswer) -> Self {
        Self::Answer {
            id,
            accepted: Accepted::of(answer.accepted),
            reason: answer.reason,
            sentence: text_of(&answer.text),
            numbers: answer.number,
            values: answer.value.map(|value| value.is_finite().then_some(value)),
            detail: text_of(&answer.detail),
        }
    }

    /// The answer to a request, as it is in the recorded request; `None` for another reply.
    #[must_use]
    pub fn request_answer(&self) -> Option<RequestAnswer> {
        let Self::Answer { accepted, reason, sentence, numbers, values, detail, .. } = self else { return None };
        let mut answer = RequestAnswer {
            accepted: accepted.number(),
            reason: *reason,
            number: *numbers,
            value: values.map(|value| value.unwrap_or(f64::NAN)),
            ..RequestAnswer::default()
        };
        put_text(&mut answer.text, sentence);
        put_text(&mut answer.detail, detail);
        Some(answer)
    }

    /// The number of the call; 0 for `welcome`.
    #[must_use]
    pub fn id(&self) -> u64 {
        match self {
            Self::Welcome { .. } => 0,
            Self::Answer { id, .. }
            | Self::Robot { id, .. }
            | Self::Configuration { id, .. }
            | Self::Channels { id, .. }
            | Self::Done { id }
            | Self::Definition { id, .. }
            | Self::Sample { id, .. }
            | Self::Runs { id, .. }
            | Self::Files { id, .. }
            | Self::Opened { id, .. }
            | Self::Findings { id, .. }
            | Self::Seat { id, .. }
            | Self::Code { id, .. }
            | Self::Token { id, .. }
            | Self::Tokens { id, .. } => *id,
        }
    }

    /// The same reply to another call.
    #[must_use]
    pub fn with_id(mut self, number: u64) -> Self {
        match &mut self {
            Self::Welcome { .. } => {}
            Self::Answer { id, .. }
            | Self::Robot { id, .. }
            | Self::Configuration { id, .. }
            | Self::Channels { id, .. }
            | Self::Done { id }
            | Self::Definition { id, .. }
            | Self::Sample { id, .. }
            | Self::Runs { id, .. }
            | Self::Files { id, .. }
            | Self::Opened { id, .. }
            | Self::Findings { id, .. }
            | Self::Seat { id, .. }
            | Self::Code { id, .. }
            | Self::Token { id, .. }
            | Self::Tokens { id, .. } => *id = number,
        }
        self
    }

    /// The JSON of the header of a frame.
    #[must_use]
    pub fn header(&self) -> Vec<u8> {
        // Texts, numbers and lists of them are always JSON.
        serde_json::to_vec(self).unwrap_or_default()
    }

    /// Reads the header of a frame.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn read(header: &[u8]) -> Result<Self, String> {
        serde_json::from_slice(header).map_err(|error| format!("a frame is not a reply: {error}"))
    }
}
