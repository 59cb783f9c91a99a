//! The configuration files: the robot (what it is) and the box (which processes, drives and parameters run it).
//!
//! Every key is documented here with its unit and default; `configs/` holds complete, commented examples. Unknown keys are errors.

mod box_file;
mod check;
mod load;
mod robot_file;

pub use box_file::{
    BoxFile, ControllerSection, EstimatorSection, MotorBoxSection, MotorIoSection, PlannerSection, PortSection,
    ProcessSection, RealtimeSection, RecorderSection, Role, UnitSection,
};
pub use robot_file::{LinesSection, MotorSection, RobotFile, RobotSection, SiteSection};
