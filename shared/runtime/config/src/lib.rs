//! The configuration files: the robot file (geometry, limits, cables, motors) and the system file (processes, drives,
//! parameters).
//!
//! The fields document every key with its unit and default; `configs/` holds complete, commented examples. Unknown keys
//! are errors.

#![forbid(unsafe_code)]

mod check;
mod choice;
mod drive_family;
mod exactly;
pub mod file;
mod load;
mod logger;
mod measured;
mod mission_copy;
mod motor_box;
mod number;
mod point;
mod problem;
mod process_for;
mod robot_file;
mod slot;
mod system_file;
pub mod toml_file;
mod tuning;
mod viewer;

pub use choice::{
    Algorithm, ControlLaw, DriveProtocol, EstimatorMethod, PulleyKind, StopPin, TensionDistribution, UnknownChoice,
};
pub use drive_family::DriveFamily;
pub use exactly::{each_exactly, each_exactly_if_given, exactly, exactly_if_given, table_if_given};
pub use logger::{LoggedSensorSection, SensorLoggerSection};
pub use measured::{CalibrationFile, MOTOR_BOX, MotorTableFile, RESOLVED};
pub use mission_copy::{INBOX, MissionCopyError, mission_copy, mission_hash, read_mission, store_mission};
pub use motor_box::MotorBoxTable;
pub use number::{Given, number};
pub use point::{Point, Points};
pub use problem::Problem;
pub use robot_file::{
    CountsStretched, LinesSection, MotorSection, ObstacleSection, RobotFile, RobotSection, SiteSection,
};

pub use slot::{slot_argument, slot_role_argument};
pub use system_file::{
    ArbiterSection, ControllerSection, EstimatorSection, MotorIoSection, PlannerSection, PortSection, ProcessSection,
    RealtimeSection, RecorderSection, Role, SystemFile, UnitSection,
};
pub use toml_file::ConfigError;
pub use tuning::{TUNABLE, Tunable, Tuned};
pub use viewer::ViewerSection;
