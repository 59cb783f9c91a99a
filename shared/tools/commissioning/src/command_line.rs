//! The commands of this crate.

use crate::{calibrate, check, doctor, kinematics, plan, setup, workspace};
use command::{Answer, Output};

/// What can be done before the first flight, without a running robot.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Check a robot, system, mission, sensor or ground file; each finding with its cure.
    Check(check::Args),
    /// Look at this machine: memory, stale robots, limits, ports, clock, disk; each finding with its cure. Exit code 1: one would stop the robot.
    Doctor(doctor::Args),
    /// Cable lengths for a position of the node.
    Ik(kinematics::IkArgs),
    /// Position of the node for cable lengths.
    Fk(kinematics::FkArgs),
    /// Cable tensions for a position and acceleration of the node.
    Tension(kinematics::TensionArgs),
    /// Anchors with their deviations from measurements in the field, or why these do not determine them.
    Calibrate(calibrate::Args),
    /// Calibrate in the field by answering one question at a time; what was answered is kept, and the same command goes on.
    Setup(setup::Args),
    /// What a move costs, and the parabola that costs least.
    Plan(plan::Args),
    /// Where the lines can hold the node at rest: volume and margins.
    Workspace(workspace::Args),
}

impl Command {
    /// Carries the command out.
    ///
    /// # Errors
    /// One sentence.
    pub fn run(&self) -> Answer<Output> {
        match self {
            Self::Check(args) => check::run(args),
            Self::Doctor(args) => doctor::run(args),
            Self::Ik(args) => kinematics::ik(args),
            Self::Fk(args) => kinematics::fk(args),
            Self::Tension(args) => kinematics::tension(args),
            Self::Calibrate(args) => calibrate::run(args),
            Self::Setup(args) => setup::run(args),
            Self::Plan(args) => plan::run(args),
            Self::Workspace(args) => workspace::run(args),
        }
    }
}
