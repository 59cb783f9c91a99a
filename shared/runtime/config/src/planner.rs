//! `[planner]`: missions and their checks.

use crate::number::number;
use crate::problem::Problem;
use crate::robot_file::RobotSection;
use crate::section::between;
use std::path::PathBuf;

crate::section! {
    /// `[planner]`.
    pub struct PlannerSection {
        /// Cruise speed of missions that set none, m/s.
        pub speed_m_s: f64 = 0.2,
        /// Tangential acceleration, m/s².
        pub acceleration_m_s2: f64 = 0.3,
        /// Distance between the points of a path that are checked against (16), m.
        pub check_step_m: f64 = 0.02 => between(0.001, 0.5, "m"),
        /// Swing of the node on its cables above which a move is shaped, m.
        pub swing_limit_m: f64 = 0.005 => between(1e-4, 1.0, "m"),
        /// Folder of the missions that `nims run NAME` flies by name.
        pub missions: PathBuf = "../missions".into(),
        /// The mission that `nims demo` flies.
        pub demo: PathBuf = "demo".into(),
    }
}

impl PlannerSection {
    /// Checks the values against each other and against the robot's limits.
    pub(crate) fn check(&self, robot: &RobotSection) -> Result<(), Problem> {
        self.check_ranges("planner")?;
        let (speed, acceleration) = (robot.speed_limit_m_s, robot.acceleration_limit_m_s2);
        let accepted = format!("above 0, at most the robot's `speed_limit_m_s` of {speed}");
        number("planner.speed_m_s", self.speed_m_s, &accepted, |v| v > 0.0 && v <= speed)?;
        let accepted = format!("above 0, at most the robot's `acceleration_limit_m_s2` of {acceleration}");
        number("planner.acceleration_m_s2", self.acceleration_m_s2, &accepted, |v| v > 0.0 && v <= acceleration)
    }
}
