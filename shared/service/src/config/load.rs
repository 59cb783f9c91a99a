//! Reading the configuration files: the text, then what the values mean together.

use super::{BoxFile, ControllerSection, MotorSection, RobotFile, check};
use crate::toml_file::{self, ConfigError};
use cable_robot::{Distribution, Robot, RobotParts, motor::Motor};
use std::path::{Path, PathBuf};

impl RobotFile {
    /// Reads and checks a robot file.
    ///
    /// # Errors
    /// One sentence that names the file, the key and what is accepted.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let file: Self = toml_file::load(path)?;
        check::robot(&file).map_err(|problem| ConfigError::value(path, problem))?;
        Robot::new(file.parts()).map_err(|error| ConfigError::value(path, error.to_string()))?;
        Ok(file)
    }

    /// The robot for the mathematics.
    ///
    /// # Errors
    /// What [`Robot::new`] refuses; a file that [`RobotFile::load`] accepted is never refused.
    pub fn robot(&self) -> Result<Robot, cable_robot::RobotError> {
        Robot::new(self.parts())
    }

    /// Largest velocity of a cable, m/s: twice the node's unless the file says otherwise.
    #[must_use]
    pub fn cable_speed_limit_m_s(&self) -> f64 {
        self.robot.cable_speed_limit_m_s.unwrap_or(2.0 * self.robot.speed_limit_m_s)
    }

    fn parts(&self) -> RobotParts {
        let cables = self.robot.anchors_m.len();
        RobotParts {
            anchors_m: self.robot.anchors_m.clone(),
            node_mass_kg: self.robot.node_mass_kg,
            net_weight_n: self.robot.net_weight_n,
            tension_limits_n: self.robot.tension_limits_n,
            speed_limit_m_s: self.robot.speed_limit_m_s,
            acceleration_limit_m_s2: self.robot.acceleration_limit_m_s2,
            ground_m: self.robot.ground_m,
            keep_out_m: self.robot.keep_out.clone(),
            stiffness_n: self.lines.stiffness_n,
            routed_length_m: (!self.lines.routed_length_m.is_empty()).then(|| self.lines.routed_length_m.clone()),
            length_limits_m: Some(vec![self.robot.length_limits_m; cables]),
            motor: self.motor.motor(),
        }
    }
}

impl MotorSection {
    /// The motor for the mathematics.
    #[must_use]
    pub fn motor(&self) -> Motor {
        Motor {
            force_constant_n_a: self.force_constant_n_a,
            resistance_ohm: self.resistance_ohm,
            gear_friction: self.gear_friction,
            coulomb_n: self.coulomb_n,
            viscous_n_s_m: self.viscous_n_s_m,
            transition_m_s: self.transition_m_s,
        }
    }
}

impl ControllerSection {
    /// How the tensions of a robot with this many cables are chosen; three cables leave no choice.
    #[must_use]
    pub fn distribution_for(&self, cables: usize) -> Distribution {
        match (cables, self.distribution.as_str()) {
            (0..=3, _) => Distribution::Unique,
            (_, "min-sum") => Distribution::MinSum,
            (_, "safest") => Distribution::Safest,
            _ => Distribution::LeastNorm,
        }
    }
}

impl BoxFile {
    /// Reads and checks a box file and the robot file it names. The paths `robot`, `runs` and `planner.missions` of the result no
    /// longer depend on the folder of the file.
    ///
    /// # Errors
    /// One sentence that names the file, the key and what is accepted.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let mut file: Self = toml_file::load(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        for inner in [&mut file.robot, &mut file.runs, &mut file.planner.missions] {
            *inner = beside(folder, inner);
        }
        if !file.robot.is_file() {
            let problem = format!("`robot` names {}, and there is no such file", file.robot.display());
            return Err(ConfigError::value(path, problem));
        }
        let robot = RobotFile::load(&file.robot)?;
        check::box_file(&file, &robot).map_err(|problem| ConfigError::value(path, problem))?;
        Ok(file)
    }

    /// The robot file that this box names.
    ///
    /// # Errors
    /// As [`RobotFile::load`].
    pub fn robot_file(&self) -> Result<RobotFile, ConfigError> {
        RobotFile::load(&self.robot)
    }

    /// One control cycle, s.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        1.0 / self.rate_hz
    }
}

/// `inner` seen from `folder`, without `x/..`.
fn beside(folder: &Path, inner: &Path) -> PathBuf {
    use std::path::Component::{CurDir, Normal, ParentDir};
    let mut result = PathBuf::new();
    for part in folder.join(inner).components() {
        match part {
            CurDir => {}
            ParentDir if matches!(result.components().next_back(), Some(Normal(_))) => {
                result.pop();
            }
            other => result.push(other),
        }
    }
    result
}
