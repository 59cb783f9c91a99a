//! The system file: processes, drives, control rate and parameters of a robot.

use super::{MotorBoxTable, SensorLoggerSection, ViewerSection};
use crate::{Algorithm, ControlLaw, DriveProtocol, EstimatorMethod, StopPin, TensionDistribution};
use messages::Slot;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A system file as written. Paths are relative to the file's own folder.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SystemFile {
    /// Name of the system and of its domain in shared memory: 1 to 16 of a-z, 0-9, dash.
    pub name: String,
    /// Path of the robot file.
    pub robot: PathBuf,
    /// Control cycles per second, 10 to 250.
    #[serde(default = "default_rate")]
    pub rate_hz: f64,
    /// Folder in which run folders are created.
    #[serde(default = "default_runs")]
    pub runs: PathBuf,
    /// Drives and safety limits.
    pub motor_io: MotorIoSection,
    /// Qualification of standby controllers and estimators, and swaps.
    #[serde(default)]
    pub arbiter: ArbiterSection,
    /// The estimator: cable lengths to position.
    #[serde(default)]
    pub estimator: EstimatorSection,
    /// The controller: position and motion to cable velocities.
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
    /// Storage of sensor readings and live maps.
    #[serde(default)]
    pub sensor_logger: SensorLoggerSection,
    /// The virtual motor box; omit it on real hardware.
    pub motor_box: Option<MotorBoxTable>,
    /// Scheduling of the control chain.
    #[serde(default)]
    pub realtime: RealtimeSection,
    /// Processes in addition to the standard ones, or replacements of them.
    #[serde(default)]
    pub process: Vec<ProcessSection>,
}

/// `[motor_io]`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct MotorIoSection {
    /// Serial ports with their drive units.
    pub ports: Vec<PortSection>,
    /// Encoder counts per metre of cable, one value per cable; negative if the count decreases while the cable pays
    /// out. A calibration with the robot's encoders, named in the robot file, replaces them when the file is loaded.
    pub counts_per_m: Vec<f64>,
    /// Time without a packet after which the drives stop their motors, s; in steps of 0.1.
    #[serde(default = "default_watchdog")]
    pub watchdog_s: f64,
    /// Number of consecutive cycles without a command after which the robot stops and holds; until then the last
    /// command applies.
    #[serde(default = "default_ttl")]
    pub ttl_cycles: u32,
    /// Time in which pause, hold and resume ramp the plan clock between rest and full rate, s.
    #[serde(default = "default_ramp")]
    pub ramp_s: f64,
    /// Cable velocity of jogging, m/s.
    #[serde(default = "default_jog")]
    pub jog_speed_m_s: f64,
    /// Estimated tension below which a cable is slack, N.
    #[serde(default = "default_slack")]
    pub slack_n: f64,
    /// Cycles after which a slack cable is a fault.
    #[serde(default = "default_slack_cycles")]
    pub slack_cycles: u32,
    /// Drive output above which a cable that hardly moves is stalled or slipping, 0 to 1.
    #[serde(default = "default_stall_duty")]
    pub stall_duty: f64,
    /// Cycles after which a stall or a runaway is a fault.
    #[serde(default = "default_stall_cycles")]
    pub stall_cycles: u32,
    /// Lowest supply voltage, V: below it the robot warns, and the planner rejects what the motors cannot do at it less
    /// 5 %. 0 for neither.
    #[serde(default = "default_supply_min")]
    pub supply_min_v: f64,
    /// Fraction by which the node may exceed the robot's speed limit.
    #[serde(default = "default_speed_margin")]
    pub node_speed_margin: f64,
    /// Largest acceleration of the node, m/s²; default: four times the robot's acceleration limit.
    pub node_acceleration_limit_m_s2: Option<f64>,
    /// Largest velocity that a controller may add to that of the setpoint, m/s; default: half the robot's speed limit.
    pub correction_limit_m_s: Option<f64>,
    /// Largest distance from the node to the start of a motion, m; motions that start farther away are rejected.
    #[serde(default = "default_start_bound")]
    pub start_bound_m: f64,
    /// Distance from the setpoint beyond which commands that lead away from it for `divergence_s` are a fault, m.
    #[serde(default = "default_divergence_m")]
    pub divergence_m: f64,
    /// Time for which commands may lead away from the setpoint beyond `divergence_m`, s.
    #[serde(default = "default_divergence_s")]
    pub divergence_s: f64,
}

/// `[[motor_io.ports]]`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PortSection {
    /// Device, e.g. `/dev/serial/by-id/..`; `{domain}` is replaced by the domain's folder, where the virtual motor box
    /// creates its ports.
    pub path: String,
    /// Drive family on this port.
    #[serde(default)]
    pub protocol: DriveProtocol,
    /// Baud rate.
    #[serde(default = "default_baud")]
    pub baud: u32,
    /// Drive units on this port.
    pub units: Vec<UnitSection>,
    /// Status input of this port, `cts`, `dsr` or `cd`, that the closed contact of a stop button keeps active; default:
    /// none. An inactive or unreadable input is an emergency stop.
    pub stop_pin: Option<StopPin>,
}

/// `[[motor_io.ports.units]]`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct UnitSection {
    /// Address of the unit on the port; which ones there are is up to the drive family.
    pub address: u8,
    /// Numbers, from 1, of the cables on motor 1 and motor 2.
    pub cables: Vec<usize>,
}

/// `[arbiter]`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct ArbiterSection {
    /// Time for which a second controller or estimator must publish good output to qualify as standby, s.
    pub qualify_s: f64,
    /// Largest deviation of a standby's command from that of the controller in charge, as a fraction of the robot's
    /// `cable_speed_limit_m_s`.
    pub command_bound: f64,
    /// Largest mean deviation of a standby's command, as a fraction of the command; at least `bias_bound_m_s` is
    /// allowed.
    pub bias_share: f64,
    /// Mean deviation that is always allowed, m/s; see `bias_share`.
    pub bias_bound_m_s: f64,
    /// Largest deviation of a standby's estimate from that of the estimator in charge, m.
    pub estimate_bound_m: f64,
    /// Time from the announcement of a swap to the cycle in which it takes effect, s.
    pub announce_s: f64,
    /// Time in which one command fades into another, s.
    pub fade_s: f64,
    /// Time after a swap during which one missed cycle reverts it, s; cycles missed for lack of CPU time do not count.
    pub probation_s: f64,
    /// Number of failures after which a standby is quarantined until it is admitted again.
    pub quarantine_falls: u8,
    /// Time of good output after which the count of failures is reset, s.
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
    /// Method that computes the lengths: `phi`, the paper's motor model, or `kalman`, a filter on length and velocity
    /// of each cable.
    pub method: EstimatorMethod,
    /// Rows of the sliding window of the motor model (18)-(20).
    pub eta: usize,
    /// Weight that pulls the motor model towards `prior`, (m/s)².
    pub ridge: f64,
    /// `[phi1, phi2]` of a window without excitation.
    #[serde(deserialize_with = "crate::exactly")]
    pub prior: [f64; 2],
    /// Correct for the stretch of the cables (needs `stiffness_n` in the robot file).
    pub stretch: bool,
    /// Standard deviation of a measured length, m; for the covariance.
    pub sigma_length_m: f64,
    /// `kalman`: delay and lag of the drives together, s.
    pub drive_lag_s: f64,
    /// `kalman`: standard deviation of the cable acceleration that the drive model does not explain, m/s².
    pub acceleration_sigma_m_s2: f64,
    /// `kalman`: standard deviation of a single reading, m; about one encoder step.
    pub reading_sigma_m: f64,
    /// Age, in cycles, up to which controllers, planner and sensors may use an estimate.
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
    /// `lq-endpoint`: the paper's fixed-endpoint fixed-time law. `preview`: preview control with a model of the drives'
    /// delay and lag; `lq-endpoint` while the model does not fit. `p-feedforward`: per cable, the desired velocity plus
    /// a gain times the length error.
    pub law: ControlLaw,
    /// `lq-endpoint`: horizon Delta, cycles; best near 2 (delay + lag) / period + 3, unstable below a third of that.
    pub horizon_cycles: usize,
    /// `lq-endpoint`: state weight Q, a scalar times identity. Q > 0 leads on ramps; 0 is best.
    pub state_weight: f64,
    /// `lq-endpoint`: input weight R, a scalar times identity.
    pub input_weight: f64,
    /// Tension distribution of redundant cables: `least-norm`, `min-sum` or `safest`.
    pub distribution: TensionDistribution,
    /// Time constant of the loop on the redundant length mode of more than three cables, s.
    pub redundant_s: f64,
    /// `p-feedforward`: gain from length error to velocity, 1/s; no overshoot up to about 1 / (3 (delay + lag)),
    /// unstable from about 14 with drives of 60 ms delay and 100 ms lag.
    pub length_gain_per_s: f64,
    /// Correct for the stretch of the cables (needs `stiffness_n` in the robot file).
    pub stretch: bool,
    /// Distance from the setpoint beyond which the controller gives no output, so that the robot stops and holds, m.
    pub error_limit_m: f64,
    /// `preview`: cycles of preview beyond the delay.
    pub preview_cycles: usize,
    /// `preview`: cost of a squared acceleration of the command relative to a squared length error, s⁴. The bandwidth
    /// of the feedback is about this value to the power -1/4, in rad/s; the known motion is followed faster than that.
    pub move_penalty_s4: f64,
    /// `preview`: `[delay, lag]` of the drives, s, if known; otherwise `lq-endpoint` is used until they are identified.
    #[serde(default, deserialize_with = "crate::exactly_if_given")]
    pub drive_lag_s: Option<[f64; 2]>,
    /// `preview`: identify delay and lag while the robot moves.
    pub identify: bool,
    /// `preview`: misfit above which `lq-endpoint` is used; about the relative error of delay plus lag.
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
    /// Cruise speed of missions that set none, m/s.
    pub speed_m_s: f64,
    /// Tangential acceleration, m/s².
    pub acceleration_m_s2: f64,
    /// Distance between the points of a path that are checked against (16), m.
    pub check_step_m: f64,
    /// Moves whose accelerations would make the node swing on its cables by more than this are shaped, m.
    pub swing_limit_m: f64,
    /// Folder of the missions that `nims run NAME` flies by name.
    pub missions: PathBuf,
    /// The mission that `nims demo` flies.
    pub demo: PathBuf,
}

impl Default for PlannerSection {
    fn default() -> Self {
        Self {
            speed_m_s: 0.2,
            acceleration_m_s2: 0.3,
            check_step_m: 0.02,
            swing_limit_m: 0.005,
            missions: "../missions".into(),
            demo: "demo".into(),
        }
    }
}

/// `[recorder]`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct RecorderSection {
    /// Free disk space below which recording stops with an error, bytes.
    pub min_free_bytes: u64,
    /// Longest time before data are written to the disk, s.
    pub flush_s: f64,
    /// Size at which the next file of the run is started, bytes.
    pub segment_bytes: u64,
    /// Age at which the next file of the run is started, s.
    pub segment_s: f64,
    /// Channels that are not recorded (names; a trailing `*` matches any ending).
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

/// `[realtime]`: without the permissions for it, the system runs with ordinary scheduling and logs one warning.
#[derive(Debug, Clone, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct RealtimeSection {
    /// SCHED_FIFO priority of motor-io, 1 to 90; that of estimator and controller is one and two higher. 0: ordinary
    /// scheduling.
    pub priority: u8,
    /// CPU of the control chain; default: any.
    pub cpu: Option<usize>,
    /// Lock the memory of the control chain in RAM.
    pub lock_memory: bool,
    /// Longest wake-up latency of the CPUs while motor-io runs, µs; 0 disables their idle states, which costs power.
    /// Default: not limited.
    pub idle_latency_us: Option<u32>,
}

crate::choice! {
    /// Role of a process. It determines the consequences of its death.
    pub enum Role {
        /// The virtual motor box.
        MotorBox = "motor-box",
        /// The process that controls the drives.
        MotorIo = "motor-io",
        /// An estimator.
        Estimator = "estimator",
        /// A controller.
        Controller = "controller",
        /// The planner.
        Planner = "planner",
        /// The recorder.
        Recorder = "recorder",
        /// Any other process, e.g. a sensor.
        Other = "other",
    }
}

/// `[[process]]`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ProcessSection {
    /// Unique name, e.g. `rangefinder`.
    pub name: String,
    /// Role of the process; default `other`.
    #[serde(default = "default_role")]
    pub role: Role,
    /// Program and arguments. A name without a slash is searched in the folder of `nims`, then in PATH; a relative path
    /// starts at the folder of the system file, which is also the working folder. `{name}`, `{domain}`, `{system}` and
    /// `{run}` are replaced by the name of the process, the robot's domain, the run's copy of the system file and the
    /// run folder. A `.toml` file among the arguments is replaced by the run's copy of it. Empty, for a controller or
    /// an estimator: the standard program.
    #[serde(default)]
    pub command: Vec<String>,
    /// Slot of a controller or estimator. Default: a, or b for a standby.
    #[serde(default, with = "crate::slot")]
    pub slot: Option<Slot>,
    /// A second controller or estimator, in slot b, that takes over when the first one dies.
    #[serde(default)]
    pub standby: bool,
    /// Law or method of a controller or estimator without a `command`; default: as configured.
    pub law: Option<Algorithm>,
    /// False: started only by `nims start` or `nims swap`.
    #[serde(default = "yes")]
    pub start: bool,
    /// Restart the process when it dies. Default: true for a recorder and for a role with a standby, otherwise false.
    pub restart: Option<bool>,
    /// Pause before a restart, s; doubles with each restart, up to 30 s.
    #[serde(default = "default_restart_pause")]
    pub restart_pause_s: f64,
    /// Largest number of consecutive restarts; a recorder is restarted without limit.
    #[serde(default = "default_restart_limit")]
    pub restart_limit: u32,
    /// Time for which a process must be ready to reset the count of its restarts, s.
    #[serde(default = "default_restart_forgive")]
    pub restart_forgive_s: f64,
    /// SCHED_FIFO priority, 1 to 90; 0: ordinary. That of the control chain is in `[realtime]`.
    #[serde(default)]
    pub priority: u8,
    /// CPU of the process; default: any.
    pub cpu: Option<usize>,
}

impl ProcessSection {
    /// Returns the slot; only controllers and estimators have one.
    #[must_use]
    pub fn slot(&self) -> Slot {
        self.slot.unwrap_or(if self.standby { Slot::B } else { Slot::A })
    }
}

impl Role {
    /// Every role with a standard process, with the name of the role, of the process and of its program.
    pub const STANDARD: [(&'static str, Self); 6] = [
        (Self::MotorIo.name(), Self::MotorIo),
        (Self::Estimator.name(), Self::Estimator),
        (Self::Controller.name(), Self::Controller),
        (Self::Planner.name(), Self::Planner),
        (Self::Recorder.name(), Self::Recorder),
        (Self::MotorBox.name(), Self::MotorBox),
    ];

    /// Returns the names of the algorithms of the standard program: laws of the controller, methods of the estimator.
    #[must_use]
    pub fn algorithms(self) -> &'static [&'static str] {
        match self {
            Self::Controller => ControlLaw::NAMES,
            Self::Estimator => EstimatorMethod::NAMES,
            _ => &[],
        }
    }

    /// Returns whether the role has two slots, so that a process can be swapped for another while both run.
    #[must_use]
    pub fn has_slots(self) -> bool {
        matches!(self, Self::Controller | Self::Estimator)
    }

    /// Returns the name of the standard process in a slot.
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
