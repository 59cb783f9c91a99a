//! The commands of this crate.

use crate::new_program::{self, Kind, new_program};
use crate::{calibrate, check, doctor, kinematics, loads, plan, setup, workspace};
use client::Place;
use command::{Answer, Output};

/// Commands for the time before the first flight, and the starts of new programs, without a running robot.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Check a robot, system, mission, sensor or ground file; each finding has a remedy.
    Check(check::Args),
    /// Check this machine: memory, stale robots, limits, ports, clock, disk; each finding has a remedy. Exit code 1: an
    /// error would stop the robot.
    Doctor(doctor::Args),
    /// Cable lengths for a position of the node.
    Ik(kinematics::IkArgs),
    /// Position of the node for given cable lengths.
    Fk(kinematics::FkArgs),
    /// Cable tensions for a position and an acceleration of the node.
    Tension(kinematics::TensionArgs),
    /// Compute the anchors and their standard deviations from field measurements, or explain why they do not determine
    /// them.
    Calibrate(calibrate::Args),
    /// Calibrate in the field by answering one question at a time; answers are saved, and the same command continues.
    Setup(setup::Args),
    /// Stiffness of the cables and weight of the node from measurements with a known weight, or why they do not
    /// determine them.
    Loads(loads::Args),
    /// Cost of a move, and the parabola with the least cost.
    Plan(plan::Args),
    /// Region where the cables can hold the node at rest: volume and margins.
    Workspace(workspace::Args),
    /// Write an example sensor that runs unchanged, in Python or in Rust, as the start of a new sensor.
    NewSensor(new_program::Args),
    /// Write an example control law that flies unchanged, in Python or in Rust, as the start of a new law.
    NewLaw(new_program::Args),
    /// Write an example estimator that flies unchanged, in Python or in Rust, as the start of a new estimator.
    NewEstimator(new_program::Args),
}

impl Command {
    /// Runs the command. `place`: the robot, for `setup`.
    ///
    /// # Errors
    /// One sentence that the program prints.
    pub fn run(&self, place: Place<'_>) -> Answer<Output> {
        match self {
            Self::Check(args) => check::run(args),
            Self::Doctor(args) => doctor::run(args),
            Self::Ik(args) => kinematics::ik(args),
            Self::Fk(args) => kinematics::fk(args),
            Self::Tension(args) => kinematics::tension(args),
            Self::Calibrate(args) => calibrate::run(args),
            Self::Setup(args) => setup::run(args, place),
            Self::Loads(args) => loads::run(args),
            Self::Plan(args) => plan::run(args),
            Self::Workspace(args) => workspace::run(args),
            Self::NewSensor(args) => new_program(Kind::Sensor, args),
            Self::NewLaw(args) => new_program(Kind::Law, args),
            Self::NewEstimator(args) => new_program(Kind::Estimator, args),
        }
    }
}
