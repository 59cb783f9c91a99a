//! What a client sends.

use messages::{OperatorRequest, Reading, Request};
use serde::{Deserialize, Serialize};
use std::net::IpAddr;

/// Kind of a client's program. The gateway records it with each request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Origin {
    /// The command `nims`.
    Command,
    /// A web page.
    Page,
    /// A program in Python or another language.
    Python,
}

impl Origin {
    /// Returns `origin` of [`OperatorRequest`].
    #[must_use]
    pub fn number(self) -> u8 {
        match self {
            Self::Command => OperatorRequest::ORIGIN_COMMAND,
            Self::Page => OperatorRequest::ORIGIN_PAGE,
            Self::Python => OperatorRequest::ORIGIN_PYTHON,
        }
    }
}

/// Quality of a reading, as the device reports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReadingQuality {
    /// No doubt.
    #[default]
    Good,
    /// E.g. a weak signal.
    Doubtful,
    /// The device has no value.
    Invalid,
}

impl ReadingQuality {
    /// Returns `quality` of [`Reading`].
    #[must_use]
    pub fn number(self) -> u8 {
        match self {
            Self::Good => Reading::QUALITY_GOOD,
            Self::Doubtful => Reading::QUALITY_DOUBTFUL,
            Self::Invalid => Reading::QUALITY_INVALID,
        }
    }
}

/// A reading of a plug-in, whose names and units the system file declares.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// Name of the plug-in.
    pub sensor: String,
    /// Its values, in the declared order; null where the device reports none.
    pub values: Vec<Option<f64>>,
    /// Its quality; default good.
    #[serde(default)]
    pub quality: ReadingQuality,
    /// Time since the measurement, s; default 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub age_s: Option<f64>,
}

/// Files that `nims` makes of a finished run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RunFiles {
    /// `report.html`, and `report.json` with its figures.
    Report,
    /// Maps of the sensors: plots, grids, tables, GeoJSON.
    Maps,
    /// A table of each channel as text.
    Csv,
    /// A table of each channel as Parquet.
    Parquet,
}

/// What is done about the seat of the one who flies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SeatCall {
    /// Asks to fly: at once if the seat is free, otherwise when it is given, or not kept for ten seconds.
    Ask,
    /// Gives it to the one who asks, or leaves it.
    Give,
    /// Keeps it, or asks no more.
    Keep,
}

/// A call of a client. The first one is [`Call::Hello`]; the reply to every other one has the same `id`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "call", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Call {
    /// Opens the connection.
    Hello {
        /// [`crate::VERSION`].
        version: u32,
        /// Kind of the client's program.
        origin: Origin,
        /// Secret of a client that acts for a person, in place of the role of its own user.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        token: Option<String>,
        /// Address of the browser for which a page acts; the run records it beside the name.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        from: Option<IpAddr>,
    },
    /// Requests something of the robot; body: the text of the mission of `run`, otherwise empty.
    Ask {
        /// Number that the reply repeats.
        id: u64,
        /// The request.
        request: Request,
        /// For faults: the process that makes it; default: the virtual motor box.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        process: Option<String>,
        /// The motion of a jog or of a move goes on only while the client sends [`Call::Beat`].
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        held: bool,
        /// When the control was pressed, CLOCK_MONOTONIC of this machine, ns; default: now. A held motion whose request
        /// is 0.3 s old is refused.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        at_ns: Option<u64>,
        /// When the person pressed for this motion first, on the same clock: it is refused if a client has stopped the
        /// robot since. For motions that are requested again until the robot rests.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pressed_ns: Option<u64>,
    },
    /// The control of a held motion is still held; the only call without a reply.
    Beat {
        /// When that was so, CLOCK_MONOTONIC of this machine, ns; default: now. One that is 0.3 s old does not count.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        at_ns: Option<u64>,
    },
    /// The control of a held motion was released.
    Release {
        /// Number that the reply repeats.
        id: u64,
    },
    /// Asks which robot runs.
    Robot {
        /// Number that the reply repeats.
        id: u64,
    },
    /// Asks for the files of the robot's configuration.
    Configuration {
        /// Number that the reply repeats.
        id: u64,
    },
    /// Asks for the list of channels.
    Channels {
        /// Number that the reply repeats.
        id: u64,
    },
    /// Subscribes to a channel, which may not exist yet.
    Subscribe {
        /// Number of the subscription, which its samples repeat.
        id: u64,
        /// Name of the channel.
        channel: String,
        /// Largest number of samples per second; default: all that the connection can take.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        rate_hz: Option<f64>,
    },
    /// Ends a subscription.
    Unsubscribe {
        /// Number that the reply repeats.
        id: u64,
        /// Number of the subscription.
        subscription: u64,
    },
    /// Publishes a reading of a plug-in.
    Publish {
        /// Number that the reply repeats.
        id: u64,
        /// The reading.
        reading: Published,
    },
    /// Declares the message of a sensor; body: its complete ROS 2 definition, with comments.
    Declare {
        /// Number that the reply repeats.
        id: u64,
        /// Name of the sensor.
        sensor: String,
        /// Name of the message, in CamelCase.
        message: String,
    },
    /// Publishes a sample of the declared message; body: the sample as it is in memory, with room for its header.
    Sample {
        /// Number that the reply repeats.
        id: u64,
        /// Name of the sensor.
        sensor: String,
        /// When it was true, CLOCK_MONOTONIC of this machine, ns; default: now.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        stamp_ns: Option<u64>,
    },
    /// Asks for the list of finished runs.
    Runs {
        /// Number that the reply repeats.
        id: u64,
    },
    /// Asks for the files of a finished run.
    Files {
        /// Number that the reply repeats.
        id: u64,
        /// Name of the run in the list.
        run: String,
    },
    /// Asks for one of these files, as a descriptor that can only be read.
    Open {
        /// Number that the reply repeats.
        id: u64,
        /// Name of the run.
        run: String,
        /// Name of the file in the list.
        file: String,
    },
    /// Makes files of a finished run, which `files` and `open` then have; the reply comes when they are there.
    Make {
        /// Number that the reply repeats.
        id: u64,
        /// Name of the run.
        run: String,
        /// Which files.
        what: RunFiles,
    },
    /// Deletes a finished run.
    Remove {
        /// Number that the reply repeats.
        id: u64,
        /// Name of the run.
        run: String,
    },
    /// Asks what `nims doctor` finds on the robot's machine.
    Doctor {
        /// Number that the reply repeats.
        id: u64,
    },
    /// Replaces the robot file that the system file names; body: its text, and after it that of a calibration. It is
    /// checked as `nims check` does, and the robot uses it from its next start.
    RobotFile {
        /// Number that the reply repeats.
        id: u64,
        /// Size of the calibration, which the robot file then takes its anchors from, bytes; default: none follows.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        calibration_bytes: Option<usize>,
        /// SHA-256 of the robot file that the text was made from, in hexadecimal digits: another one is not replaced.
        /// Default: any is.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        made_from: Option<String>,
    },
    /// Asks for the seat of the one who flies from a page, or answers who asks.
    Seat {
        /// Number that the reply repeats.
        id: u64,
        /// What about it.
        what: SeatCall,
    },
    /// Creates a code with which one browser gets a token; the robot's user and root only.
    CodeAdd {
        /// Number that the reply repeats.
        id: u64,
        /// Name of the holder.
        name: String,
        /// Role of the holder.
        role: String,
    },
    /// Uses a code.
    CodeUse {
        /// Number that the reply repeats.
        id: u64,
        /// The code, as a person reads it.
        code: String,
    },
    /// Creates a token; the robot's user and root only.
    TokenAdd {
        /// Number that the reply repeats.
        id: u64,
        /// Name of its holder.
        name: String,
        /// Role of its holder.
        role: String,
    },
    /// Asks for the list of tokens, without their secrets; the robot's user and root only.
    TokenList {
        /// Number that the reply repeats.
        id: u64,
    },
    /// Revokes a token; the robot's user and root only.
    TokenRevoke {
        /// Number that the reply repeats.
        id: u64,
        /// Name of its holder.
        name: String,
    },
}

impl Call {
    /// The number that the reply repeats; 0 for [`Call::Hello`] and [`Call::Beat`].
    #[must_use]
    pub fn id(&self) -> u64 {
        match self {
            Self::Hello { .. } | Self::Beat { .. } => 0,
            Self::Ask { id, .. }
            | Self::Release { id }
            | Self::Robot { id }
            | Self::Configuration { id }
            | Self::Channels { id }
            | Self::Subscribe { id, .. }
            | Self::Unsubscribe { id, .. }
            | Self::Publish { id, .. }
            | Self::Declare { id, .. }
            | Self::Sample { id, .. }
            | Self::Runs { id }
            | Self::Files { id, .. }
            | Self::Open { id, .. }
            | Self::Make { id, .. }
            | Self::Remove { id, .. }
            | Self::Doctor { id }
            | Self::RobotFile { id, .. }
            | Self::Seat { id, .. }
            | Self::CodeAdd { id, .. }
            | Self::CodeUse { id, .. }
            | Self::TokenAdd { id, .. }
            | Self::TokenList { id }
            | Self::TokenRevoke { id, .. } => *id,
        }
    }

    /// The JSON of the header of a frame.
    ///
    /// # Errors
    /// JSON cannot hold a number of the request: NaN or an infinity.
    pub fn header(&self) -> Result<Vec<u8>, String> {
        let text = serde_json::to_vec(self).map_err(|error| error.to_string())?;
        // A number that may be left out would otherwise silently be left out.
        match Self::read(&text) {
            Ok(read) if read == *self => Ok(text),
            _ => Err("a number of the request is not finite; give a finite one".to_owned()),
        }
    }

    /// Reads the header of a frame.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn read(header: &[u8]) -> Result<Self, String> {
        serde_json::from_slice(header).map_err(|error| format!("a frame is not a call: {error}"))
    }
}
