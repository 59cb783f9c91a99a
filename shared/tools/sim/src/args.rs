//! The command line of `nims sim`.

use std::path::PathBuf;

use command::{Answer, Failure};

use crate::variants::{Assignment, Sweep, Variant, Weather, Worlds, product};

/// Flights that one command flies at most: a typing error in a range would otherwise fill the disk.
const MOST_FLIGHTS: usize = 10_000;

/// Command-line arguments of `nims sim`.
#[derive(Debug, Clone, clap::Args)]
pub struct Args {
    /// System file with a virtual motor box.
    pub system: PathBuf,
    /// Mission, by path or by name in the missions folder; default: that of the demonstration.
    #[arg(long)]
    pub mission: Option<PathBuf>,
    /// Control law, as `law` of `[controller]`.
    #[arg(long, conflicts_with = "program")]
    pub law: Option<String>,
    /// Custom law: the command of its program, which answers cycle by cycle over a pipe.
    #[arg(long, value_name = "COMMAND")]
    pub program: Option<String>,
    /// Custom estimator: the command of its program, as for a law.
    #[arg(long, value_name = "COMMAND")]
    pub estimator_program: Option<String>,
    /// Value of the system or robot file, such as controller.horizon_cycles=20 or robot.node_mass_kg=2.5.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<Assignment>,
    /// Values of a key, each of which is flown; several of these options are all combined.
    #[arg(long = "sweep", value_name = "KEY=A,B,C")]
    pub sweeps: Vec<Sweep>,
    /// Drawn worlds, such as 1,2 or 1..20; see `nims truth`. Default: the world of the system file.
    #[arg(long = "world", value_name = "SEEDS", group = "drawn")]
    pub worlds: Option<Worlds>,
    /// How far a drawn world is from the model.
    #[arg(long, default_value_t = 1.0, requires = "drawn")]
    pub spread: f64,
    /// Mean wind in a drawn world, m/s.
    #[arg(long, value_name = "M_S", default_value_t = 0.0, requires = "drawn")]
    pub wind: f64,
    /// Warming over ten minutes in a drawn world, K.
    #[arg(long, value_name = "K", default_value_t = 0.0, requires = "drawn", allow_negative_numbers = true)]
    pub warming: f64,
    /// Longest flight, s.
    #[arg(long, value_name = "S", default_value_t = 600.0)]
    pub longest: f64,
    /// Folder for a run folder of each flight, the table and the charts; default: the table alone.
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
    /// Takes the cable velocities of each cycle from standard input: for programs, such as `nims.Sim` in Python.
    #[arg(long, group = "drawn", conflicts_with_all = ["law", "program", "estimator_program", "sweeps", "jobs"])]
    pub steps: bool,
    /// Flights at the same time; default: the number of processors.
    #[arg(long, value_parser = jobs)]
    pub jobs: Option<usize>,
}

fn jobs(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|jobs| (1..=1024).contains(jobs)).ok_or_else(|| "accepted: 1 to 1024".to_owned())
}

impl Args {
    /// Values that all flights have.
    pub(crate) fn all_sets(&self) -> Vec<Assignment> {
        let law = self.law.iter().map(|law| Assignment { key: "controller.law".into(), value: law.clone() });
        law.chain(self.sets.iter().cloned()).collect()
    }

    pub(crate) fn weather(&self) -> Weather {
        Weather { spread: self.spread, wind_m_s: self.wind, warming_k: self.warming }
    }

    /// Returns every flight that these arguments ask for.
    ///
    /// # Errors
    /// More than a command may fly.
    pub(crate) fn variants(&self) -> Answer<Vec<Variant>> {
        let (sets, weather) = (self.all_sets(), self.weather());
        let seeds = self.worlds.as_ref().map(|worlds| worlds.0.as_slice()).unwrap_or_default();
        let count = self.sweeps.iter().map(|sweep| sweep.values.len()).product::<usize>() * seeds.len().max(1);
        if count > MOST_FLIGHTS {
            return Err(Failure::BadInput(format!("these are {count} flights; accepted: at most {MOST_FLIGHTS}")));
        }
        Ok(product(&sets, &self.sweeps, seeds, weather))
    }
}
