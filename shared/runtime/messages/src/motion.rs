//! Motion segments and the state of the mission.

use crate::CABLES;
use crate::{Header, layout, message};

/// Most knots of a speed profile.
pub const KNOTS: usize = 32;

layout! {
    /// One segment: a path by arc length and a speed profile on the plan clock.
    pub struct PlanSegment {
        /// When it starts on the plan clock, s, and how long it takes, s.
        start_s: f64,
        duration_s: f64,
        length_m: f64,
        from_m: [f64; 3],
        to_m: [f64; 3],
        /// By kind. Parabola: [mu 1/m]. Spiral: [centre x, y, r0 m, radius growth m/rad, start angle rad, total angle
        /// rad, rise m]. Lateral: amplitudes m of three harmonics down, then three to the left.
        shape: [f64; 8],
        /// Speed profile: between knots the tangential acceleration is constant.
        knot_s_m: [f64; 32],
        knot_v_m_s: [f64; 32],
        /// Non-zero, unique within the run of the planner.
        id: u32,
        knot_count: u32,
        kind: u8 { KIND_NONE = 0, KIND_DWELL = 1, KIND_LINE = 2, KIND_PARABOLA = 3, KIND_SPIRAL = 4, KIND_LATERAL = 5 },
        pad0: [u8; 7],
    }
}

message! {
    /// `plan/motion`, 10 Hz and on change: current and next segment. Without a next segment the motion ends at rest.
    pub struct PlanMotion {
        header: Header,
        current: PlanSegment,
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
    }
}

message! {
    /// `plan/status`: the mission and its progress; a refusal with its reason.
    pub struct PlanStatus {
        header: Header,
        time_left_s: f64,
        elapsed_s: f64,
        /// 0 to 1.
        progress: f64,
        target_m: [f64; 3],
        leg: u32,
        legs: u32,
        refused: u32,
        state: u8 { STATE_IDLE = 0, STATE_READY = 1, STATE_RUNNING = 2, STATE_PAUSED = 3, STATE_DONE = 4, STATE_ABORTED = 5, STATE_REFUSED = 6 },
        pad0: [u8; 3],
        mission: [u8; 64],
        /// As in plan/motion.
        mission_number: u32,
        pad2: [u8; 4],
        /// Why a mission was refused or ended, in one sentence.
        reason: [u8; 256],
        pad1: [u8; CABLES],
    }
}
