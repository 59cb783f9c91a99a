//! What `nims top` shows, as plain data: whatever was heard last, and when.

use messages::{
    ControlStatus, Heartbeat, MotorAuthority, MotorSlots, MotorState, NodeEstimate, PlanStatus, ProcessState, SLOTS,
};

/// The robot at one instant.
#[derive(Debug, Clone, Default)]
pub struct Snapshot {
    /// CLOCK_MONOTONIC, ns.
    pub now_ns: u64,
    /// The robot's domain; `None`: there is no robot, and `waiting` says so.
    pub domain: Option<String>,
    /// Why nothing is shown.
    pub waiting: String,
    /// The run folder.
    pub run: String,
    /// What the bars reach to.
    pub scale: Scale,
    /// From motor-io.
    pub authority: Option<MotorAuthority>,
    /// From motor-io.
    pub state: Option<MotorState>,
    /// From motor-io: how far each controller and estimator is trusted.
    pub slots: Option<MotorSlots>,
    /// From each estimator.
    pub estimate: [Option<NodeEstimate>; SLOTS],
    /// From each controller.
    pub control: [Option<ControlStatus>; SLOTS],
    /// From the planner.
    pub plan: Option<PlanStatus>,
    /// The process table, with the last heartbeat of each.
    pub processes: Vec<(ProcessState, Option<Heartbeat>)>,
    /// What the recorder says of each channel.
    pub channels: Vec<ChannelRow>,
    /// The recorder as a whole.
    pub recording: Option<Recording>,
}

/// Full scale of the bars.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Longest line, m.
    pub length_m: f64,
    /// Least and greatest tension, N.
    pub tension_n: [f64; 2],
    /// Greatest current, A.
    pub current_a: f64,
}

impl Default for Scale {
    /// For a robot whose file is not known.
    fn default() -> Self {
        Self { length_m: 20.0, tension_n: [0.0, 100.0], current_a: 10.0 }
    }
}

/// One channel, as the recorder sees it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ChannelRow {
    /// Name.
    pub name: String,
    /// Samples per second, over the last seconds.
    pub hz: f64,
    /// Samples lost since the recorder began.
    pub lost: u64,
}

/// The state of the recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// Why nothing is being recorded, if that is so.
    pub why: Option<String>,
    /// Bytes so far.
    pub bytes: u64,
    /// Samples lost, over all channels.
    pub lost: u64,
    /// Room left, bytes.
    pub free_bytes: u64,
    /// When it said so, ns.
    pub stamp_ns: u64,
}

impl Snapshot {
    /// Nothing to show, and why.
    #[must_use]
    pub fn waiting(now_ns: u64, why: &str) -> Self {
        Self { now_ns, waiting: why.to_owned(), ..Self::default() }
    }

    /// Seconds since a stamp.
    #[must_use]
    pub fn age_s(&self, stamp_ns: u64) -> f64 {
        self.now_ns.saturating_sub(stamp_ns) as f64 * 1e-9
    }
}
