//! The command line of `nims sim`.

use std::path::PathBuf;

use command::{Answer, Failure};

use crate::commands::Commands;
use crate::variants::{Assignment, Sweep, Variant, Weather, Worlds, product};

/// Key of the control law.
const LAW: &str = "controller.law";

/// Flights that one command flies at most: a typing error in a range would otherwise fill the disk.
const MOST_FLIGHTS: usize = 10_000;

fn few_enough(flights: usize) -> Answer<()> {
    if flights > MOST_FLIGHTS {
        return Err(Failure::BadInput(format!("these are {flights} flights; accepted: at most {MOST_FLIGHTS}")));
    }
    Ok(())
}

/// Command-line arguments of `nims sim`.
#[derive(Debug, Clone, clap::Args)]
pub struct Args {
    /// System file with a virtual motor box.
    pub system: PathBuf,
    /// Mission, by path or by name in the missions folder; default: that of the demonstration.
    #[arg(long)]
    pub mission: Option<PathBuf>,
    /// Control law, as `law` of `[controller]`; with --program it flies beside the custom one.
    #[arg(long)]
    pub law: Option<String>,
    /// Custom law: the command of its program, which answers cycle by cycle over a pipe. In it, {KEY} stands for the
    /// value of KEY in --set or --sweep.
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
        let law = self.law.iter().map(|law| Assignment { key: LAW.into(), value: law.clone() });
        law.chain(self.sets.iter().cloned()).collect()
    }

    pub(crate) fn weather(&self) -> Weather {
        Weather { spread: self.spread, wind_m_s: self.wind, warming_k: self.warming }
    }

    /// Returns every flight that these arguments ask for: with --law and --program those of the built-in law first.
    ///
    /// # Errors
    /// More than a command may fly, or a key in a command without a value.
    pub(crate) fn variants(&self) -> Answer<Vec<Variant>> {
        let commands = Commands { law: self.program.clone(), estimator: self.estimator_program.clone() };
        let (Some(law), Some(_)) = (&self.law, &self.program) else {
            return self.flights(&self.all_sets(), &self.sweeps, &commands, &commands);
        };
        let built_in = Commands { law: None, ..commands.clone() };
        // It has no arguments.
        let of_files = self.sweeps.iter().filter(|sweep| !commands.is_argument(&sweep.key) || built_in.has(&sweep.key));
        let beside = Sweep { key: LAW.into(), values: vec![law.clone()] };
        let sweeps: Vec<Sweep> = std::iter::once(beside).chain(of_files.cloned()).collect();
        let mut variants = self.flights(&self.sets, &sweeps, &commands, &built_in)?;
        for mut custom in self.flights(&self.sets, &self.sweeps, &commands, &commands)? {
            (custom.number, custom.is_beside) = (variants.len() + 1, true);
            variants.push(custom);
        }
        few_enough(variants.len())?;
        Ok(variants)
    }

    /// Returns every flight of these sweeps with `flown`, which are `commands` or a part of them.
    fn flights(
        &self,
        sets: &[Assignment],
        sweeps: &[Sweep],
        commands: &Commands,
        flown: &Commands,
    ) -> Answer<Vec<Variant>> {
        let seeds = self.worlds.as_ref().map(|worlds| worlds.0.as_slice()).unwrap_or_default();
        let count = sweeps.iter().map(|sweep| sweep.values.len()).product::<usize>() * seeds.len().max(1);
        few_enough(count)?;
        let variants = product(sets, sweeps, seeds, self.weather()).into_iter();
        variants.map(|variant| variant.with_commands(commands, flown)).collect()
    }
}
