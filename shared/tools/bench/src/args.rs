//! The arguments of `nims bench`.

use clap::ValueEnum;
use command::values::{above_zero, finite};
use std::path::PathBuf;

/// Maximum duration of one part, s.
const LONGEST_S: f64 = 3600.0;

/// `nims bench`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Parts to measure; default: all.
    #[arg(value_enum, value_name = "PART")]
    pub parts: Vec<Part>,
    /// System file; its rate, scheduling, runs folder, law and estimator are measured.
    #[arg(long = "system", visible_alias = "config", value_name = "SYSTEM.toml")]
    pub system_file: Option<PathBuf>,
    /// Control cycles per second, 10 to 500; default: from the system file, otherwise 100.
    #[arg(long, value_name = "HZ", value_parser = finite, allow_negative_numbers = true)]
    pub rate: Option<f64>,
    /// Duration of each part, s; default: as long as its figures need, 18 s in total.
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true)]
    pub seconds: Option<f64>,
    /// Folder on the disk to measure; default: from the system file, otherwise the current folder.
    #[arg(long, value_name = "DIR")]
    pub runs: Option<PathBuf>,
    /// Write a one-page certificate of the wake-ups of this system to FILE.html: under load, a million of them, which
    /// takes 2.8 h at 100 Hz. With --seconds fewer, and the page says "not certified".
    #[arg(long, value_name = "FILE.html", requires = "system_file", conflicts_with = "parts")]
    pub certificate: Option<PathBuf>,
    /// Load during --certificate: `all` keeps every processor, the memory and the disk of the runs busy.
    #[arg(long, value_enum, default_value_t, requires = "certificate")]
    pub load: Load,
    /// Measure even while a robot runs on this machine; this delays the robot.
    #[arg(long)]
    pub beside: bool,
}

/// Load by other threads during a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum Load {
    /// Processors, memory and disk.
    #[default]
    All,
    /// None; the certificate then says "not certified".
    None,
}

/// Parts of the benchmark in the order of their execution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum Part {
    /// Delay of a periodic wake-up.
    Tick,
    /// Round-trip time of a sample to another process.
    Bus,
    /// Computing time of the control chain as a share of the period.
    Chain,
    /// Speed of writing samples to the disk.
    Disk,
}

impl Part {
    /// All parts.
    pub const ALL: [Self; 4] = [Self::Tick, Self::Bus, Self::Chain, Self::Disk];

    /// Returns the name on the command line.
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
