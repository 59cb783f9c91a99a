//! The deciding parts of the processes, built from a scenario or from a system file.

use anyhow::Result;
use cable_robot::Robot;
use config::{ControllerSection, EstimatorSection, PlannerSection, RobotFile, SystemFile};
use controller::{Controller, ControllerConfig};
use estimator::{Estimator, EstimatorConfig};
use motor_io::{Core, CoreConfig};
use planner::{Planner, PlannerConfig};

use crate::flight::Scenario;

/// The deciding parts of the processes of the control chain, in their initial state.
pub struct Chain {
    /// Core of motor-io.
    pub core: Core,
    /// Core of the estimator.
    pub estimator: Estimator,
    /// Core of the controller.
    pub controller: Controller,
    /// Core of the planner.
    pub planner: Planner,
}

/// The robot as modelled by the chain.
pub(crate) fn modelled_robot(scenario: &Scenario) -> Robot {
    if scenario.stretch { scenario.robot } else { scenario.robot.with_rigid_lines() }
}

/// Builds the configuration of motor-io's core.
///
/// # Errors
/// Invalid encoders, units or limits.
pub fn core_config(scenario: &Scenario) -> Result<CoreConfig> {
    let robot = modelled_robot(scenario);
    let counts_per_m: Vec<f64> = scenario.plant.idlers.iter().map(|idler| idler.counts_per_m).collect();
    let units: Vec<Vec<usize>> =
        (0..robot.cable_count()).collect::<Vec<_>>().chunks(2).map(<[usize]>::to_vec).collect();
    let mut core = CoreConfig::new(robot, scenario.period_s, &counts_per_m, &units)?;
    core.distribution = scenario.distribution;
    Ok(core)
}

impl Chain {
    /// Builds the chain of a scenario; everything else has the defaults of the configuration files.
    pub fn new(scenario: &Scenario) -> Result<Self> {
        let robot = modelled_robot(scenario);
        let core = core_config(scenario)?;
        let section = ControllerSection::default();
        let controller = ControllerConfig {
            robot,
            law: scenario.law,
            horizon: scenario.horizon,
            distribution: scenario.distribution,
            redundant_s: section.redundant_s,
            cable_speed_limit_m_s: robot.cable_speed_limit_m_s(),
            error_limit_m: section.error_limit_m,
            ttl_cycles: core.ttl_cycles,
            estimate_ttl_cycles: EstimatorSection::default().ttl_cycles,
            thread: 0,
            incarnation: 2,
        };
        let PlannerSection { speed_m_s, acceleration_m_s2, check_step_m, swing_limit_m, .. } =
            PlannerSection::default();
        let distribution = scenario.distribution;
        Ok(Self {
            core: Core::new(core),
            estimator: Estimator::new(&EstimatorConfig {
                robot,
                method: scenario.method,
                sigma_length_m: EstimatorSection::default().sigma_length_m,
                incarnation: 1,
                thread: 0,
            }),
            controller: Controller::new(controller),
            planner: Planner::new(PlannerConfig {
                robot: scenario.robot,
                distribution,
                speed_m_s,
                acceleration_m_s2,
                check_step_m,
                swing_limit_m,
            }),
        })
    }
}

impl Chain {
    /// Builds the chain of a system file, exactly as the processes do.
    ///
    /// # Errors
    /// An error of the file.
    pub fn from_file(file: &SystemFile) -> Result<Self> {
        Self::from_files(file, &file.robot_file()?)
    }

    /// The same with another robot than that of the system file.
    ///
    /// # Errors
    /// An error of one of the files.
    pub fn from_files(file: &SystemFile, robot: &RobotFile) -> Result<Self> {
        Ok(Self {
            core: Core::new(CoreConfig::from_files(file, robot)?),
            estimator: Estimator::new(&EstimatorConfig::from_section(&file.estimator, robot.robot()?, 1)?),
            controller: Controller::new(ControllerConfig::from_files(file, robot, 2)?),
            planner: Planner::new(PlannerConfig::from_files(file, robot.robot()?)),
        })
    }
}
