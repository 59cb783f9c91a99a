//! The arguments of `nims bench`.

use clap::ValueEnum;
use command::values::{above_zero, finite};
use std::path::PathBuf;

/// Longest time for one part, s.
const LONGEST_S: f64 = 3600.0;

/// `nims bench`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// What to measure; default: all of it.
    #[arg(value_enum, value_name = "PART")]
    pub parts: Vec<Part>,
    /// System file, whose rate, scheduling, runs folder, law and estimator are measured.
    #[arg(long = "system", value_name = "SYSTEM.toml")]
    pub system_file: Option<PathBuf>,
    /// Control cycles per second, 10 to 250; default: as the system file says, else 100.
    #[arg(long, value_name = "HZ", value_parser = finite, allow_negative_numbers = true)]
    pub rate: Option<f64>,
    /// Time for each part, s; default: as long as its figures need, 18 s for all.
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true)]
    pub seconds: Option<f64>,
    /// Folder on the disk that is measured; default: as the system file says, else the present one.
    #[arg(long, value_name = "DIR")]
    pub runs: Option<PathBuf>,
    /// Measure also while a robot runs on this machine, whose time it takes.
    #[arg(long)]
    pub beside: bool,
}

/// The parts, in the order in which they are measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum Part {
    /// How late a process wakes up that has to work once per period.
    Tick,
    /// How long a sample takes to another process and back.
    Bus,
    /// How much of a period the control chain computes.
    Chain,
    /// How fast samples come onto the disk.
    Disk,
}

impl Part {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Tick, Self::Bus, Self::Chain, Self::Disk];

    /// As it is typed.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Tick => "tick",
            Self::Bus => "bus",
            Self::Chain => "chain",
            Self::Disk => "disk",
        }
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    let value = above_zero(text)?;
    if value <= LONGEST_S { Ok(value) } else { Err(format!("{text} s is longer than an hour ({LONGEST_S} s)")) }
}
