//! Loading of configuration files: parses the text, then checks the values together.

use super::measured::resolve_named_file;
use super::{
    CalibrationFile, DrumEncoder, IdentifiedFile, MotorBoxTable, MotorSection, MotorTableFile, Point, RobotFile,
    RobotSection, SystemFile, check,
};
use crate::Problem;
use crate::file::join_normalized;
use crate::file_kind::FileKind;
use crate::system_file::default_runs;
use crate::toml_file::{ConfigError, Source};
use cable_robot::motor::{DriveLimits, Motor};
use cable_robot::{DrumParts, Obstacle, Robot, RobotError, RobotParts};
use std::path::{Path, PathBuf};

/// Share of the supply voltage that does not reach the motor, or that the drive's speed loop needs to correct: a bridge
/// of transistors and its wiring lose some tenths of a volt, and at full duty a loop cannot correct.
const DRIVE_RESERVE: f64 = 0.05;

impl RobotFile {
    /// Reads and checks a robot file and the measured files that it names.
    ///
    /// # Errors
    /// A file is not accepted: one sentence with the file, the key and what is accepted.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let source = Source::read(path)?;
        FileKind::Robot.expect(&source)?;
        let mut file: Self = source.parse()?;
        file.measured(path, &source)?;
        check::robot(&file).map_err(|problem| source.error(&problem))?;
        let robot = file.robot().map_err(|error| source.error(&robot_problem(&error)))?;
        if robot.anchors().are_on_a_line() {
            let clause = "lie on one straight line, so cable lengths determine no position; move an anchor sideways, or give all \
                          points as [x, z] for a planar robot";
            return Err(source.error(&Problem::with_clause("robot.anchors_m", clause)));
        }
        Ok(file)
    }

    /// Reads the calibration and the motor table, if the file at `path` names them.
    fn measured(&mut self, path: &Path, source: &Source) -> Result<(), ConfigError> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let refuse = |key: &str, sentence: &str| Err(source.error(&Problem::with_sentence(key, sentence)));
        match (&self.robot.calibration, self.robot.anchors_m.is_empty()) {
            (Some(_), false) => {
                return refuse(
                    "robot.calibration",
                    "`robot.calibration` and `anchors_m` both give the anchors; remove one of them",
                );
            }
            (None, true) => {
                return refuse(
                    "robot",
                    "`robot` has no anchors; give `anchors_m`, or `calibration` with a file from nims calibrate --out",
                );
            }
            (None, false) => {}
            (Some(named), true) => {
                let calibration = CalibrationFile::load(&resolve_named_file(folder, named))?;
                self.robot.anchors_m = calibration.anchors_m.clone().into();
                let pulleys = calibration.pulleys(self.robot.pulley, &self.robot.pulley_radius_m);
                (self.robot.pulley, self.robot.pulley_radius_m) = pulleys.map_err(|problem| source.error(&problem))?;
                self.calibration = Some(calibration);
            }
        }
        // A run keeps the files side by side.
        let tables = self.motor.table.paths();
        let twice = |(i, path): (usize, &PathBuf)| {
            tables[..i].iter().any(|before| before != path && before.file_name() == path.file_name())
        };
        if tables.iter().enumerate().any(twice) {
            return refuse(
                "motor.table",
                "`table` names two files of the same name; give each motor's file its own name",
            );
        }
        let load = |named: &PathBuf| MotorTableFile::load(&resolve_named_file(folder, named));
        self.motor_tables = tables.iter().map(load).collect::<Result<_, _>>()?;
        self.use_identified(folder, source)
    }

    /// Reads the file of `nims identify`, if this file names one, and puts its values into the sections.
    fn use_identified(&mut self, folder: &Path, source: &Source) -> Result<(), ConfigError> {
        let Some(named) = self.robot.identified.clone() else { return Ok(()) };
        let mut others = self.robot.calibration.iter().chain(self.motor.table.paths());
        if others.any(|other| other.file_name() == named.file_name()) {
            let sentence = "`identified` and another key name files of the same name; give each its own name, because a \
                            run keeps them side by side";
            return Err(source.error(&Problem::with_sentence("robot.identified", sentence)));
        }
        // What the robot file states is checked too: it is shown beside what replaces it.
        check::robot(self).map_err(|problem| source.error(&problem))?;
        let path = resolve_named_file(folder, &named);
        let file = IdentifiedFile::load(&path)?;
        self.replaced = file.apply(self, &source.parse()?).map_err(|problem| match Source::read(&path) {
            Ok(identified) => identified.error(&problem),
            Err(error) => error,
        })?;
        self.identified = Some(file);
        Ok(())
    }

    /// Returns each key that names files, with their paths as this file has them. A new such key belongs here: runs
    /// keep these files, and the gateway lets no text name others.
    #[must_use]
    pub fn names_of_files(&self) -> [(&'static str, Vec<&Path>); 3] {
        [
            ("robot.calibration", self.robot.calibration.iter().map(PathBuf::as_path).collect()),
            ("motor.table", self.motor.table.paths().iter().map(PathBuf::as_path).collect()),
            ("robot.identified", self.robot.identified.iter().map(PathBuf::as_path).collect()),
        ]
    }

    /// Returns the paths of the files that this file, in `folder`, names.
    #[must_use]
    pub fn named_files(&self, folder: &Path) -> Vec<PathBuf> {
        let named = self.names_of_files().into_iter().flat_map(|(_, paths)| paths);
        named.map(|named| resolve_named_file(folder, named)).collect()
    }

    /// Creates the robot model.
    ///
    /// # Errors
    /// As [`Robot::new`]; a file that [`RobotFile::load`] accepted causes none.
    pub fn robot(&self) -> Result<Robot, RobotError> {
        Robot::new(self.parts()?)
    }

    /// Returns the largest velocity of a cable, m/s; default: twice the speed limit of the node.
    #[must_use]
    pub fn cable_speed_limit_m_s(&self) -> f64 {
        self.robot.cable_speed_limit_m_s.unwrap_or(2.0 * self.robot.speed_limit_m_s)
    }

    fn obstacles(&self) -> Result<Vec<Obstacle>, RobotError> {
        let numbered =
            |i, error: RobotError| RobotError { problem: format!("number {} {}", i + 1, error.problem), ..error };
        let obstacles = self.obstacle.iter().enumerate();
        obstacles.map(|(i, section)| section.obstacle().map_err(|error| numbered(i, error))).collect()
    }

    /// Returns the description of the robot model.
    ///
    /// # Errors
    /// As [`RobotFile::robot`].
    pub fn parts(&self) -> Result<RobotParts, RobotError> {
        let cables = self.robot.anchors_m.len();
        Ok(RobotParts {
            anchors_m: self.robot.anchors_m.to_vec(),
            planar: self.robot.anchors_m.is_planar(),
            pulley: self.robot.pulley.unwrap_or_default().into(),
            pulley_radius_m: (!self.robot.pulley_radius_m.is_empty()).then(|| self.robot.pulley_radius_m.clone()),
            node_mass_kg: self.robot.node_mass_kg,
            net_weight_n: self.robot.net_weight_n,
            drag_n_s2_m2: self.robot.drag_n_s2_m2,
            tension_limits_n: self.robot.tension_limits_n,
            speed_limit_m_s: self.robot.speed_limit_m_s,
            cable_speed_limit_m_s: self.robot.cable_speed_limit_m_s,
            acceleration_limit_m_s2: self.robot.acceleration_limit_m_s2,
            ground_m: self.robot.ground_m,
            keep_out_m: self.robot.keep_out.iter().map(|corners| self.robot.keep_out_box(corners)).collect(),
            obstacles: self.obstacles()?,
            clearance_m: self.robot.clearance_m,
            stiffness_n: self.lines.stiffness_n,
            cable_mass_kg_m: self.lines.mass_kg_m,
            counts_stretched: Some(self.lines.counts_stretched.list(cables)),
            routed_length_m: (!self.lines.routed_length_m.is_empty()).then(|| self.lines.routed_length_m.clone()),
            drum: self.drum.as_ref().map(|drum| DrumParts {
                diameter_m: drum.diameter_m,
                cable_diameter_m: drum.cable_diameter_m,
                turns_per_layer: drum.turns_per_layer,
                cable_m: drum.cable_m.clone(),
                counted: drum.encoder == DrumEncoder::First,
            }),
            length_limits_m: Some(vec![self.robot.length_limits_m; cables]),
            motor: self.motor.motor(),
            motor_tables: self
                .motor_tables
                .iter()
                .filter_map(|file| file.table(self.motor.resistance_ohm).ok())
                .collect(),
            drive_limits: DriveLimits {
                current_a: self.motor.current_limit_a,
                voltage_v: self.supply_min_v.map_or(f64::INFINITY, |supply_v| supply_v * (1.0 - DRIVE_RESERVE)),
            },
            anchor_covariance_m2: self.calibration.as_ref().map(|file| file.covariance_m2.clone()),
            length_covariance: (self.calibration.as_ref())
                .and_then(|file| (!file.length_covariance.is_empty()).then(|| file.length_covariance.clone())),
            // The covariance of a calibration contains the pulleys that it could not exclude.
            uncertainty: self.uncertainty.uncertainty(self.robot.pulley.is_some() || self.calibration.is_some()),
        })
    }
}

/// Converts an error of the robot model to a problem at the key of the file that it is about.
fn robot_problem(error: &RobotError) -> Problem {
    let table = match error.key {
        "stiffness_n" | "routed_length_m" | "mass_kg_m" | "counts_stretched" => "lines",
        "diameter_m" | "cable_diameter_m" | "turns_per_layer" | "cable_m" => "drum",
        "force_constant_n_a" | "resistance_ohm" | "gear_friction" | "coulomb_n" | "viscous_n_s_m"
        | "transition_m_s" | "table" => "motor",
        "obstacle" => return Problem::with_sentence("obstacle", error.to_string()),
        "uncertainty" => return Problem::with_sentence("uncertainty", error.to_string()),
        "covariance_m2" | "length_covariance" => return Problem::with_sentence("robot.calibration", error.to_string()),
        _ => "robot",
    };
    Problem::with_sentence(format!("{table}.{}", error.key), error.to_string())
}

impl RobotSection {
    /// Returns a box of `keep_out`; for a planar robot it extends 1 m to both sides of the plane.
    fn keep_out_box(&self, [low, high]: &[Point; 2]) -> [[f64; 3]; 2] {
        let (mut low, mut high) = (low.position_m, high.position_m);
        if self.anchors_m.is_planar() {
            (low[1], high[1]) = (-1.0, 1.0);
        }
        [low, high]
    }
}

impl MotorSection {
    /// Creates the motor model.
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

/// The example files of an installation; in them, `systems`, `robots` and others.
pub const EXAMPLES: &str = "/usr/share/nims";

/// The system files of the services of this machine: `nims@NAME` runs NAME.toml.
pub const OF_SERVICES: &str = "/etc/nims/systems";

/// Services beside each robot: `nims-gateway@NAME`. The folder of a robot `gateway` in `/run` would be that of all
/// gateways. `nims@.service` asserts the same.
const BESIDE_ROBOTS: [&str; 4] = ["gateway", "page", "plugin", "plugin-network"];

/// Returns the name that the system file of a service must have, by its path; `None`: no service runs this file.
fn name_of_service(path: &Path) -> Option<String> {
    let path = std::path::absolute(path).ok()?;
    let name = path.file_stem().filter(|_| path.parent() == Some(Path::new(OF_SERVICES)))?;
    Some(name.to_string_lossy().into_owned())
}

/// Checks that the system file of a service has its name. Socket, tokens and stored position have the name in the file,
/// so a copy that kept it would share them with its original.
fn check_name_of_service(path: &Path, name: &str) -> Result<(), Problem> {
    match name_of_service(path) {
        Some(service) if BESIDE_ROBOTS.contains(&service.as_str()) => Err(Problem::with_clause(
            "name",
            format!(
                "is that of a service beside each robot, nims-{service}@; accepted: any but {}",
                BESIDE_ROBOTS.join(", ")
            ),
        )),
        Some(service) if service != name => Err(Problem::with_clause(
            "name",
            format!(
                "is \"{name}\", and the file is that of nims@{service}; write \"{service}\", or name the file {name}.toml"
            ),
        )),
        _ => Ok(()),
    }
}

/// Returns whether a system file of this folder is an example of an installation. It is flown where it is, so its runs
/// go below the current folder: users cannot write beside it.
fn is_installed_example(folder: &Path) -> bool {
    std::path::absolute(folder).is_ok_and(|folder| folder.starts_with(EXAMPLES))
}

impl SystemFile {
    /// Returns the default folder for the position that motor-io stores across restarts: next to the runs folder.
    #[must_use]
    pub fn state_folder(&self) -> PathBuf {
        self.runs.parent().unwrap_or(Path::new(".")).join("state")
    }

    /// Returns the name under which the state of this robot is stored. A real robot has one state; a virtual robot has
    /// one per domain.
    #[must_use]
    pub fn state_name(&self, domain: &str) -> String {
        if self.motor_box.is_none() {
            return self.name.clone();
        }
        let domain: String = domain.chars().map(|c| if c.is_alphanumeric() { c } else { '-' }).collect();
        format!("{}-{domain}", self.name)
    }

    /// Reads and checks a system file and the robot file that it names. The paths `robot`, `runs` and
    /// `planner.missions` of the result are no longer relative to the folder of the file. An example of an installation
    /// that states no `runs` has them in `nims/runs` of the current folder.
    ///
    /// # Errors
    /// A file is not accepted: one sentence with the file, the key and what is accepted.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        Self::load_with(path, None)
    }

    /// As [`SystemFile::load`], with another robot file than the one that it names; its path is not relative to the
    /// folder of the system file.
    ///
    /// # Errors
    /// As [`SystemFile::load`].
    pub fn load_with(path: &Path, robot: Option<&Path>) -> Result<Self, ConfigError> {
        let source = Source::read(path)?;
        FileKind::System.expect(&source)?;
        let mut file: Self = source.parse()?;
        let refuse = |problem: Problem| source.error(&problem);
        check_name_of_service(path, &file.name).map_err(refuse)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        if file.runs == default_runs() && is_installed_example(folder) {
            file.runs = std::env::current_dir().unwrap_or_default().join("nims/runs");
        }
        for inner in [&mut file.robot, &mut file.runs, &mut file.planner.missions] {
            *inner = join_normalized(folder, inner);
        }
        if let Some(robot) = robot {
            robot.clone_into(&mut file.robot);
        }
        if let Some(table) = &mut file.motor_box {
            table.set_source(&source);
        }
        if !file.robot.is_file() {
            let clause = format!("is {}; there is no such file", file.robot.display());
            return Err(refuse(Problem::with_clause("robot", clause)));
        }
        let robot = RobotFile::load(&file.robot)?;
        check::system_file(&file, &robot).map_err(refuse)?;
        file.identified(&source, &robot)?;
        let counts = robot.calibration.as_ref().map(|calibration| calibration.encoders(&file.motor_io.counts_per_m));
        if let Some(counts) = counts.transpose().map_err(refuse)?.flatten() {
            file.motor_io.counts_per_m = counts;
        }
        Ok(file)
    }

    /// Returns this configuration without the content of `[motor_box]`, for every process except the virtual motor
    /// box. The empty table still states that the drives are virtual.
    #[must_use]
    pub fn without_truth(&self) -> Self {
        Self { motor_box: self.motor_box.as_ref().map(|_| MotorBoxTable::default()), ..self.clone() }
    }

    /// Returns the text of a system file with every key, including defaults except those of `[motor_box]`; `robot` is
    /// the path of its robot file relative to the new file. [`SystemFile::load`] reads it back.
    ///
    /// # Errors
    /// A value that TOML cannot represent; no loaded file has one.
    pub fn resolved(&self, robot: &str) -> Result<String, String> {
        let mut file = Self { robot: robot.into(), ..self.clone() };
        // The ground file is copied next to the new file, like the robot file.
        file.motor_box = file.motor_box.map(|table| table.with_ground("ground.toml"));
        toml::to_string(&file).map_err(|error| error.to_string())
    }

    /// Reads the robot file that this file names.
    ///
    /// # Errors
    /// As [`RobotFile::load`].
    pub fn robot_file(&self) -> Result<RobotFile, ConfigError> {
        // 0: the supply is not monitored.
        let supply_min_v = Some(self.motor_io.supply_min_v).filter(|supply_v| *supply_v > 0.0);
        RobotFile::load(&self.robot).map(|robot| RobotFile { supply_min_v, ..robot })
    }

    /// Returns the period of a control cycle, s.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        1.0 / self.rate_hz
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_examples_of_an_installation_keep_their_runs_in_the_current_folder() {
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/systems");
        assert!(is_installed_example(Path::new("/usr/share/nims/systems")));
        for other in ["", "systems", "/etc/nims/systems", "/usr/share/nims-other/systems"].map(Path::new) {
            assert!(!is_installed_example(other), "{}", other.display());
        }
        let file = SystemFile::load(&configs.join("demo3.toml")).unwrap();
        assert_eq!(file.runs, join_normalized(&configs, Path::new("../../runs")));
    }

    #[test]
    fn the_system_file_of_a_service_has_its_name() {
        let check = |path: &str, name: &str| check_name_of_service(Path::new(path), name);
        for (path, name) in [
            ("/etc/nims/systems/lab.toml", "lab"),
            // not of a service: an example, a copy in a run, a file of a user
            ("/usr/share/nims/systems/lab.toml", "demo3"),
            ("/var/lib/nims/runs/2026-01-01T00-00-00Z-lab/resolved.toml", "lab"),
            ("/etc/nims/systems/old/lab.toml", "demo3"),
            ("lab.toml", "demo3"),
        ] {
            assert_eq!(check(path, name), Ok(()), "{path}");
        }
        let refused = check("/etc/nims/systems/lab.toml", "demo3").unwrap_err();
        assert_eq!(refused.key(), "name");
        for word in ["\"demo3\"", "nims@lab", "\"lab\"", "demo3.toml"] {
            assert!(refused.to_string().contains(word), "{refused}");
        }
        // It would have the folder of all gateways.
        let refused = check("/etc/nims/systems/gateway.toml", "gateway").unwrap_err();
        assert!(refused.key() == "name" && refused.to_string().contains("nims-gateway@"), "{refused}");
        assert_eq!(check("gateway.toml", "gateway"), Ok(()), "without a service");
    }

    #[test]
    fn a_resolved_system_file_has_every_key_and_the_same_values() {
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
