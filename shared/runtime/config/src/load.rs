//! Reading the configuration files: the text, then what the values mean together.

use super::measured::found;
use super::{
    CalibrationFile, ControllerSection, MotorSection, MotorTableFile, Point, RobotFile, RobotSection, SystemFile,
    check, devices,
};
use crate::file::beside;
use crate::toml_file::{ConfigError, Source};
use crate::{Problem, TensionDistribution};
use cable_robot::motor::Motor;
use cable_robot::{Distribution, Robot, RobotError, RobotParts};
use std::path::{Path, PathBuf};

impl RobotFile {
    /// Reads and checks a robot file and the measured files that it names.
    ///
    /// # Errors
    /// One sentence that names the file, the key and what is accepted.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let source = Source::read(path)?;
        let mut file: Self = source.parse()?;
        file.measured(path, &source)?;
        check::robot(&file).map_err(|problem| source.error(&problem))?;
        let robot = Robot::new(file.parts()).map_err(|error| source.error(&of_robot(&error)))?;
        if robot.anchors().are_on_a_line() {
            let clause = "lie on one straight line, so lengths determine no position; move an anchor sideways, or give all points \
                          as [x, z] for a robot that moves in a plane";
            return Err(source.error(&Problem::of("robot.anchors_m", clause)));
        }
        Ok(file)
    }

    /// Reads the calibration and the motor table, if the file at `path` names them.
    fn measured(&mut self, path: &Path, source: &Source) -> Result<(), ConfigError> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let refuse = |key: &str, sentence: &str| Err(source.error(&Problem::at(key, sentence)));
        match (&self.robot.calibration, self.robot.anchors_m.is_empty()) {
            (Some(_), false) => {
                return refuse(
                    "robot.calibration",
                    "`robot.calibration` and `anchors_m` both say where the anchors are; keep the calibration, or remove it",
                );
            }
            (None, true) => {
                return refuse(
                    "robot",
                    "`robot` says nowhere where the anchors are; give `anchors_m`, or `calibration` with a file of nims calibrate --out",
                );
            }
            (None, false) => {}
            (Some(named), true) => {
                let calibration = CalibrationFile::load(&found(folder, named))?;
                self.robot.anchors_m = calibration.anchors_m.clone().into();
                self.calibration = Some(calibration);
            }
        }
        if let Some(named) = &self.motor.table {
            self.motor_table = Some(MotorTableFile::load(&found(folder, named))?);
        }
        Ok(())
    }

    /// The files that this one, in `folder`, names.
    #[must_use]
    pub fn named_files(&self, folder: &Path) -> Vec<PathBuf> {
        [&self.robot.calibration, &self.motor.table].into_iter().flatten().map(|named| found(folder, named)).collect()
    }

    /// The robot for the mathematics.
    ///
    /// # Errors
    /// What [`Robot::new`] refuses; a file that [`RobotFile::load`] accepted is never refused.
    pub fn robot(&self) -> Result<Robot, RobotError> {
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
            anchors_m: self.robot.anchors_m.to_vec(),
            planar: self.robot.anchors_m.is_planar(),
            node_mass_kg: self.robot.node_mass_kg,
            net_weight_n: self.robot.net_weight_n,
            drag_n_s2_m2: self.robot.drag_n_s2_m2,
            tension_limits_n: self.robot.tension_limits_n,
            speed_limit_m_s: self.robot.speed_limit_m_s,
            cable_speed_limit_m_s: self.robot.cable_speed_limit_m_s,
            acceleration_limit_m_s2: self.robot.acceleration_limit_m_s2,
            ground_m: self.robot.ground_m,
            keep_out_m: self.robot.keep_out.iter().map(|corners| self.robot.room(corners)).collect(),
            stiffness_n: self.lines.stiffness_n,
            routed_length_m: (!self.lines.routed_length_m.is_empty()).then(|| self.lines.routed_length_m.clone()),
            length_limits_m: Some(vec![self.robot.length_limits_m; cables]),
            motor: self.motor.motor(),
            motor_table: self.motor_table.as_ref().and_then(|file| file.table(self.motor.resistance_ohm).ok()),
            anchor_covariance_m2: self.calibration.as_ref().map(|file| file.covariance_m2.clone()),
        }
    }
}

/// What the mathematics refuses, at the key of the file that it is about.
fn of_robot(error: &RobotError) -> Problem {
    let table = match error.key {
        "stiffness_n" | "routed_length_m" => "lines",
        "force_constant_n_a" | "resistance_ohm" | "gear_friction" | "coulomb_n" | "viscous_n_s_m"
        | "transition_m_s" | "table" => "motor",
        "covariance_m2" => return Problem::at("robot.calibration", error.to_string()),
        _ => "robot",
    };
    Problem::at(format!("{table}.{}", error.key), error.to_string())
}

impl RobotSection {
    /// A box of `keep_out`; of a planar robot it reaches as far as need be on both sides of the plane.
    fn room(&self, [low, high]: &[Point; 2]) -> [[f64; 3]; 2] {
        let (mut low, mut high) = (low.position_m, high.position_m);
        if self.anchors_m.is_planar() {
            (low[1], high[1]) = (-1.0, 1.0);
        }
        [low, high]
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
    /// How the tensions of this robot are chosen; as many cables as directions leave no choice.
    #[must_use]
    pub fn distribution_for(&self, robot: &Robot) -> Distribution {
        match (robot.redundancy(), self.distribution) {
            (0, _) => Distribution::Unique,
            (_, TensionDistribution::LeastNorm) => Distribution::LeastNorm,
            (_, TensionDistribution::MinSum) => Distribution::MinSum,
            (_, TensionDistribution::Safest) => Distribution::Safest,
        }
    }
}

impl SystemFile {
    /// Where the position is kept over restarts, unless motor-io is told another folder: beside that of the runs.
    #[must_use]
    pub fn state_folder(&self) -> PathBuf {
        self.runs.parent().unwrap_or(Path::new(".")).join("state")
    }

    /// What the state of this robot is kept under: a real box is one robot, whoever runs it; a virtual one hangs in its domain, and
    /// another domain's is another robot.
    #[must_use]
    pub fn state_name(&self, domain: &str) -> String {
        if self.motor_box.is_none() {
            return self.name.clone();
        }
        let domain: String = domain.chars().map(|c| if c.is_alphanumeric() { c } else { '-' }).collect();
        format!("{}-{domain}", self.name)
    }

    /// Reads and checks a system file and the robot file it names. The paths `robot`, `runs` and `planner.missions` of the result no
    /// longer depend on the folder of the file.
    ///
    /// # Errors
    /// One sentence that names the file, the key and what is accepted.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let source = Source::read(path)?;
        let mut file: Self = source.parse()?;
        let refuse = |problem: Problem| source.error(&problem);
        let folder = path.parent().unwrap_or(Path::new(""));
        for inner in [&mut file.robot, &mut file.runs, &mut file.planner.missions] {
            *inner = beside(folder, inner);
        }
        if let Some(section) = &mut file.motor_box {
            let ports: Vec<String> = file.motor_io.ports.iter().map(|port| port.path.clone()).collect();
            devices::check(&section.device, &mut section.ground, folder, &ports).map_err(refuse)?;
        }
        if !file.robot.is_file() {
            let clause = format!("names {}, and there is no such file", file.robot.display());
            return Err(refuse(Problem::of("robot", clause)));
        }
        let robot = RobotFile::load(&file.robot)?;
        check::system_file(&file, &robot).map_err(refuse)?;
        let counts = robot.calibration.as_ref().map(|found| found.encoders(&file.motor_io.counts_per_m)).transpose();
        if let Some(counts) = counts.map_err(refuse)?.flatten() {
            file.motor_io.counts_per_m = counts;
        }
        Ok(file)
    }

    /// The box as a file with every key, those that were not written at their defaults; `robot` is where its robot file will be found
    /// from there. [`SystemFile::load`] reads it back.
    ///
    /// # Errors
    /// A value that TOML cannot hold; no file that was loaded has one.
    pub fn resolved(&self, robot: &str) -> Result<String, String> {
        let mut file = Self { robot: robot.into(), ..self.clone() };
        // Beside it as well, as the robot file is.
        if let Some(ground) = file.motor_box.as_mut().and_then(|section| section.ground.as_mut()) {
            *ground = "ground.toml".into();
        }
        toml::to_string(&file).map_err(|error| error.to_string())
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_resolved_box_file_says_the_same_with_every_key() {
        let boxes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/systems");
        for entry in std::fs::read_dir(&boxes).unwrap() {
            let path = entry.unwrap().path();
            let file = SystemFile::load(&path).unwrap();
            let folder = tempfile::tempdir().unwrap();
            std::fs::copy(&file.robot, folder.path().join("robot.toml")).unwrap();
            let resolved = folder.path().join("resolved.toml");
            std::fs::write(&resolved, file.resolved("robot.toml").unwrap()).unwrap();
            let again = SystemFile::load(&resolved).unwrap();
            assert_eq!(again.robot, folder.path().join("robot.toml"));
            let mut again = again;
            again.robot.clone_from(&file.robot);
            assert_eq!(format!("{again:?}"), format!("{file:?}"), "{}", path.display());
            let text = std::fs::read_to_string(&resolved).unwrap();
            assert!(text.contains("segment_s = 900.0") && text.contains("horizon_cycles"), "{text}");
        }
    }
}
