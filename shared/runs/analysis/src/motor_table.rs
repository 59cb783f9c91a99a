//! `nims motor-table`: fits a table of motor currents to recorded runs that raise and lower known loads.

use crate::report;
use crate::tracker::{Cycle, Tracker};
use cable_robot::Drum;
use calibration::motor_fit::{Sample, covered, fit};
use command::values::{Numbers, numbers};
use command::{Answer, Failure, Output};
use messages::{MotorAuthority, MotorState, NodeEstimate};
use serde_json::json;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// `nims motor-table`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Run folders or files. The robot file of each run must give the load on the cables (node_mass_kg).
    #[arg(required = true, value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    /// Write the table to this new file, for `table` in `[motor]` of a robot file.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Use the motor of this cable only, from 1; default: all motors together.
    #[arg(long, value_name = "CABLE", value_parser = clap::value_parser!(u8).range(1..=8))]
    pub cable: Option<u8>,
    /// Reel-in speeds of the table, m/s, ascending, below 0 for paying out; default: the range of the runs.
    #[arg(long, value_name = "A,B,..", value_parser = numbers, allow_hyphen_values = true)]
    pub speeds: Option<Numbers>,
    /// Tensions of the table, N, ascending; default: the range of the runs.
    #[arg(long, value_name = "A,B,..", value_parser = numbers)]
    pub tensions: Option<Numbers>,
}

/// Averaging time of a sample, s: long compared with an encoder step and the drives' own averaging, short compared with
/// a move.
const WINDOW_S: f64 = 0.2;

/// Maximum change of a cable's speed between the halves of a window, m/s. Beyond it the rotor's inertia contributes
/// more than half a newton.
const STEADY_M_S: f64 = 0.003;

/// Minimum speed of the node, m/s; at rest a self-locking gear makes the current arbitrary.
const STANDING_M_S: f64 = 0.005;

/// Recorded data of a cycle that follows a motion with a valid estimate.
type Row = (MotorState, NodeEstimate);

/// Extracts the samples of a run: one per cable, or of the given one (from 1), and window of steady motion.
///
/// The tension is the estimated one: with three cables from the statics of the load, with more from their stretch. With
/// `[drum]` in the run's robot file, tension and speed are those on the bare drum.
///
/// # Errors
/// The run cannot be read or has no usable motion.
pub fn samples(run: &Path, cable: Option<u8>) -> Answer<Vec<Sample>> {
    let mut reader = runlog::RunReader::open(run).map_err(Failure::bad)?;
    // The attachments precede the first sample.
    reader.next_sample().map_err(Failure::not_now)?;
    let robot = report::robot_of(run, reader.attachments())?;
    let mut reader = runlog::RunReader::open(run).map_err(Failure::bad)?;
    let drum = |cable| robot.as_ref().map_or_else(Drum::default, |robot| robot.drum(cable));
    let mut tracker = Tracker::default();
    // Consecutive cycles of one life, until they are a window.
    let (mut rows, mut last, mut followed) = (Vec::<Row>::new(), None, false);
    let mut samples = Vec::new();
    let mut each = |cycle: &Cycle<'_>| {
        let authority = cycle.authority;
        let (life, number) = (authority.header.life, authority.header.cycle);
        if last.replace((life, number + 1)) != Some((life, number)) {
            rows.clear();
        }
        let following = authority.mode == MotorAuthority::MODE_FOLLOWING && authority.period_s > 0.0;
        let (true, Some(state), Some(estimate)) = (following, cycle.state, cycle.estimate) else {
            return rows.clear();
        };
        followed = true;
        rows.push((*state, *estimate));
        let window = 2 * ((0.5 * WINDOW_S / authority.period_s).round() as usize).max(2);
        if rows.len() >= window {
            samples.extend(of_window(&rows, cable, &drum));
            rows.clear();
        }
    };
    while let Some(recorded) = reader.next_sample().map_err(Failure::not_now)? {
        tracker.record(&recorded, &mut each);
    }
    tracker.finish(&mut each);
    if !followed {
        return Err(Failure::BadInput(format!(
            "{} has no usable motion: nothing was flown in it, or motor/state, motor/authority or node/estimate was not recorded",
            run.display()
        )));
    }
    Ok(samples)
}

/// Returns the samples of a window in which the node moves.
fn of_window(rows: &[Row], cable: Option<u8>, drum: &dyn Fn(usize) -> Drum) -> Vec<Sample> {
    let moves = rows.iter().all(|(_, estimate)| {
        let [x, y, z] = estimate.velocity_m_s;
        (x * x + y * y + z * z).sqrt() > STANDING_M_S
    });
    let cables = rows.first().filter(|_| moves).map_or(0, |(state, _)| usize::from(state.cable_count));
    let wanted = (0..cables).filter(|index| cable.is_none_or(|cable| usize::from(cable) == index + 1));
    wanted.filter_map(|index| steady(rows, index, drum(index))).collect()
}

/// Returns the means of a window for one cable, if its speed is steady and all values are finite.
fn steady(cycles: &[Row], cable: usize, drum: Drum) -> Option<Sample> {
    let mean = |part: &[Row], of: &dyn Fn(&MotorState, &NodeEstimate) -> f64| {
        part.iter().map(|(state, estimate)| of(state, estimate)).sum::<f64>() / part.len() as f64
    };
    let (early, late) = cycles.split_at(cycles.len() / 2);
    let speed = |state: &MotorState, _: &NodeEstimate| state.velocity_m_s[cable];
    let change = (mean(early, &speed) - mean(late, &speed)).abs();
    if change.is_nan() || change > STEADY_M_S {
        return None;
    }
    if cycles.iter().any(|(state, estimate)| state.fresh[cable] == 0 || estimate.slack[cable] != 0) {
        return None;
    }
    let ratio = drum.radius_ratio(mean(cycles, &|state, _| state.length_m[cable]));
    let sample = Sample {
        reel_in_m_s: -mean(cycles, &speed) / ratio,
        tension_n: mean(cycles, &|_, estimate| estimate.tension_n[cable]) * ratio,
        current_a: mean(cycles, &|state, _| state.current_a[cable]),
    };
    (sample.reel_in_m_s.is_finite() && sample.tension_n.is_finite() && sample.current_a.is_finite()).then_some(sample)
}

/// Runs `nims motor-table`: fits the table and writes it.
///
/// # Errors
/// Runs that cannot be read or do not cover enough speeds and tensions, or a file that already exists or cannot be
/// written.
pub fn run(args: &Args) -> Answer<Output> {
    let out = args.out.as_path();
    if out.exists() {
        let out = out.display();
        return Err(Failure::BadInput(format!("{out} already exists; name a new file or move this one")));
    }
    let mut all = Vec::new();
    for run in &args.runs {
        if !run.exists() {
            return Err(Failure::BadInput(format!(
                "{} does not exist; give a run folder or a run file",
                run.display()
            )));
        }
        all.extend(samples(run, args.cable)?);
    }
    let given = |axis: &Option<Numbers>| axis.as_ref().map(|Numbers(values)| values.clone());
    let (speeds, tensions) = match (given(&args.speeds), given(&args.tensions)) {
        (Some(speeds), Some(tensions)) => (speeds, tensions),
        (speeds, tensions) => {
            let found = covered(&all).map_err(Failure::bad)?;
            (speeds.unwrap_or(found.0), tensions.unwrap_or(found.1))
        }
    };
    let found = fit(&all, &speeds, &tensions).map_err(Failure::bad)?;
    write(args, &speeds, &tensions, &found.currents_a)?;
    let value = json!({
        "speeds_m_s": speeds,
        "tensions_n": tensions,
        "currents_a": found.currents_a,
        "samples": found.samples,
        "rms_residual_a": found.rms_residual_a,
        "file": out,
    });
    let ends = |axis: &[f64]| [axis[0], axis[axis.len() - 1]];
    let ([slowest, fastest], [loosest, tightest]) = (ends(&speeds), ends(&tensions));
    let words = format!(
        "{} speeds from {slowest} to {fastest} m/s, {} tensions from {loosest} to {tightest} N, from {} samples with a residual of \
         {:.3} A (root mean square); written to {}",
        speeds.len(),
        tensions.len(),
        found.samples,
        found.rms_residual_a,
        out.display()
    );
    Ok(Output::new(value, words))
}

fn write(args: &Args, speeds: &[f64], tensions: &[f64], currents: &[Vec<f64>]) -> Answer {
    let list = |values: &[f64], decimals: usize| {
        values.iter().map(|value| format!("{value:.decimals$}")).collect::<Vec<_>>().join(", ")
    };
    let runs: Vec<String> = args
        .runs
        .iter()
        .filter_map(|run| run.file_name())
        .map(|name| format!("{:?}", name.to_string_lossy()))
        .collect();
    let mut text = String::from(
        "# Measured motor current over reel-in speed and cable tension; for `table` in [motor] of a robot file.\n",
    );
    let _ = writeln!(text, "date = \"{}\"", runlog::utc(bus::clock::unix_ns()));
    let _ = writeln!(text, "runs = [{}]", runs.join(", "));
    let _ = writeln!(text, "speeds_m_s = [{}]   # below 0: paying out", list(speeds, 4));
    let _ = writeln!(text, "tensions_n = [{}]", list(tensions, 3));
    let _ = writeln!(text, "currents_a = [   # one row per speed");
    for row in currents {
        let _ = writeln!(text, "    [{}],", list(row, 4));
    }
    text.push_str("]\n");
    let write_failure =
        |why: std::io::Error| Failure::NotNow(format!("{} cannot be written: {why}", args.out.display()));
    // create_new never overwrites a file that was created in the meantime.
    let mut file = std::fs::File::create_new(&args.out).map_err(write_failure)?;
    file.write_all(text.as_bytes()).and_then(|()| file.sync_all()).map_err(write_failure)
}
