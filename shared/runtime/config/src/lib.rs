//! The configuration files: the robot file (geometry, limits, cables, motors) and the system file (processes, drives,
//! parameters).
//!
//! The fields document every key with its unit and default; `configs/` holds complete, commented examples. Unknown keys
//! are errors.

#![forbid(unsafe_code)]

mod arbiter;
mod bus;
mod check;
mod choice;
mod controller;
mod drive_family;
mod estimator;
mod exactly;
pub mod file;
mod file_kind;
mod gateway;
mod identified;
mod load;
mod logger;
mod measured;
mod mission_copy;
mod motor_box;
mod motor_io;
mod names;
mod number;
mod obstacle;
mod planner;
mod plugin;
mod point;
mod ports;
mod precedence;
mod problem;
mod process;
mod process_for;
mod realtime;
mod recorder;
mod robot_file;
pub mod section;
mod slot;
mod started;
mod system_file;
pub mod toml_file;
mod tuning;
mod uncertainty;
mod viewer;

pub use arbiter::ArbiterSection;
pub use bus::{BusSection, Excess};
pub use choice::UnknownChoice;
pub use controller::{ControlLaw, ControllerSection, TensionDistribution};
pub use drive_family::{DriveFamily, DriveProtocol, Remedies, Wire};
pub use estimator::{EstimatorMethod, EstimatorSection};
pub use exactly::{each_exactly, each_exactly_if_given, exactly, exactly_if_given, table_if_given};
pub use file_kind::FileKind;
pub use gateway::GatewaySection;
pub use identified::{IdentifiedCable, IdentifiedFile, IdentifiedMotor, Replaced};
pub use load::{EXAMPLES, OF_SERVICES};
pub use logger::{LoggedSensorSection, SensorLoggerSection};
pub use measured::{CalibrationFile, MOTOR_BOX, MotorTableFile, RESOLVED};
pub use mission_copy::{
    INBOX, INBOX_BYTES, INBOX_FILES, MissionCopyError, mission_copy, mission_hash, read_mission, store_mission,
};
pub use motor_box::MotorBoxTable;
pub use motor_io::MotorIoSection;
pub use number::{Given, number};
pub use obstacle::ObstacleSection;
pub use planner::PlannerSection;
pub use plugin::PluginSection;
pub use point::{Point, Points};
pub use ports::{PortSection, StopPin, UnitSection};
pub use problem::Problem;
pub use process::{Algorithm, ProcessSection, Role};
pub use process_for::UnknownAlgorithm;
pub use realtime::RealtimeSection;
pub use recorder::RecorderSection;
pub use robot_file::{
    CountsStretched, DrumEncoder, DrumSection, LinesSection, MotorSection, PulleyKind, RobotFile, RobotSection,
    SiteSection, TablePaths,
};
pub use slot::{slot_argument, slot_role_argument};
pub use started::StartedProcess;
pub use system_file::SystemFile;
pub use toml_file::ConfigError;
pub use tuning::{Tunable, Tuned, tunable};
pub use uncertainty::UncertaintySection;
pub use viewer::ViewerSection;
