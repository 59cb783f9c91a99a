//! The data that `nims top` shows: the newest sample of every channel, with its time.

use messages::{
    ControlStatus, Heartbeat, MotorAuthority, MotorSlots, MotorState, NodeEstimate, PlanStatus, ProcessState, SLOTS,
};

/// The robot at one instant.
#[derive(Debug, Clone, Default)]
pub struct Snapshot {
    /// CLOCK_MONOTONIC, ns.
    pub now_ns: u64,
    /// The robot's domain; `None` if no robot runs, with the reason in `waiting`.
    pub domain: Option<String>,
    /// Why there is no robot to show.
    pub waiting: String,
    /// The run folder.
    pub run: String,
    /// Full scale of the bars.
    pub scale: Scale,
    /// Mode, faults and cycle of motor-io.
    pub authority: Option<MotorAuthority>,
    /// Lengths, velocities and currents of the cables, from motor-io.
    pub state: Option<MotorState>,
    /// Qualification of each controller and estimator, from motor-io.
    pub slots: Option<MotorSlots>,
    /// Newest estimate of each estimator.
    pub estimate: [Option<NodeEstimate>; SLOTS],
    /// Newest status of each controller.
    pub control: [Option<ControlStatus>; SLOTS],
    /// Status of the planner.
    pub plan: Option<PlanStatus>,
    /// The process table, with the last heartbeat of each process.
    pub processes: Vec<(ProcessState, Option<Heartbeat>)>,
    /// The recorder's counts of each channel.
    pub channels: Vec<ChannelRow>,
    /// State of the recording.
    pub recording: Option<Recording>,
    /// Answer to the last key; empty: none, or it was shown long enough.
    pub answer: String,
}

/// Full scale of the bars.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Longest cable, m.
    pub length_m: f64,
    /// Lower and upper tension limit, N.
    pub tension_n: [f64; 2],
    /// Greatest current, A.
    pub current_a: f64,
}

impl Default for Scale {
    /// Scale for a robot whose file cannot be read.
    fn default() -> Self {
        Self { length_m: 20.0, tension_n: [0.0, 100.0], current_a: 10.0 }
    }
}

/// The recorder's counts of one channel.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ChannelRow {
    /// Channel name.
    pub name: String,
    /// Samples per second over the last few seconds.
    pub hz: f64,
    /// Samples lost since the recorder started.
    pub lost: u64,
}

/// The state of the recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// Why nothing is being recorded; `None` while recording.
    pub why: Option<String>,
    /// Bytes recorded so far.
    pub bytes: u64,
    /// Samples lost, over all channels.
    pub lost: u64,
    /// Free disk space, bytes.
    pub free_bytes: u64,
    /// CLOCK_MONOTONIC time of the recorder's status, ns.
    pub stamp_ns: u64,
}

impl Snapshot {
    /// Returns a snapshot without a robot, with the reason.
    #[must_use]
    pub fn waiting(now_ns: u64, why: &str) -> Self {
        Self { now_ns, waiting: why.to_owned(), ..Self::default() }
    }

    /// Returns the time since a stamp, s.
    #[must_use]
    pub fn age_s(&self, stamp_ns: u64) -> f64 {
        self.now_ns.saturating_sub(stamp_ns) as f64 * 1e-9
    }
}
