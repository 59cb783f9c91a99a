//! What browsers send, as JSON; `docs/page.md` describes it.

use crate::control::Sign;
use gateway_protocol::{Call, RunFiles, SeatCall};
use messages::Request;
use serde::Deserialize;
use serde_json::{Value, json};

/// A message of a browser. The first one is [`FromBrowser::Hello`].
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "call", rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) enum FromBrowser {
    /// Opens the conversation, for the holder of a token or for everyone who opens the page.
    Hello {
        #[serde(default)]
        token: Option<String>,
    },
    /// Requests something of the robot.
    Ask {
        id: u64,
        request: Request,
        /// Number of the press, which all attempts of it have: an attempt is refused if the robot was stopped since.
        #[serde(default)]
        press: Option<u64>,
    },
    /// Requests a motion that goes on only while the browser sends `beat`.
    Held {
        id: u64,
        request: Request,
        sign: Sign,
        #[serde(default)]
        press: Option<u64>,
    },
    /// The person still holds the control of the motion.
    Beat { sign: Sign },
    /// The person has released it.
    Release {},
    /// Requests a mission by its text.
    Fly {
        id: u64,
        name: String,
        text: String,
        #[serde(default)]
        continues: bool,
    },
    /// Uses a code: the reply has a token for this browser.
    Pair { id: u64, code: String },
    /// Asks to fly, or answers who asks.
    Seat { id: u64, what: SeatCall },
    /// Asks whether the node can hang at a point.
    Check { id: u64, to_m: [f64; 3] },
    /// Answers a question of the guided calibration, or asks for the open one; with the measurements so far.
    Setup { id: u64, name: String, measurements: String, line: Option<String> },
    /// Answers a question of the measurements with a known weight, or asks for the open one; with the measurements so
    /// far. `after_ms`: in time of the server, since when motions of the robot count; none does without it.
    Weigh { id: u64, measurements: String, line: Option<String>, after_ms: Option<f64> },
    /// Asks for the names of all numbers that are kept for the charts.
    Fields { id: u64 },
    /// Asks for the values of a number after an instant, ms in time of the server.
    Series { id: u64, channel: String, field: String, after_ms: f64 },
    /// Asks for the list of finished runs.
    Runs { id: u64 },
    /// Asks for the files of a finished run.
    Files { id: u64, run: String },
    /// Asks for a path at which one of these files can be downloaded once.
    Open {
        id: u64,
        run: String,
        file: String,
        /// To look at it in the browser, where that can show it.
        #[serde(default)]
        show: bool,
    },
    /// Makes files of a finished run.
    Make { id: u64, run: String, what: RunFiles },
    /// Asks what `nims doctor` finds on the robot's machine.
    Doctor { id: u64 },
    /// Deletes a finished run.
    Remove { id: u64, run: String },
    /// Stores a robot file on the robot, and the calibration that it takes its anchors from.
    RobotFile {
        id: u64,
        robot: String,
        #[serde(default)]
        calibration: Option<String>,
        /// SHA-256 of the robot file from which this one was made.
        made_from: String,
    },
}

impl FromBrowser {
    /// Reads a message.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(crate) fn read(text: &str) -> Result<Self, String> {
        serde_json::from_str(text).map_err(|error| format!("a message is not understood: {error}"))
    }
}

/// The gateway's call for a request; `pressed_ns`: when it was pressed for, on CLOCK_MONOTONIC.
pub(crate) fn ask(id: u64, request: Request, pressed_ns: Option<u64>) -> Call {
    Call::Ask { id, request, process: None, held: false, at_ns: None, pressed_ns }
}

/// A refusal of the page itself, in the form of the gateway's answers.
pub(crate) fn refusal(id: u64, sentence: &str) -> Value {
    json!({ "reply": "answer", "id": id, "accepted": "refused", "reason": 0, "sentence": sentence })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_has_known_keys_only() {
        assert_eq!(FromBrowser::read(r#"{"call":"hello"}"#), Ok(FromBrowser::Hello { token: None }));
        let ask = FromBrowser::read(r#"{"call":"ask","id":3,"request":{"verb":"stop"}}"#);
        assert_eq!(ask, Ok(FromBrowser::Ask { id: 3, request: Request::Stop, press: None }));
        for wrong in ["", "[]", r#"{"call":"token-add","id":1,"name":"a","role":"fly"}"#, r#"{"call":"beat"}"#] {
            assert!(FromBrowser::read(wrong).is_err(), "{wrong}");
        }
    }
}
