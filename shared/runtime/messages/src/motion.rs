//! Motion segments and the state of the mission.

use crate::CABLES;
use crate::{DETAIL_BYTES, Header, RequestAnswer, layout, message, put_sentence, text_of};

/// Most knots of a speed profile.
pub const KNOTS: usize = 32;

layout! {
    /// One segment: a path by arc length and a speed profile on the plan clock.
    pub struct PlanSegment {
        /// When it starts on the plan clock, s.
        start_s: f64,
        /// Duration on the plan clock, s.
        duration_s: f64,
        /// Length of the path, m.
        length_m: f64,
        /// Where it starts, m.
        from_m: [f64; 3],
        /// Where it ends, m.
        to_m: [f64; 3],
        /// By kind. Parabola: [mu 1/m]. Spiral: [centre x, y, r0 m, radius growth m/rad, start angle rad, total angle
        /// rad, rise m]. Lateral: amplitudes m of three harmonics down, then three to the left.
        shape: [f64; 8],
        /// Speed profile: arc length at each knot, m; between knots the tangential acceleration is constant.
        knot_s_m: [f64; 32],
        /// Speed at each knot, m/s.
        knot_v_m_s: [f64; 32],
        /// Non-zero, unique within the run of the planner.
        id: u32,
        /// Number of knots.
        knot_count: u32,
        /// Shape of the path.
        kind: u8 { KIND_NONE = 0, KIND_DWELL = 1, KIND_LINE = 2, KIND_PARABOLA = 3, KIND_SPIRAL = 4, KIND_LATERAL = 5 },
        pad0: [u8; 7],
    }
}

message! {
    /// `plan/motion`, 10 Hz and on change: current and next segment. Without a next segment the motion ends at rest.
    pub struct PlanMotion {
        header: Header,
        /// Segment that is followed, or about to be.
        current: PlanSegment,
        /// Segment after it; kind 0: none.
        next: PlanSegment,
        /// End of the motion on the plan clock, s.
        end_s: f64,
        /// Number of the motion, from rest to rest; 0: none.
        motion: u32,
        /// Epoch of motor/authority for which it was planned.
        epoch: u32,
        /// Number of the mission, from its acceptance to its end; 0: none.
        mission: u32,
        pad0: [u8; 4],
        /// Beat of the planner: increases with every sample.
        beat: u64,
        /// When the motion was asked for, ns.
        asked_ns: u64,
    }
}

message! {
    /// `plan/status`: the mission and its progress; a refusal with its reason.
    pub struct PlanStatus {
        header: Header,
        /// Time to the end of the mission at the present rate of the plan clock, s.
        time_left_s: f64,
        /// Time flown so far on the plan clock, s.
        elapsed_s: f64,
        /// 0 to 1.
        progress: f64,
        /// End of the present leg, m.
        target_m: [f64; 3],
        /// Number of the present leg, from 1.
        leg: u32,
        /// Number of legs.
        legs: u32,
        /// Missions and motions refused since the start of the planner.
        refused: u32,
        /// State of the mission.
        state: u8 { STATE_IDLE = 0, STATE_READY = 1, STATE_RUNNING = 2, STATE_PAUSED = 3, STATE_DONE = 4, STATE_ABORTED = 5, STATE_REFUSED = 6 },
        pad0: [u8; 3],
        /// Name of the mission.
        mission: [u8; 64],
        /// As in plan/motion.
        mission_number: u32,
        /// Why a mission was refused or ended: a number of the catalogue of answers; 0: none.
        reason_code: u32,
        /// Parameters of `reason_code`; the catalogue of answers defines their order.
        reason_value: [f64; 6],
        /// Whole-number parameters of `reason_code`.
        reason_number: [u64; 6],
        /// Text parameters of `reason_code`.
        detail: [u8; 512],
        /// `reason_code` in English.
        reason: [u8; 256],
        pad1: [u8; CABLES],
    }
}

impl PlanStatus {
    /// Sets the reason with its parameters and its sentence. The default of the argument removes it.
    pub fn put_reason(&mut self, answer: &RequestAnswer) {
        self.reason_code = answer.reason.into();
        (self.reason_number, self.reason_value, self.detail) = (answer.number, answer.value, answer.detail);
        put_sentence(&mut self.reason, &text_of(&answer.text));
    }

    /// The reason, if there is one; without a verdict, and with the sentence as it is recorded here.
    #[must_use]
    pub fn recorded_reason(&self) -> Option<RequestAnswer> {
        let reason = u16::try_from(self.reason_code).ok().filter(|reason| *reason != 0)?;
        let (number, value, detail): (_, _, [u8; DETAIL_BYTES]) = (self.reason_number, self.reason_value, self.detail);
        let mut answer = RequestAnswer { reason, number, value, detail, ..RequestAnswer::default() };
        answer.text[..self.reason.len()].copy_from_slice(&self.reason);
        Some(answer)
    }
}
