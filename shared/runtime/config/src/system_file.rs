//! The system file: which processes run, on which drives, at which rate, with which parameters.

use super::{DeviceSection, Point, SensorLoggerSection, ViewerSection};
use crate::{Algorithm, ControlLaw, DriveProtocol, EstimatorMethod, Slot, StopPin, TensionDistribution};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A system file as written. Paths are relative to the file's own folder.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SystemFile {
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
    /// When a second controller or estimator counts as a standby, and how a swap goes.
    #[serde(default)]
    pub arbiter: ArbiterSection,
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
    /// The live view.
    #[serde(default)]
    pub viewer: ViewerSection,
    /// What becomes of the readings of sensors.
    #[serde(default)]
    pub sensor_logger: SensorLoggerSection,
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
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct MotorIoSection {
    /// Serial ports and the units on them.
    pub ports: Vec<PortSection>,
    /// Encoder counts per metre of line, one per cable; negative where the count falls as line pays out. A calibration by the robot's
    /// own lengths that the robot file names takes their place as they are loaded.
    pub counts_per_m: Vec<f64>,
    /// The drives stop their motors after this time without a packet, s; steps of 0.1.
    #[serde(default = "default_watchdog")]
    pub watchdog_s: f64,
    /// So many cycles in a row without a command, and the robot stops and holds; until then the last one is used.
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
    /// The node's speed is bounded by the robot's speed limit and this share of it.
    #[serde(default = "default_speed_margin")]
    pub node_speed_margin: f64,
    /// Largest change of the node's velocity per time, m/s²; no key: four times the robot's acceleration limit.
    pub node_acceleration_limit_m_s2: Option<f64>,
    /// What a controller may add to the set point's own velocity, m/s; no key: half the robot's speed limit.
    pub correction_limit_m_s: Option<f64>,
    /// A motion that begins farther from the node than this is not started, m.
    #[serde(default = "default_start_bound")]
    pub start_bound_m: f64,
    /// From this distance to the set point on, commands that lead away from it for `divergence_s` are a fault, m.
    #[serde(default = "default_divergence_m")]
    pub divergence_m: f64,
    /// See `divergence_m`, s.
    #[serde(default = "default_divergence_s")]
    pub divergence_s: f64,
}

/// `[[motor_io.ports]]`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PortSection {
    /// Device, e.g. `/dev/serial/by-id/..`; `{domain}` stands for the domain's folder (where the virtual box puts its ports).
    pub path: String,
    /// Drive family on this port.
    #[serde(default)]
    pub protocol: DriveProtocol,
    /// Baud rate.
    #[serde(default = "default_baud")]
    pub baud: u32,
    /// Drive units on this port.
    pub units: Vec<UnitSection>,
    /// Status pin of this port, `cts`, `dsr` or `cd`, that the closed contact of a stop button holds on; no key: none. Open, or not
    /// to be read, is an emergency stop.
    pub stop_pin: Option<StopPin>,
}

/// `[[motor_io.ports.units]]`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct UnitSection {
    /// Address of the unit on the port; which ones there are is up to the drive family.
    pub address: u8,
    /// Cables (from 1) on motor 1 and motor 2.
    pub cables: Vec<usize>,
}

/// `[arbiter]`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct ArbiterSection {
    /// Time for which a second controller or estimator has to answer well beside the one in charge to become its standby, s.
    pub qualify_s: f64,
    /// How far a standby's command may be from that of the controller in charge, as a share of the robot's `cable_speed_limit_m_s`.
    pub command_bound: f64,
    /// How far it may be from it on average, as a share of what is being commanded, and never less than `bias_bound_m_s`.
    pub bias_share: f64,
    /// See `bias_share`, m/s.
    pub bias_bound_m_s: f64,
    /// How far a standby's estimate may be from the one in charge, m.
    pub estimate_bound_m: f64,
    /// From the announcement of a swap to the cycle in which it takes effect, s.
    pub announce_s: f64,
    /// Time in which one command fades into another, s.
    pub fade_s: f64,
    /// Time after a swap in which the first cycle that the new one misses gives the old one its place back, unless it had no processor, s.
    pub probation_s: f64,
    /// A standby that fails so often is set aside until it is admitted again.
    pub quarantine_falls: u8,
    /// Time of good answers after which its failures are forgiven, s.
    pub forgive_s: f64,
}

impl Default for ArbiterSection {
    fn default() -> Self {
        Self {
            qualify_s: 1.0,
            command_bound: 0.15,
            bias_share: 0.25,
            bias_bound_m_s: 0.05,
            estimate_bound_m: 0.02,
            announce_s: 0.1,
            fade_s: 0.25,
            probation_s: 1.0,
            quarantine_falls: 3,
            forgive_s: 10.0,
        }
    }
}

/// `[estimator]`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct EstimatorSection {
    /// How readings become lengths: `phi`, the paper's motor model, or `kalman`, a filter on length and velocity of each line.
    pub method: EstimatorMethod,
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
    /// `kalman`: how late the drives follow, delay and lag together, s.
    pub drive_lag_s: f64,
    /// `kalman`: standard deviation of the acceleration of a line that such a drive does not explain, m/s².
    pub acceleration_sigma_m_s2: f64,
    /// `kalman`: standard deviation of a single reading, m: about an encoder step.
    pub reading_sigma_m: f64,
    /// Cycles for which controllers, planner and sensors may act on an estimate.
    pub ttl_cycles: u32,
}

impl Default for EstimatorSection {
    fn default() -> Self {
        Self {
            method: EstimatorMethod::Phi,
            eta: 50,
            ridge: 1e-4,
            prior: [0.6, 0.4],
            stretch: true,
            sigma_length_m: 0.001,
            drive_lag_s: 0.07,
            acceleration_sigma_m_s2: 1.0,
            reading_sigma_m: 1e-4,
            ttl_cycles: 3,
        }
    }
}

/// `[controller]`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct ControllerSection {
    /// `lq-endpoint`: the paper's fixed-endpoint fixed-time law. `preview`: knows how late the drives are, and falls back
    /// to `lq-endpoint` while its model of them does not fit. `p-feedforward`: each line for itself, desired velocity and a
    /// share of the length error.
    pub law: ControlLaw,
    /// Delta of the law, cycles; best near 2 (delay + lag) / period + 3, unstable below a third of that.
    pub horizon_cycles: usize,
    /// Q and R of the law (scalars times identity). Q > 0 leads on ramps; 0 is best.
    pub state_weight: f64,
    /// R.
    pub input_weight: f64,
    /// How the tension of more than three cables is chosen: `least-norm`, `min-sum` or `safest`.
    pub distribution: TensionDistribution,
    /// Time constant of the loop on the redundant length mode of more than three cables, s.
    pub redundant_s: f64,
    /// `p-feedforward`: velocity per length error, 1/s; no overshoot up to about 1 / (3 (delay + lag)), unstable from about 14
    /// with drives of 60 ms delay and 100 ms lag.
    pub length_gain_per_s: f64,
    /// Correct for the stretch of the lines (needs `stiffness_n` in the robot file).
    pub stretch: bool,
    /// Farther than this from where it should be the controller gives no answer, and the robot stops and holds, m.
    pub error_limit_m: f64,
    /// `preview`: how far it looks ahead beyond the delay, cycles.
    pub preview_cycles: usize,
    /// `preview`: what a squared acceleration of the command costs against a squared length error, s⁴. The feedback is about
    /// as quick as this to the power -1/4, in rad/s; what is known beforehand is followed more quickly than that.
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
            law: ControlLaw::LqEndpoint,
            horizon_cycles: 20,
            state_weight: 0.0,
            input_weight: 1.0,
            distribution: TensionDistribution::LeastNorm,
            redundant_s: 0.3,
            length_gain_per_s: 3.0,
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
#[derive(Debug, Clone, Deserialize, Serialize)]
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
    /// Which of them `nims demo` flies.
    pub demo: PathBuf,
}

impl Default for PlannerSection {
    fn default() -> Self {
        Self {
            speed_m_s: 0.2,
            acceleration_m_s2: 0.3,
            check_step_m: 0.02,
            missions: "../missions".into(),
            demo: "demo".into(),
        }
    }
}

/// `[recorder]`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct RecorderSection {
    /// Recording stops, loudly, below this much free space, bytes.
    pub min_free_bytes: u64,
    /// Longest time before data are handed to the disk, s.
    pub flush_s: f64,
    /// The next file of the run is begun when one has this size, bytes.
    pub segment_bytes: u64,
    /// And when it is this old, s.
    pub segment_s: f64,
    /// Channels that are not recorded (names; a trailing `*` stands for any ending).
    pub exclude: Vec<String>,
}

impl Default for RecorderSection {
    fn default() -> Self {
        Self {
            min_free_bytes: 500_000_000,
            flush_s: 0.5,
            segment_bytes: 2_000_000_000,
            segment_s: 900.0,
            exclude: Vec::new(),
        }
    }
}

/// `[motor_box]`: the virtual motor control box.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct MotorBoxSection {
    /// Where the node hangs at the start, m; `[x, z]` of a planar robot.
    pub start_m: Point,
    /// Delay between a speed command and the drive's reaction, s.
    pub delay_s: f64,
    /// First-order lag of the drive's speed, s.
    pub lag_s: f64,
    /// True line stiffness EA, N, which the robot file need not know.
    pub stiffness_n: f64,
    /// Drag of the node in air or water, N s²/m².
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
    /// Ground file: what stands on the ground, for a rangefinder to look at. Default: nothing.
    pub ground: Option<PathBuf>,
    /// Sensors on the node, behind ports of their own.
    pub device: Vec<DeviceSection>,
}

impl Default for MotorBoxSection {
    fn default() -> Self {
        Self {
            start_m: [4.8, 3.0, 0.3].into(),
            delay_s: 0.03,
            lag_s: 0.04,
            stiffness_n: 6000.0,
            drag_n_s2_m2: 0.02,
            drum_radius_m: 0.02,
            line_diameter_m: 0.000_33,
            turnaround_s: 0.000_15,
            supply_v: 12.0,
            seed: 1,
            ground: None,
            device: Vec::new(),
        }
    }
}

/// `[realtime]`: degrades with one warning where it is not permitted.
#[derive(Debug, Clone, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct RealtimeSection {
    /// SCHED_FIFO priority of motor-io, 1 to 90; estimator and controller get one and two more. 0: ordinary scheduling.
    pub priority: u8,
    /// Processor for the control chain.
    pub cpu: Option<usize>,
    /// Lock memory.
    pub lock_memory: bool,
    /// Longest time that a processor may take to wake up while motor-io runs, µs: 0 keeps them from falling asleep, at the price of
    /// power. No key: as the system likes.
    pub idle_latency_us: Option<u32>,
}

crate::choice! {
    /// What a process does, which decides what its death means.
    pub enum Role {
        /// Virtual motor box.
        MotorBox = "motor-box",
        /// Motor I/O.
        MotorIo = "motor-io",
        /// Estimator.
        Estimator = "estimator",
        /// Controller.
        Controller = "controller",
        /// Planner.
        Planner = "planner",
        /// Recorder.
        Recorder = "recorder",
        /// Anything else, e.g. a sensor.
        Other = "other",
    }
}

/// `[[process]]`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ProcessSection {
    /// Unique name, e.g. `rangefinder`.
    pub name: String,
    /// What it does; default `other`.
    #[serde(default = "default_role")]
    pub role: Role,
    /// Program and arguments. A name without a slash is looked for beside `nims`, then in PATH; a relative path begins at the system file's
    /// folder, which is also where the process runs. `{name}`, `{domain}`, `{system}` and `{run}` stand for its own name, the robot's domain,
    /// the run's copy of the system file and the run folder. A `.toml` file among the arguments is read from the run's copy of it. Empty, for a controller or an estimator: the standard program.
    #[serde(default)]
    pub command: Vec<String>,
    /// For a controller or an estimator: its slot. Default: a, or b for a standby.
    pub slot: Option<Slot>,
    /// A second controller or estimator, in slot b, that takes over when the first one dies.
    #[serde(default)]
    pub standby: bool,
    /// For a controller or an estimator without a `command`: its law, if not the configured one.
    pub law: Option<Algorithm>,
    /// False: started only when it is asked for, by `nims start` or `nims swap`.
    #[serde(default = "yes")]
    pub start: bool,
    /// Start it again when it dies. Default: true for a recorder and where there is a standby, otherwise false.
    pub restart: Option<bool>,
    /// Pause before it is started again, s; doubles each time, up to 30 s.
    #[serde(default = "default_restart_pause")]
    pub restart_pause_s: f64,
    /// How often in a row; a recorder is started again for as long as the robot runs.
    #[serde(default = "default_restart_limit")]
    pub restart_limit: u32,
    /// A process that was ready for this long begins to count anew, s: what killed it before is over.
    #[serde(default = "default_restart_forgive")]
    pub restart_forgive_s: f64,
    /// SCHED_FIFO priority, 1 to 90; 0: ordinary. The control chain has its own, in `[realtime]`.
    #[serde(default)]
    pub priority: u8,
    /// Processor that it runs on; no key: any.
    pub cpu: Option<usize>,
}

impl ProcessSection {
    /// The slot it is for; only controllers and estimators have one.
    #[must_use]
    pub fn slot(&self) -> Slot {
        self.slot.unwrap_or(if self.standby { Slot::B } else { Slot::A })
    }
}

impl Role {
    /// Every role that has a process by default, with its name, which is also that of its program.
    pub const STANDARD: [(&'static str, Self); 6] = [
        (Self::MotorIo.name(), Self::MotorIo),
        (Self::Estimator.name(), Self::Estimator),
        (Self::Controller.name(), Self::Controller),
        (Self::Planner.name(), Self::Planner),
        (Self::Recorder.name(), Self::Recorder),
        (Self::MotorBox.name(), Self::MotorBox),
    ];

    /// The names of what its standard program can compute: laws of the controller, methods of the estimator.
    #[must_use]
    pub fn algorithms(self) -> &'static [&'static str] {
        match self {
            Self::Controller => ControlLaw::NAMES,
            Self::Estimator => EstimatorMethod::NAMES,
            _ => &[],
        }
    }

    /// Whether it has two slots, so that a process can be swapped for another while both live.
    #[must_use]
    pub fn has_slots(self) -> bool {
        matches!(self, Self::Controller | Self::Estimator)
    }

    /// The name of its standard process in that slot.
    #[must_use]
    pub fn process_name(self, slot: Slot) -> String {
        match slot {
            Slot::A => self.name().to_owned(),
            Slot::B => format!("{}-b", self.name()),
        }
    }
}

fn default_role() -> Role {
    Role::Other
}
fn yes() -> bool {
    true
}
fn default_restart_pause() -> f64 {
    0.5
}
fn default_restart_limit() -> u32 {
    3
}
fn default_restart_forgive() -> f64 {
    60.0
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
fn default_speed_margin() -> f64 {
    0.1
}

fn default_start_bound() -> f64 {
    0.05
}

fn default_divergence_m() -> f64 {
    0.1
}

fn default_divergence_s() -> f64 {
    0.1
}

fn default_supply_min() -> f64 {
    10.0
}
