//! The types of `[motor_box]`: everything that is true and not assumed, and how the virtual drives behave.
//!
//! `config` keeps the table without these types, so no process of the control chain can read it.

mod device;
mod guide;
mod per_cable;
mod truth;

pub use device::{
    CavitySection, CylinderSection, DeviceKind, DeviceSection, FieldSection, GroundFile, PeakSection, PrismSection,
};

pub use guide::TrueGuide;
pub use per_cable::PerCable;
pub use truth::TruthSection;

use config::{ConfigError, Point, Problem, RobotFile, SystemFile, number};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// `[motor_box]`: the virtual motor control box.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct MotorBoxSection {
    /// Position of the node at the start, m; `[x, z]` for a planar robot.
    pub start_m: Point,
    /// Delay between a speed command and the drive's reaction, s.
    pub delay_s: f64,
    /// First-order lag of the drive's speed, s.
    pub lag_s: f64,
    /// True cable stiffness EA, N; independent of the robot file. `truth` may have one per cable.
    pub stiffness_n: f64,
    /// Drag of the node in air or water, N s²/m².
    pub drag_n_s2_m2: f64,
    /// Radius of the empty drum, m.
    pub drum_radius_m: f64,
    /// Cable diameter, m.
    pub line_diameter_m: f64,
    /// Time from the last byte of a question on the wire to the first byte of its answer, of every family, s.
    pub turnaround_s: f64,
    /// Supply voltage, V.
    pub supply_v: f64,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Ground file: the objects on the ground, for rangefinders. Default: none.
    pub ground: Option<PathBuf>,
    /// In what the world differs from the robot file; default: in nothing.
    pub truth: Option<TruthSection>,
    /// Simulated sensors on the node, each with its own port.
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
            truth: None,
            device: Vec::new(),
        }
    }
}

impl MotorBoxSection {
    /// Reads and checks `[motor_box]` of a system file; `None`: the drives are real. The path of the ground file in the
    /// result is not relative to the folder of the system file.
    ///
    /// # Errors
    /// The table is not accepted: one sentence with the file, the line, the key and what is accepted.
    pub fn from_file(file: &SystemFile, robot: &RobotFile) -> Result<Option<Self>, ConfigError> {
        let Some(table) = &file.motor_box else { return Ok(None) };
        let mut section: Self = table.section()?;
        section.take_identified(|key| table.states(key), robot);
        section.ground = section.ground.map(|path| table.path(&path));
        section.check(file, robot).map_err(|problem| table.error(&problem))?;
        Ok(Some(section))
    }

    /// What the table does not state is as the robot file's identified file has it.
    fn take_identified(&mut self, states: impl Fn(&str) -> bool, robot: &RobotFile) {
        let Some(identified) = &robot.identified else { return };
        let values = [
            ("delay_s", identified.delay_s, &mut self.delay_s),
            ("lag_s", identified.lag_s, &mut self.lag_s),
            ("stiffness_n", identified.stiffness_n, &mut self.stiffness_n),
        ];
        for (key, value, into) in values {
            if let Some(value) = value.filter(|_| !states(key)) {
                *into = value;
            }
        }
    }

    fn check(&self, file: &SystemFile, robot: &RobotFile) -> Result<(), Problem> {
        let ports: Vec<String> = file.motor_io.ports.iter().map(|port| port.path.clone()).collect();
        if let Some(ground) = &self.ground {
            let unusable =
                |error: ConfigError| Problem::with_clause("motor_box.ground", format!("is not usable: {error}"));
            GroundFile::load(ground).map_err(unusable)?;
        }
        device::check(&self.device, &ports)?;
        self.check_start(robot)?;
        if let Some(truth) = &self.truth {
            truth.check(robot)?;
            truth.check_counts(&file.motor_io.counts_per_m)?;
        }
        number("motor_box.delay_s", self.delay_s, "0 to 2 s", |v| (0.0..=2.0).contains(&v))?;
        number("motor_box.lag_s", self.lag_s, "0 to 2 s", |v| (0.0..=2.0).contains(&v))?;
        number("motor_box.stiffness_n", self.stiffness_n, "100 to 1e7 N", |v| (100.0..=1e7).contains(&v))?;
        number("motor_box.drag_n_s2_m2", self.drag_n_s2_m2, "0 to 1e4 N s²/m²", |v| (0.0..=1e4).contains(&v))?;
        number("motor_box.drum_radius_m", self.drum_radius_m, "0.001 to 1 m", |v| (0.001..=1.0).contains(&v))?;
        number("motor_box.line_diameter_m", self.line_diameter_m, "0.00001 to 0.05 m", |v| (1e-5..=0.05).contains(&v))?;
        number("motor_box.turnaround_s", self.turnaround_s, "0 to 0.1 s", |v| (0.0..=0.1).contains(&v))?;
        number("motor_box.supply_v", self.supply_v, "1 to 60 V", |v| (1.0..=60.0).contains(&v))
    }

    fn check_start(&self, robot: &RobotFile) -> Result<(), Problem> {
        let start_m = self
            .start_m
            .resolve(robot.robot.anchors_m.is_planar())
            .map_err(|why| Problem::with_clause("motor_box.start_m", format!("is not usable: {why}")))?;
        for value in start_m {
            number("motor_box.start_m", value, "[x, y, z] in metres", |v| v.abs() <= 1000.0)?;
        }
        if start_m[2] < robot.robot.ground_m {
            let (height, ground_m) = (start_m[2], robot.robot.ground_m);
            let clause =
                format!("is at height {height} m; accepted: at or above the robot's `ground_m` of {ground_m} m");
            return Err(Problem::with_clause("motor_box.start_m", clause));
        }
        Ok(())
    }
}
