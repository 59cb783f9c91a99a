//! `nims truth`: draws a plausible world that is not the robot's model, and writes a system file with it.
//!
//! Invariants:
//! * The same system file, seed and options give the same bytes.
//! * A spread of 0 is the model itself; each deviation grows with the spread.
//! * Comments and order of the system file stay. A world that it has is replaced.
//! * A written world is one in which the node can hang at its start.
//!
//! docs/truth.md has the distribution of every key with its origin.
#![forbid(unsafe_code)]

mod draw;
mod file;

pub use draw::{Options, draw};
pub use file::moved;

use command::{Answer, Failure, Output};
use config::SystemFile;
use motor_box::{BoxConfig, MotorBoxSection};
use plant::Plant;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Largest integer of a TOML file.
const LARGEST_SEED: u64 = i64::MAX as u64;

/// Command-line arguments of `nims truth`.
#[derive(Debug, Clone, clap::Args)]
pub struct Args {
    /// System file with the virtual motor box.
    pub system: PathBuf,
    /// Number of the world; each has its own.
    #[arg(long, value_parser = clap::value_parser!(u64).range(..=LARGEST_SEED))]
    pub seed: u64,
    /// How far the world is from the model: 0 the model itself, 1 a robot that was put up with care.
    #[arg(long, default_value_t = 1.0, value_parser = spread, allow_negative_numbers = true)]
    pub spread: f64,
    /// Warming over ten minutes from the start, K.
    #[arg(long, value_name = "K", default_value_t = 0.0, value_parser = finite, allow_negative_numbers = true)]
    pub warming: f64,
    /// Mean wind, m/s, from a drawn direction and with gusts of a fifth of it.
    #[arg(long, value_name = "M_S", default_value_t = 0.0, value_parser = finite, allow_negative_numbers = true)]
    pub wind: f64,
    /// File to write; default: SYSTEM-truth-SEED.toml beside the system file.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

fn finite(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if f64::abs(value) <= 100.0 => Ok(value),
        _ => Err("accepted: a number within 100".to_owned()),
    }
}

fn spread(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if (0.0..=5.0).contains(&value) => Ok(value),
        _ => Err("accepted: 0 to 5".to_owned()),
    }
}

/// Draws the world and writes the file.
///
/// # Errors
/// The system file is not accepted or has no virtual motor box, or the node cannot hang in the drawn world.
pub fn run(args: &Args) -> Answer<Output> {
    let file = SystemFile::load(&args.system).map_err(Failure::bad)?;
    let robot = file.robot_file().map_err(Failure::bad)?;
    let Some(section) = MotorBoxSection::from_file(&file, &robot).map_err(Failure::bad)? else {
        let system = args.system.display();
        return Err(Failure::BadInput(format!("{system} has no [motor_box]; only a virtual robot has a drawn world")));
    };
    let options = Options { seed: args.seed, spread: args.spread, warming_k: args.warming, wind_m_s: args.wind.abs() };
    let world = draw(&options, &section, &robot, &file.motor_io.counts_per_m);
    let out = args.out.clone().unwrap_or_else(|| beside(&args.system, args.seed));
    let text = file::with_world(&args.system, &world, out.parent().unwrap_or(Path::new("")))?;
    // A file that is there stays as it is until the world is one in which the robot can be.
    let draft = file::Draft::write(&out, &text)?;
    hangs(draft.path())?;
    draft.put()?;
    let words = format!("{} in {}", world.name.clone().unwrap_or_default(), out.display());
    let truth = serde_json::to_value(&world).map_err(Failure::not_now)?;
    Ok(Output::new(json!({ "out": out, "seed": args.seed, "spread": args.spread, "truth": truth }), words))
}

/// Checks the written file and that the node can hang at its start.
fn hangs(path: &Path) -> Answer {
    let file = SystemFile::load(path).map_err(Failure::bad)?;
    let robot = file.robot_file().map_err(Failure::bad)?;
    let config = BoxConfig::from_files(&file, &robot, Path::new("")).map_err(Failure::bad)?;
    Plant::new(config.plant).map_err(|error| {
        Failure::BadInput(format!("in this world {error}; move `motor_box.start_m` inwards, or take another seed"))
    })?;
    Ok(())
}

fn beside(system: &Path, seed: u64) -> PathBuf {
    let stem = system.file_stem().unwrap_or_default().to_string_lossy();
    system.with_file_name(format!("{stem}-truth-{seed}.toml"))
}
