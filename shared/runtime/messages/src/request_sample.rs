//! The sample in which a request travels, and its answer.

use crate::{CABLES, Header, layout, message};

layout! {
    /// Verb and numbers of a request, as `operator/request` and `motor/input` carry them. Fields that a verb does not
    /// use are 0.
    pub struct RequestBody {
        /// ZERO_AT: where the node is; GOTO: where to, m.
        position_m: [f64; 3],
        /// ZERO_LENGTHS: length of each cable, m; the first `cable_count` hold.
        length_m: [f64; CABLES],
        /// JOG: m; positive pays out.
        distance_m: f64,
        /// GOTO: cruise speed, m/s; holds with FLAG_SPEED.
        speed_m_s: f64,
        /// GOTO with PATH_SAG: sag, 1/m; holds with FLAG_MU.
        mu_per_m: f64,
        /// SPEED: rate of the plan clock, 0 to 1.
        rate: f64,
        /// 0: none; 46: MARK. END: of a process; STOP: of the robot.
        verb: u8 {
            VERB_ARM = 1, VERB_DISARM = 2, VERB_HOLD = 3, VERB_STOP = 4, VERB_ESTOP = 5, VERB_RESET = 6, VERB_ZERO_AT = 7,
            VERB_ZERO_LENGTHS = 8, VERB_CONFIRM = 9, VERB_JOG = 10, VERB_PAUSE = 11, VERB_RESUME = 12, VERB_SPEED = 13, VERB_SWAP = 14, VERB_ADMIT = 15, VERB_SOFT = 16,
            VERB_GOTO = 20, VERB_RUN = 21, VERB_FAULT = 30,
            VERB_START = 40, VERB_END = 41, VERB_RESTART = 42, VERB_PLUG = 43, VERB_UNPLUG = 44,
            VERB_SET = 45,
        },
        /// JOG: which cable, from 1.
        cable: u8,
        /// ZERO_LENGTHS: number of lengths.
        cable_count: u8,
        /// SWAP, ADMIT: 0 controller, 1 estimator.
        slot_role: u8,
        /// SWAP, ADMIT, START.
        slot: u8 { SLOT_A = 0, SLOT_B = 1, SLOT_ANY = 2 },
        /// GOTO.
        path: u8 { PATH_LINE = 0, PATH_SAG = 1, PATH_LATERAL = 2 },
        /// REST: of RUN, the rest of an interrupted mission. REPLACE: of PLUG. LAW: START names a law in `text`.
        flags: u8 { FLAG_SPEED = 1, FLAG_MU = 2, FLAG_REST = 4, FLAG_REPLACE = 8, FLAG_LAW = 16 },
        pad0: u8,
    }
}

message! {
    /// A request and, when `answered` is 1, its answer. On `operator/request` both are published.
    pub struct OperatorRequest {
        header: Header,
        /// Number of the request, by its sender.
        id: u64,
        /// Verb and numbers of the request.
        body: RequestBody,
        /// Parameters of `reason`; the catalogue of answers defines their order.
        reason_value: [f64; 6],
        /// Whole-number parameters of `reason`.
        reason_number: [u64; 6],
        /// Process that sends the request.
        pid: u32,
        /// User who sends the request, as the kernel knows the process.
        uid: u32,
        /// Why the request was accepted or refused: a number of the catalogue of answers; 0: none.
        reason: u16,
        /// 1: this is an answer.
        answered: u8,
        /// Verdict of an answer.
        accepted: u8 { REFUSED = 0, ACCEPTED = 1, BAD_INPUT = 2 },
        /// Permissions of the requester.
        role: u8 { ROLE_OPERATOR = 0, ROLE_OBSERVER = 1, ROLE_ENGINEER = 2 },
        /// Kind of the program that sends the request; 0: unknown.
        origin: u8 { ORIGIN_COMMAND = 1, ORIGIN_PAGE = 2, ORIGIN_PYTHON = 3, ORIGIN_SUPERVISOR = 4, ORIGIN_ESTOP = 5 },
        pad0: [u8; 2],
        /// Name of the user, or of the process that sends the request by itself.
        requester: [u8; 32],
        /// RUN: SHA-256 of the mission's text.
        hash: [u8; 32],
        /// RUN: the mission. Requests to the supervisor: the process, or the key of SET.
        name: [u8; 128],
        /// START: law. PLUG: folder and arguments, a text line each. SET: value. FAULT: the fault. MARK: what to find
        /// again.
        text: [u8; 512],
        /// Text parameter of `reason`.
        detail: [u8; 512],
        /// The answer in English.
        answer: [u8; 512],
    }
}

/// Bytes of the text parameter of an answer.
pub const DETAIL_BYTES: usize = 512;

/// An answer to a request, as the catalogue of answers makes it.
#[derive(Debug, Clone, Copy)]
pub struct RequestAnswer {
    /// [`OperatorRequest::ACCEPTED`], [`OperatorRequest::REFUSED`] or [`OperatorRequest::BAD_INPUT`].
    pub accepted: u8,
    /// Number of the reason; 0: none.
    pub reason: u16,
    /// Integer parameters of the reason.
    pub number: [u64; 6],
    /// Physical parameters of the reason.
    pub value: [f64; 6],
    /// Text parameter of the reason.
    pub detail: [u8; DETAIL_BYTES],
    /// The answer in English.
    pub text: [u8; 512],
}

impl Default for RequestAnswer {
    fn default() -> Self {
        Self { accepted: 0, reason: 0, number: [0; 6], value: [0.0; 6], detail: [0; DETAIL_BYTES], text: [0; 512] }
    }
}

/// Two answers are equal if their bits are: a parameter may be NaN.
impl PartialEq for RequestAnswer {
    fn eq(&self, other: &Self) -> bool {
        (self.accepted, self.reason, self.number, self.value.map(f64::to_bits))
            == (other.accepted, other.reason, other.number, other.value.map(f64::to_bits))
            && (self.detail, self.text) == (other.detail, other.text)
    }
}

impl OperatorRequest {
    /// Adds the answer to the request.
    pub fn put_answer(&mut self, answer: &RequestAnswer) {
        (self.answered, self.accepted, self.reason) = (1, answer.accepted, answer.reason);
        (self.reason_number, self.reason_value) = (answer.number, answer.value);
        (self.detail, self.answer) = (answer.detail, answer.text);
    }

    /// The answer, if there is one.
    #[must_use]
    pub fn recorded_answer(&self) -> Option<RequestAnswer> {
        (self.answered == 1).then_some(RequestAnswer {
            accepted: self.accepted,
            reason: self.reason,
            number: self.reason_number,
            value: self.reason_value,
            detail: self.detail,
            text: self.answer,
        })
    }
}
