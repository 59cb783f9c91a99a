//! The system file: processes, drives, control rate and parameters of a robot.

use super::{
    ArbiterSection, BusSection, ControllerSection, EstimatorSection, GatewaySection, MotorBoxTable, MotorIoSection,
    PlannerSection, PluginSection, ProcessSection, RealtimeSection, RecorderSection, SensorLoggerSection,
    ViewerSection,
};
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
    /// Control cycles per second, 10 to 500.
    #[serde(default = "default_rate")]
    pub rate_hz: f64,
    /// Folder in which run folders are created; for an example in /usr/share/nims, by default `nims/runs` of the
    /// current folder.
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
    /// Roles of users who reach the robot through the gateway.
    #[serde(default)]
    pub gateway: GatewaySection,
    /// Storage of sensor readings and live maps.
    #[serde(default)]
    pub sensor_logger: SensorLoggerSection,
    /// The virtual motor box; omit it on real hardware.
    pub motor_box: Option<MotorBoxTable>,
    /// Scheduling of the control chain.
    #[serde(default)]
    pub realtime: RealtimeSection,
    /// Places in shared memory.
    #[serde(default)]
    pub bus: BusSection,
    /// Processes in addition to the standard ones, or replacements of them.
    #[serde(default)]
    pub process: Vec<ProcessSection>,
    /// Sensors that run as another user and publish through the gateway.
    #[serde(default)]
    pub plugin: Vec<PluginSection>,
}

fn default_rate() -> f64 {
    100.0
}

pub(crate) fn default_runs() -> PathBuf {
    "../../runs".into()
}
