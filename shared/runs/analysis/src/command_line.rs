//! The commands of this crate.

use crate::{identify, map, motor_table, report, runs};
use command::{Answer, Output};
use std::path::PathBuf;

/// Commands for recorded runs.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// A run as one page: motions, accuracy, events; several runs side by side.
    Report(report::Args),
    /// Map the sensor readings of a run with uncertainty: contour plots, grids, point clouds, tables.
    Map(map::Args),
    /// Contents of a run: length, channels, rates, gaps, health.
    Info {
        /// Run folder or file, or the name of a finished run that `nims runs` lists.
        run: PathBuf,
    },
    /// Restore run files that were not closed or are damaged.
    Recover {
        /// Run folder, or a file that ends in .mcap.part or .mcap.
        run: PathBuf,
    },
    /// Measure the motor current over speed and tension from recorded runs that raise and lower known loads.
    MotorTable(motor_table::Args),
    /// Identify delay and lag of the drives, motors, friction and the node's mass from a run.
    Identify(identify::Args),
}

impl Command {
    /// Runs the command.
    ///
    /// # Errors
    /// One sentence that the program prints.
    pub fn run(&self) -> Answer<Output> {
        match self {
            Self::Report(args) => args.run(),
            Self::Map(args) => map::run(args),
            Self::Info { run } => runs::info(run),
            Self::Recover { run } => runs::recover(run),
            Self::MotorTable(args) => motor_table::run(args),
            Self::Identify(args) => identify::run(args),
        }
    }
}
