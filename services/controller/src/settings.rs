//! Configuration of a controller.

use cable_robot::{Distribution, Robot};
use config::{RobotFile, SystemFile};

use crate::law::Law;

/// Configuration of a controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControllerConfig {
    /// The robot; with [`Robot::with_rigid_lines`], stretch is not corrected.
    pub robot: Robot,
    /// The law.
    pub law: Law,
    /// Horizon Δ, cycles, 1 to 200.
    pub horizon: u32,
    /// Distribution of the tensions of redundant cables.
    pub distribution: Distribution,
    /// Time constant of the loop on the redundant lengths, s.
    pub redundant_s: f64,
    /// Largest velocity of a cable, m/s.
    pub cable_speed_limit_m_s: f64,
    /// Distance from the setpoint beyond which the controller gives no answer, m.
    pub error_limit_m: f64,
    /// Age, in cycles, up to which a command may be used.
    pub ttl_cycles: u32,
    /// Age, in cycles, up to which an estimate is answered.
    pub estimate_ttl_cycles: u32,
    /// Kernel's id of the thread that computes the commands; 0: unknown.
    pub thread: u32,
    /// Random number of this run of the process, never 0.
    pub incarnation: u32,
}

impl ControllerConfig {
    /// Returns the configuration in a system file and its robot file.
    ///
    /// # Errors
    /// A parameter of the law is out of range.
    pub fn from_files(file: &SystemFile, robot: &RobotFile, incarnation: u32) -> anyhow::Result<Self> {
        let section = &file.controller;
        let parts = robot.robot()?;
        Ok(Self {
            robot: if section.stretch { parts } else { parts.with_rigid_lines() },
            law: Law::from_section(section)?,
            horizon: u32::try_from(section.horizon_cycles)?,
            distribution: section.distribution_for(&parts),
            redundant_s: section.redundant_s,
            cable_speed_limit_m_s: robot.cable_speed_limit_m_s(),
            error_limit_m: section.error_limit_m,
            ttl_cycles: file.motor_io.ttl_cycles,
            estimate_ttl_cycles: file.estimator.ttl_cycles,
            thread: 0,
            incarnation,
        })
    }
}
