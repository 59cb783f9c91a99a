//! Requests: the enum that programs use, and its conversion to and from the sample that travels.

use arrayvec::ArrayVec;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::request_sample::{OperatorRequest, RequestBody};
use crate::slot::{Slot, SlotRole};
use crate::{CABLES, put_text};

/// Shape of the path of a single move.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "shape", rename_all = "kebab-case", deny_unknown_fields)]
pub enum GotoPath {
    /// A straight line.
    Line,
    /// A parabola in a vertical plane.
    Parabola {
        /// Sag, 1/m; `None`: the planner takes the one with the least loss in the motors.
        mu_per_m: Option<f64>,
    },
    /// A path that sags and swings sideways for the least loss in the motors.
    Lateral,
}

/// A request of an operator or of a program.
///
/// ```
/// use messages::Request;
/// let jog = Request::Jog { cable: 2, distance_m: -0.05 };
/// assert_eq!(Request::decode(&jog.encode()?)?, jog);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// As JSON: `{"verb": "jog", "cable": 2, "distance_m": -0.05}`; the hash of a mission in hexadecimal digits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "verb", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Request {
    /// motor-io: switches the drives on.
    Arm,
    /// motor-io: switches the drives off.
    Disarm,
    /// motor-io: comes to rest on the path and keeps the motion.
    Hold,
    /// motor-io: comes to rest on the path and drops the motion.
    Stop,
    /// motor-io: stops the motors at once.
    Estop,
    /// motor-io: leaves a fault or an emergency stop.
    Reset,
    /// motor-io: the node is at this position.
    ZeroAt {
        /// Position of the node, m.
        position_m: [f64; 3],
    },
    /// motor-io: the cables have these lengths.
    ZeroLengths {
        /// Length of each cable, m.
        lengths_m: ArrayVec<f64, CABLES>,
    },
    /// motor-io: the restored position holds.
    ConfirmPosition,
    /// motor-io: moves one cable slowly.
    Jog {
        /// Number of the cable, from 1.
        cable: u8,
        /// Length to move, m; positive pays out.
        distance_m: f64,
    },
    /// motor-io: lets the cables carry the node and yield to a hand.
    Soft,
    /// motor-io: as [`Request::Hold`].
    Pause,
    /// motor-io: continues a motion that was paused.
    Resume,
    /// motor-io: sets the rate of the plan clock.
    Speed {
        /// Rate, 0 to 1.
        rate: f64,
    },
    /// motor-io: puts a slot in charge.
    Swap {
        /// Role of the slot.
        role: SlotRole,
        /// Slot that takes over.
        slot: Slot,
    },
    /// motor-io: admits a quarantined slot again.
    Admit {
        /// Role of the slot.
        role: SlotRole,
        /// Slot that was quarantined.
        slot: Slot,
    },
    /// planner: moves the node to a point.
    Goto {
        /// Target of the node, m.
        to_m: [f64; 3],
        /// Shape of the path.
        path: GotoPath,
        /// Cruise speed, m/s; `None`: the planner's.
        speed_m_s: Option<f64>,
    },
    /// planner: flies a mission that lies in the run folder under its hash.
    Run {
        /// Name of the mission.
        mission: String,
        /// SHA-256 of its text.
        #[serde(with = "crate::hexadecimal")]
        hash: [u8; 32],
        /// Flies the rest of a mission that was interrupted.
        #[serde(default)]
        continues: bool,
    },
    /// Virtual motor box, or a process of a robot with virtual drives: causes a fault. The text is parsed there.
    Fault {
        /// E.g. `slack 2 for 3`.
        text: String,
    },
    /// supervisor: starts a role, a process of the table, or a `[[process]]` of the system file.
    StartProcess {
        /// Name of the process.
        name: String,
        /// For a controller or an estimator: the slot; `None`: the first free one.
        slot: Option<Slot>,
        /// For a controller or an estimator: a law, or the name of a `[[process]]`; `None`: as configured.
        law: Option<String>,
    },
    /// supervisor: ends a process.
    StopProcess {
        /// Name of the process.
        name: String,
    },
    /// supervisor: ends a process if it runs, and starts it.
    RestartProcess {
        /// Name of the process.
        name: String,
    },
    /// supervisor: starts a program that is not in the system file.
    Plug {
        /// Name of the process.
        name: String,
        /// Working directory.
        folder: String,
        /// Program and arguments.
        command: Vec<String>,
        /// Replaces a process of that name.
        #[serde(default)]
        replace: bool,
    },
    /// supervisor: ends a plugged process and removes it from the table.
    Unplug {
        /// Name of the process.
        name: String,
    },
    /// supervisor: marks this instant in the run file.
    Mark {
        /// What is to be found again.
        text: String,
    },
    /// supervisor: sets a parameter of every process of a role, until the run ends.
    Set {
        /// Key in the system file.
        key: String,
        /// New value as TOML.
        value: String,
    },
}

/// A request that does not fit its sample.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum EncodeError {
    /// A text is longer than its field.
    #[error("{what} has {bytes} bytes, and a request holds {room}; shorten it, or put a long command into a script")]
    TooLong {
        /// Description of the text.
        what: &'static str,
        /// Length of the text, bytes.
        bytes: usize,
        /// Length of the field, bytes.
        room: usize,
    },
    /// A text contains a character that separates texts.
    #[error("{text:?} contains a line break or a zero, which a request cannot hold; remove it")]
    Separator {
        /// The text.
        text: String,
    },
}

/// A sample that is not a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum DecodeError {
    /// The verb is unknown.
    #[error("request number {0} is unknown; requester and receiver are of different versions")]
    Verb(u8),
    /// A field has a value without a meaning.
    #[error("{field} is {value} in request number {verb}; requester and receiver are of different versions")]
    Field {
        /// The verb.
        verb: u8,
        /// Name of the field.
        field: &'static str,
        /// Value of the field.
        value: u8,
    },
    /// A text is not UTF-8.
    #[error("{field} is not UTF-8 in request number {verb}; send UTF-8")]
    Text {
        /// The verb.
        verb: u8,
        /// Name of the field.
        field: &'static str,
    },
}

type Body = RequestBody;

impl Request {
    /// The number of the request in [`RequestBody`].
    #[must_use]
    pub fn verb(&self) -> u8 {
        match self {
            Self::Arm => Body::VERB_ARM,
            Self::Disarm => Body::VERB_DISARM,
            Self::Hold => Body::VERB_HOLD,
            Self::Stop => Body::VERB_STOP,
            Self::Estop => Body::VERB_ESTOP,
            Self::Reset => Body::VERB_RESET,
            Self::ZeroAt { .. } => Body::VERB_ZERO_AT,
            Self::ZeroLengths { .. } => Body::VERB_ZERO_LENGTHS,
            Self::ConfirmPosition => Body::VERB_CONFIRM,
            Self::Jog { .. } => Body::VERB_JOG,
            Self::Soft => Body::VERB_SOFT,
            Self::Pause => Body::VERB_PAUSE,
            Self::Resume => Body::VERB_RESUME,
            Self::Speed { .. } => Body::VERB_SPEED,
            Self::Swap { .. } => Body::VERB_SWAP,
            Self::Admit { .. } => Body::VERB_ADMIT,
            Self::Goto { .. } => Body::VERB_GOTO,
            Self::Run { .. } => Body::VERB_RUN,
            Self::Fault { .. } => Body::VERB_FAULT,
            Self::StartProcess { .. } => Body::VERB_START,
            Self::StopProcess { .. } => Body::VERB_END,
            Self::RestartProcess { .. } => Body::VERB_RESTART,
            Self::Plug { .. } => Body::VERB_PLUG,
            Self::Unplug { .. } => Body::VERB_UNPLUG,
            Self::Mark { .. } => Body::VERB_MARK,
            Self::Set { .. } => Body::VERB_SET,
        }
    }

    /// Returns whether the request only ever ends a motion or suspends it: [`RequestBody::is_stop`].
    #[must_use]
    pub fn is_stop(&self) -> bool {
        self.body().is_stop()
    }

    /// The verb and the numbers, without texts: all of a request to motor-io.
    #[must_use]
    pub fn body(&self) -> RequestBody {
        let mut body = Body { verb: self.verb(), ..Body::default() };
        let slot_of = |slot: Slot| slot.index() as u8;
        match self {
            Self::ZeroAt { position_m } => body.position_m = *position_m,
            Self::ZeroLengths { lengths_m } => {
                body.cable_count = lengths_m.len() as u8;
                body.length_m[..lengths_m.len()].copy_from_slice(lengths_m);
            }
            Self::Jog { cable, distance_m } => (body.cable, body.distance_m) = (*cable, *distance_m),
            Self::Speed { rate } => body.rate = *rate,
            Self::Swap { role, slot } | Self::Admit { role, slot } => {
                (body.slot_role, body.slot) = (role.index() as u8, slot_of(*slot));
            }
            Self::Goto { to_m, path, speed_m_s } => {
                body.position_m = *to_m;
                if let Some(speed_m_s) = speed_m_s {
                    body.speed_m_s = *speed_m_s;
                    body.flags |= Body::FLAG_SPEED;
                }
                body.path = match path {
                    GotoPath::Line => Body::PATH_LINE,
                    GotoPath::Parabola { .. } => Body::PATH_SAG,
                    GotoPath::Lateral => Body::PATH_LATERAL,
                };
                if let GotoPath::Parabola { mu_per_m: Some(mu_per_m) } = path {
                    body.mu_per_m = *mu_per_m;
                    body.flags |= Body::FLAG_MU;
                }
            }
            Self::Run { continues: true, .. } => body.flags |= Body::FLAG_REST,
            Self::StartProcess { slot, law, .. } => {
                body.slot = slot.map_or(Body::SLOT_ANY, slot_of);
                body.flags |= if law.is_some() { Body::FLAG_LAW } else { 0 };
            }
            Self::Plug { replace: true, .. } => body.flags |= Body::FLAG_REPLACE,
            _ => {}
        }
        body
    }

    /// The sample to send; header, number and requester are filled in when it is sent.
    ///
    /// # Errors
    /// A text that is too long, or that has a line break or a zero where texts are separated by them.
    pub fn encode(&self) -> Result<OperatorRequest, EncodeError> {
        let mut request = OperatorRequest { body: self.body(), ..OperatorRequest::default() };
        let (name, text) = (&mut request.name, &mut request.text);
        match self {
            Self::Run { mission, hash, .. } => {
                request.hash = *hash;
                put_whole(name, "the name of the mission", mission)?;
            }
            Self::Fault { text: fault } => put_whole(text, "the fault", fault)?,
            Self::Mark { text: mark } => put_whole(text, "the mark", mark)?,
            Self::StartProcess { name: process, law, .. } => {
                put_whole(name, PROCESS, process)?;
                put_whole(text, "the law", law.as_deref().unwrap_or_default())?;
            }
            Self::StopProcess { name: process }
            | Self::RestartProcess { name: process }
            | Self::Unplug { name: process } => put_whole(name, PROCESS, process)?,
            Self::Plug { name: process, folder, command, .. } => {
                put_whole(name, PROCESS, process)?;
                put_whole(text, "the command with its folder", &text_lines(folder, command)?)?;
            }
            Self::Set { key, value } => {
                put_whole(name, "the key", key)?;
                put_whole(text, "the value", value)?;
            }
            _ => {}
        }
        Ok(request)
    }

    /// The request that a sample carries.
    ///
    /// # Errors
    /// An unknown verb, a choice without a meaning, or a text that is not UTF-8.
    pub fn decode(request: &OperatorRequest) -> Result<Self, DecodeError> {
        Self::from_parts(&request.body, &request.name, &request.text, request.hash)
    }

    /// The request of a verb and numbers; its texts are empty, so nothing is allocated. For motor-io, whose requests
    /// have no texts.
    ///
    /// # Errors
    /// An unknown verb, or a choice without a meaning.
    pub fn from_body(body: &RequestBody) -> Result<Self, DecodeError> {
        Self::from_parts(body, &[], &[], [0; 32])
    }

    fn from_parts(body: &Body, name: &[u8], text: &[u8], hash: [u8; 32]) -> Result<Self, DecodeError> {
        let verb = body.verb;
        let name = || whole(name).ok_or(DecodeError::Text { verb, field: "name" });
        let text = || whole(text).ok_or(DecodeError::Text { verb, field: "text" });
        let flag = |flag: u8| body.flags & flag != 0;
        Ok(match verb {
            Body::VERB_ARM => Self::Arm,
            Body::VERB_DISARM => Self::Disarm,
            Body::VERB_HOLD => Self::Hold,
            Body::VERB_STOP => Self::Stop,
            Body::VERB_ESTOP => Self::Estop,
            Body::VERB_RESET => Self::Reset,
            Body::VERB_ZERO_AT => Self::ZeroAt { position_m: body.position_m },
            Body::VERB_ZERO_LENGTHS => {
                let lengths_m = body.length_m.get(..usize::from(body.cable_count));
                let lengths_m = lengths_m.ok_or(body.wrong("cable_count", body.cable_count))?;
                Self::ZeroLengths { lengths_m: lengths_m.iter().copied().collect() }
            }
            Body::VERB_CONFIRM => Self::ConfirmPosition,
            Body::VERB_SOFT => Self::Soft,
            Body::VERB_JOG => Self::Jog { cable: body.cable, distance_m: body.distance_m },
            Body::VERB_PAUSE => Self::Pause,
            Body::VERB_RESUME => Self::Resume,
            Body::VERB_SPEED => Self::Speed { rate: body.rate },
            Body::VERB_SWAP => Self::Swap { role: body.role()?, slot: body.slot()? },
            Body::VERB_ADMIT => Self::Admit { role: body.role()?, slot: body.slot()? },
            Body::VERB_GOTO => Self::Goto {
                to_m: body.position_m,
                path: body.path()?,
                speed_m_s: flag(Body::FLAG_SPEED).then_some(body.speed_m_s),
            },
            Body::VERB_RUN => Self::Run { mission: name()?, hash, continues: flag(Body::FLAG_REST) },
            Body::VERB_FAULT => Self::Fault { text: text()? },
            Body::VERB_START => Self::StartProcess {
                name: name()?,
                slot: if body.slot == Body::SLOT_ANY { None } else { Some(body.slot()?) },
                law: if flag(Body::FLAG_LAW) { Some(text()?) } else { None },
            },
            Body::VERB_END => Self::StopProcess { name: name()? },
            Body::VERB_RESTART => Self::RestartProcess { name: name()? },
            Body::VERB_PLUG => {
                let text = text()?;
                let mut lines = text.split_terminator('\n').map(str::to_owned);
                let folder = lines.next().unwrap_or_default();
                Self::Plug { name: name()?, folder, command: lines.collect(), replace: flag(Body::FLAG_REPLACE) }
            }
            Body::VERB_UNPLUG => Self::Unplug { name: name()? },
            Body::VERB_MARK => Self::Mark { text: text()? },
            Body::VERB_SET => Self::Set { key: name()?, value: text()? },
            unknown => return Err(DecodeError::Verb(unknown)),
        })
    }
}

impl RequestBody {
    /// Returns whether the request only ever ends a motion or suspends it. It does no harm late or twice.
    #[must_use]
    pub const fn is_stop(&self) -> bool {
        matches!(self.verb, Self::VERB_HOLD | Self::VERB_PAUSE | Self::VERB_STOP | Self::VERB_ESTOP)
    }

    /// Marks an instant. Not in the definition, whose text is as long as the attributes of a channel may be.
    pub const VERB_MARK: u8 = 46;

    fn wrong(&self, field: &'static str, value: u8) -> DecodeError {
        DecodeError::Field { verb: self.verb, field, value }
    }

    fn role(&self) -> Result<SlotRole, DecodeError> {
        let role = SlotRole::ALL.get(usize::from(self.slot_role));
        role.copied().ok_or(self.wrong("slot_role", self.slot_role))
    }

    fn slot(&self) -> Result<Slot, DecodeError> {
        Slot::ALL.get(usize::from(self.slot)).copied().ok_or(self.wrong("slot", self.slot))
    }

    fn path(&self) -> Result<GotoPath, DecodeError> {
        let mu_per_m = (self.flags & Self::FLAG_MU != 0).then_some(self.mu_per_m);
        match self.path {
            Self::PATH_LINE => Ok(GotoPath::Line),
            Self::PATH_SAG => Ok(GotoPath::Parabola { mu_per_m }),
            Self::PATH_LATERAL => Ok(GotoPath::Lateral),
            unknown => Err(self.wrong("path", unknown)),
        }
    }
}

const PROCESS: &str = "the name of the process";

/// Writes a text whole or not at all.
fn put_whole(field: &mut [u8], what: &'static str, text: &str) -> Result<(), EncodeError> {
    if text.contains('\0') {
        return Err(EncodeError::Separator { text: text.to_owned() });
    }
    if text.len() > field.len() {
        return Err(EncodeError::TooLong { what, bytes: text.len(), room: field.len() });
    }
    put_text(field, text);
    Ok(())
}

/// A folder and the arguments of a command, each with a line break behind it.
fn text_lines(folder: &str, command: &[String]) -> Result<String, EncodeError> {
    let mut text = String::new();
    for part in std::iter::once(folder).chain(command.iter().map(String::as_str)) {
        if part.contains('\n') {
            return Err(EncodeError::Separator { text: part.to_owned() });
        }
        text.push_str(part);
        text.push('\n');
    }
    Ok(text)
}

/// The text up to the first zero, if it is UTF-8.
fn whole(field: &[u8]) -> Option<String> {
    let end = field.iter().position(|byte| *byte == 0).unwrap_or(field.len());
    std::str::from_utf8(&field[..end]).ok().map(str::to_owned)
}
