//! The commands of this crate.

use crate::{map, motor_table, report, runs};
use command::{Answer, Output};
use std::path::PathBuf;

/// What can be done with a recorded run.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// A run as one page: what was flown, how well, what happened; several runs side by side.
    Report {
        /// Run folders or files.
        #[arg(required = true, value_name = "RUN")]
        runs: Vec<PathBuf>,
        /// The page; default: report.html in the run folder (comparison.html for several runs, in the first one's).
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// What the sensors of a run measured as maps with uncertainty: contour pictures, grids, point clouds, tables.
    Map(map::Args),
    /// What is in a run: length, channels, rates, gaps, health.
    Info {
        /// Run folder or file.
        run: PathBuf,
    },
    /// Restore run files that were not closed or are damaged.
    Recover {
        /// Run folder, or a file that ends in .mcap.part or .mcap.
        run: PathBuf,
    },
    /// What the motors draw over speed and tension, from recorded runs of raising and lowering known loads.
    MotorTable(motor_table::Args),
}

impl Command {
    /// Carries the command out.
    ///
    /// # Errors
    /// One sentence.
    pub fn run(&self) -> Answer<Output> {
        match self {
            Self::Report { runs, out } => report::report(runs, out.as_deref()),
            Self::Map(args) => map::run(args),
            Self::Info { run } => runs::info(run),
            Self::Recover { run } => runs::recover(run),
            Self::MotorTable(args) => motor_table::run(args),
        }
    }
}
