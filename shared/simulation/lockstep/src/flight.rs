//! What is flown, and what a flight and a cycle of it result in.

use anyhow::Result;
use cable_robot::{CableVec, Distribution, Robot, Vector3};
use config::SystemFile;
use controller::Law;
use estimator::Method;
use messages::{
    CABLES, ControlStatus, Energy, MotorAuthority, MotorCommand, MotorInput, MotorSlots, MotorState, NodeEstimate,
    PlanMotion, PlanStatus,
};
use planner::Mission;
use plant::PlantConfig;

use crate::slots::Slots;

/// Longest flight, s, unless a scenario states another: several times that of the example missions.
const LONGEST_S: f64 = 300.0;

/// One flight: the robot as configured in the software, the plant, and the mission.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// Robot of the robot file.
    pub robot: Robot,
    /// Configuration of the plant.
    pub plant: PlantConfig,
    /// Mission.
    pub mission: Mission,
    /// Control period, s.
    pub period_s: f64,
    /// The control law.
    pub law: Law,
    /// Horizon Δ of the law, cycles.
    pub horizon: u32,
    /// Method of the estimator.
    pub method: Method,
    /// Whether estimator, controller and zeroing correct for stretch.
    pub stretch: bool,
    /// Tension distribution.
    pub distribution: Distribution,
    /// Longest flight, s.
    pub longest_s: f64,
}

impl Scenario {
    /// The robot of a system file in a world: period, law, horizon, method and distribution are those of the file.
    ///
    /// # Errors
    /// A value of one of the files that is not accepted.
    pub fn from_files(file: &SystemFile, robot: Robot, plant: PlantConfig, mission: Mission) -> Result<Self> {
        Ok(Self {
            robot,
            plant,
            mission,
            period_s: file.period_s(),
            law: Law::from_section(&file.controller)?,
            horizon: u32::try_from(file.controller.horizon_cycles)?,
            method: Method::from_section(&file.estimator)?,
            stretch: true,
            distribution: file.controller.distribution_for(&robot),
            longest_s: LONGEST_S,
        })
    }
}

/// Statistics of distances over the moving cycles, m.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Deviation {
    /// Root mean square.
    pub rms_m: f64,
    /// Largest.
    pub max_m: f64,
}

/// Results of a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Flight {
    /// Cycles in which the setpoint moved.
    pub moving_cycles: u64,
    /// All cycles.
    pub cycles: u64,
    /// Estimate relative to setpoint.
    pub estimate: Deviation,
    /// Truth relative to setpoint.
    pub truth: Deviation,
    /// Truth relative to estimate.
    pub between: Deviation,
    /// Share of these cycles in which the truth is within two standard deviations of the estimate on every axis.
    pub covered: f64,
    /// Twice the standard deviation that the estimate states, over all axes together.
    pub stated: Deviation,
    /// RMS difference of true and estimated velocity, m/s.
    pub velocity_rms_m_s: f64,
    /// Largest difference of true and chosen tension over cables and moving cycles, N.
    pub tension_max_n: f64,
    /// RMS difference of true and chosen tension, N.
    pub tension_rms_n: f64,
    /// Largest tension error as a share of the allowed error: 15 % of the chosen tension or 2 N, whichever is more.
    pub tension_share: f64,
    /// Lowest and highest true tension, N.
    pub tension_range_n: [f64; 2],
    /// Cycles in which a cable was truly slack.
    pub slack_cycles: u64,
    /// Periods of the mission that were not steered by a fresh command.
    pub unsteered: u64,
    /// Largest saturation of the cable speeds.
    pub saturation: f64,
    /// Largest change of a cable's command from one cycle to the next, m/s.
    pub step_m_s: f64,
    /// Energy that the motors took from the supply during the mission, J.
    pub energy_j: f64,
    /// Final true position and setpoint, m.
    pub end_m: [[f64; 3]; 2],
    /// Last state of the planner.
    pub state: u8,
}

/// All results of a cycle, for detailed checks.
#[derive(Debug, Clone, Copy)]
pub struct Cycle {
    /// Input of the decision of motor-io.
    pub input: MotorInput,
    /// Encoders and drives.
    pub state: MotorState,
    /// Mode and plan clock.
    pub authority: MotorAuthority,
    /// Confidence in each slot.
    pub slots: MotorSlots,
    /// Power and loss, integrated by motor-io.
    pub energy: Energy,
    /// Estimate; with two estimators, of the slot in use.
    pub estimate: NodeEstimate,
    /// Command; with two controllers, of the slot in use.
    pub command: MotorCommand,
    /// Status of that controller.
    pub control: ControlStatus,
    /// Commands of motor-io's mode and arbiter before its limits, m/s.
    pub asked_m_s: [f64; CABLES],
    /// Commands sent to the drives, m/s.
    pub sent_m_s: [f64; CABLES],
    /// Motion.
    pub motion: PlanMotion,
    /// Status of the planner.
    pub plan: PlanStatus,
    /// True position at the time of the estimate, m.
    pub truth_m: [f64; 3],
    /// True velocity at the time of the estimate, m/s.
    pub truth_m_s: [f64; 3],
    /// True tensions at the time of the estimate, N.
    pub truth_n: CableVec,
}

/// A cycle and the processes that computed it, for an observer of a flight.
#[derive(Clone, Copy)]
pub struct Observed<'a> {
    /// Results of the cycle.
    pub cycle: &'a Cycle,
    /// Controllers and estimators.
    pub slots: &'a Slots,
}

impl Cycle {
    /// Whether the truth is within two standard deviations of the estimate on every axis.
    pub(crate) fn covers_truth(&self) -> bool {
        let (position_m, two_sigma_m) = (&self.estimate.position_m, self.estimate.two_sigma_m());
        (0..3).all(|i| (self.truth_m[i] - position_m[i]).abs() <= two_sigma_m[i])
    }

    /// Twice the standard deviation that the estimate states, over all axes together, m.
    pub(crate) fn stated_m(&self) -> f64 {
        Vector3::from(self.estimate.two_sigma_m()).norm()
    }
}
