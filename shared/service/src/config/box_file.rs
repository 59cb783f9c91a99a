//! The box file: which processes run, on which drives, at which rate, with which parameters.

use serde::Deserialize;
use std::path::PathBuf;

/// A box file as written. Paths are relative to the file's own folder.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoxFile {
    /// What people call this box; also the name of its domain in shared memory (a-z, 0-9, dash; at most 16).
    pub name: String,
    /// The robot file.
    pub robot: PathBuf,
    /// Control cycles per second, 10 to 250.
    #[serde(default = "default_rate")]
    pub rate_hz: f64,
    /// Where run folders are made.
    #[serde(default = "default_runs")]
    pub runs: PathBuf,
    /// Drives and safety limits.
    pub motor_io: MotorIoSection,
    /// Lengths to position.
    #[serde(default)]
    pub estimator: EstimatorSection,
    /// Position and motion to velocities.
    #[serde(default)]
    pub controller: ControllerSection,
    /// Missions and their checks.
    #[serde(default)]
    pub planner: PlannerSection,
    /// The run file.
    #[serde(default)]
    pub recorder: RecorderSection,
    /// The virtual motor box; leave out on real hardware.
    pub motor_box: Option<MotorBoxSection>,
    /// Scheduling of the control chain.
    #[serde(default)]
    pub realtime: RealtimeSection,
    /// Processes besides the standard ones, or changes to them.
    #[serde(default)]
    pub process: Vec<ProcessSection>,
}

/// `[motor_io]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotorIoSection {
    /// Serial ports and the units on them.
    pub ports: Vec<PortSection>,
    /// Encoder counts per metre of line, one per cable; negative where the count falls as line pays out.
    pub counts_per_m: Vec<f64>,
    /// The drives stop their motors after this time without a packet, s; steps of 0.1.
    #[serde(default = "default_watchdog")]
    pub watchdog_s: f64,
    /// Cycles for which the last command is used when none arrives, before the robot stops and holds.
    #[serde(default = "default_ttl")]
    pub ttl_cycles: u32,
    /// Time in which pause, hold and resume ramp the plan clock between standstill and full rate, s.
    #[serde(default = "default_ramp")]
    pub ramp_s: f64,
    /// Cable velocity of jogging, m/s.
    #[serde(default = "default_jog")]
    pub jog_speed_m_s: f64,
    /// A cable below this tension (by the estimate) for `slack_cycles` is slack, N.
    #[serde(default = "default_slack")]
    pub slack_n: f64,
    /// Cycles before slack is a fault.
    #[serde(default = "default_slack_cycles")]
    pub slack_cycles: u32,
    /// Drive output above which a cable that hardly moves is stalled or slipping, 0 to 1.
    #[serde(default = "default_stall_duty")]
    pub stall_duty: f64,
    /// Cycles before stall or runaway is a fault.
    #[serde(default = "default_stall_cycles")]
    pub stall_cycles: u32,
    /// Lowest supply voltage, V.
    #[serde(default = "default_supply_min")]
    pub supply_min_v: f64,
}

/// `[[motor_io.ports]]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PortSection {
    /// Device, e.g. `/dev/serial/by-id/..`; `{domain}` stands for the domain's folder (where the virtual box puts its ports).
    pub path: String,
    /// Baud rate.
    #[serde(default = "default_baud")]
    pub baud: u32,
    /// Drive units on this line.
    pub units: Vec<UnitSection>,
}

/// `[[motor_io.ports.units]]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnitSection {
    /// Packet serial address, 0x80 to 0x87.
    pub address: u8,
    /// Cables (from 1) on motor 1 and motor 2.
    pub cables: Vec<usize>,
}

/// `[estimator]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EstimatorSection {
    /// Rows of the sliding window of the motor model (18)-(20).
    pub eta: usize,
    /// Pull of the motor model towards `prior`, (m/s)².
    pub ridge: f64,
    /// `[phi1, phi2]` that an unexcited window is pulled to.
    pub prior: [f64; 2],
    /// Correct for the stretch of the lines (needs `stiffness_n` in the robot file).
    pub stretch: bool,
    /// Standard deviation of a measured length, m; for the covariance.
    pub sigma_length_m: f64,
}

impl Default for EstimatorSection {
    fn default() -> Self {
        Self { eta: 50, ridge: 1e-4, prior: [0.6, 0.4], stretch: true, sigma_length_m: 0.001 }
    }
}

/// `[controller]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ControllerSection {
    /// `lq-endpoint`: the paper's fixed-endpoint fixed-time law. `preview`: knows how late the drives are, and falls back
    /// to `lq-endpoint` while its model of them does not fit.
    pub law: String,
    /// Delta of the law, cycles; best near 2 (delay + lag) / period + 3, unstable below a third of that.
    pub horizon_cycles: usize,
    /// Q and R of the law (scalars times identity). Q > 0 leads on ramps; 0 is best.
    pub state_weight: f64,
    /// R.
    pub input_weight: f64,
    /// How the tension of more than three cables is chosen: `least-norm`, `min-sum` or `safest`.
    pub distribution: String,
    /// Time constant of the loop on the redundant length mode of more than three cables, s.
    pub redundant_s: f64,
    /// Correct for the stretch of the lines (needs `stiffness_n` in the robot file).
    pub stretch: bool,
    /// Farther than this from where it should be the controller gives no answer, and the robot stops and holds, m.
    pub error_limit_m: f64,
    /// `preview`: how far it looks ahead beyond the delay, cycles.
    pub preview_cycles: usize,
    /// `preview`: what a squared acceleration of the command costs against a squared length error, s⁴. The law is about as
    /// quick as this to the power -1/4, in rad/s.
    pub move_penalty_s4: f64,
    /// `preview`: `[delay, lag]` of the drives, s, if known; otherwise `lq-endpoint` flies until they are identified.
    pub drive_lag_s: Option<[f64; 2]>,
    /// `preview`: identify delay and lag while the robot moves.
    pub identify: bool,
    /// `preview`: falls back to `lq-endpoint` above this misfit (about the share by which delay and lag are off together).
    pub misfit_limit: f64,
}

impl Default for ControllerSection {
    fn default() -> Self {
        Self {
            law: "lq-endpoint".into(),
            horizon_cycles: 20,
            state_weight: 0.0,
            input_weight: 1.0,
            distribution: "least-norm".into(),
            redundant_s: 0.3,
            stretch: true,
            error_limit_m: 0.25,
            preview_cycles: 40,
            move_penalty_s4: 1e-5,
            drive_lag_s: None,
            identify: true,
            misfit_limit: 0.25,
        }
    }
}

/// `[planner]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlannerSection {
    /// Cruise speed where a mission names none, m/s.
    pub speed_m_s: f64,
    /// Tangential acceleration, m/s².
    pub acceleration_m_s2: f64,
    /// Distance between the points of a path that are checked against (16), m.
    pub check_step_m: f64,
    /// Where `nims run NAME` looks for missions.
    pub missions: PathBuf,
}

impl Default for PlannerSection {
    fn default() -> Self {
        Self { speed_m_s: 0.2, acceleration_m_s2: 0.3, check_step_m: 0.02, missions: "../missions".into() }
    }
}

/// `[recorder]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RecorderSection {
    /// Recording stops, loudly, below this much free space, bytes.
    pub min_free_bytes: u64,
    /// Longest time before data are handed to the disk, s.
    pub flush_s: f64,
    /// Channels that are not recorded (names; a trailing `*` stands for any ending).
    pub exclude: Vec<String>,
}

impl Default for RecorderSection {
    fn default() -> Self {
        Self { min_free_bytes: 500_000_000, flush_s: 0.5, exclude: Vec::new() }
    }
}

/// `[motor_box]`: the virtual motor control box.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MotorBoxSection {
    /// Where the node hangs at the start, m.
    pub start_m: [f64; 3],
    /// Delay between a speed command and the drive's reaction, s.
    pub delay_s: f64,
    /// First-order lag of the drive's speed, s.
    pub lag_s: f64,
    /// True line stiffness EA, N, which the robot file need not know.
    pub stiffness_n: f64,
    /// Air drag of the node, N s²/m².
    pub drag_n_s2_m2: f64,
    /// Radius of the empty drum, m, and thickness of the line, m.
    pub drum_radius_m: f64,
    /// Line diameter, m.
    pub line_diameter_m: f64,
    /// Time a unit takes to answer, s.
    pub turnaround_s: f64,
    /// Supply voltage, V.
    pub supply_v: f64,
    /// Seed of everything random.
    pub seed: u64,
}

impl Default for MotorBoxSection {
    fn default() -> Self {
        Self {
            start_m: [4.8, 3.0, 0.3],
            delay_s: 0.03,
            lag_s: 0.04,
            stiffness_n: 6000.0,
            drag_n_s2_m2: 0.02,
            drum_radius_m: 0.02,
            line_diameter_m: 0.000_33,
            turnaround_s: 0.000_15,
            supply_v: 12.0,
            seed: 1,
        }
    }
}

/// `[realtime]`: degrades with one warning where it is not permitted.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RealtimeSection {
    /// SCHED_FIFO priority of motor-io, 1 to 90; estimator and controller get one and two more. 0: ordinary scheduling.
    pub priority: u8,
    /// Processor for the control chain.
    pub cpu: Option<usize>,
    /// Lock memory.
    pub lock_memory: bool,
}

/// What a process does, which decides what its death means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// Virtual motor box.
    MotorBox,
    /// Motor I/O.
    MotorIo,
    /// Estimator.
    Estimator,
    /// Controller.
    Controller,
    /// Planner.
    Planner,
    /// Recorder.
    Recorder,
    /// Anything else, e.g. a sensor.
    Other,
}

/// `[[process]]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProcessSection {
    /// Unique name, e.g. `rangefinder`.
    pub name: String,
    /// What it does; default `other`.
    #[serde(default = "default_role")]
    pub role: Role,
    /// Program and arguments; a name without a slash is looked for beside `nims`.
    pub command: Vec<String>,
    /// Start it again when it dies.
    #[serde(default)]
    pub restart: bool,
}

fn default_role() -> Role {
    Role::Other
}
fn default_rate() -> f64 {
    100.0
}
fn default_runs() -> PathBuf {
    "../../runs".into()
}
fn default_baud() -> u32 {
    230_400
}
fn default_watchdog() -> f64 {
    0.3
}
fn default_ttl() -> u32 {
    3
}
fn default_ramp() -> f64 {
    0.5
}
fn default_jog() -> f64 {
    0.05
}
fn default_slack() -> f64 {
    0.5
}
fn default_slack_cycles() -> u32 {
    30
}
fn default_stall_duty() -> f64 {
    0.6
}
fn default_stall_cycles() -> u32 {
    20
}
fn default_supply_min() -> f64 {
    10.0
}
