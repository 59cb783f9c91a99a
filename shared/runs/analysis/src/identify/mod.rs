//! `nims identify`: delay and lag of the drives, motor constants, friction, the node's mass and, as far as it tells it,
//! the stiffness of the cables from a run.

mod file;
mod findings;
mod page;
mod rows;
mod stiffness;
mod stretch;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use calibration::Found;
use calibration::flight::FlightStiffness;
use command::{Answer, Failure, Output};
use findings::Findings;
use identification::{Identified, Value, identify};
use serde_json::{Value as Json, json};

/// `nims identify`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Run folder or file, with a mission that moves every cable.
    pub run: PathBuf,
    /// Folder for identified.toml and the plots; default: the table alone.
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

/// Runs `nims identify`.
///
/// # Errors
/// A run that cannot be read or says nothing of any cable, or a folder that cannot be written.
pub fn run(args: &Args) -> Answer<Output> {
    let recorded = rows::read(&args.run)?;
    let cables: Vec<Result<Identified, String>> =
        recorded.cables.iter().map(|record| identify(record).map_err(|error| error.to_string())).collect();
    if let Some(Err(error)) = cables.first().filter(|_| cables.iter().all(Result::is_err)) {
        return Err(Failure::BadInput(format!("{} does not determine any drive: {error}", args.run.display())));
    }
    let mass_kg = recorded.robot.as_ref().and_then(|robot| mass(&cables, robot.node_mass_kg));
    let stiffness = stiffness::of(&recorded, &cables);
    let found = Findings { cables, mass_kg, stiffness, used_s: recorded.used_s };
    let mut words = text(&found);
    if let Some(out) = &args.out {
        write(out, &args.run, &recorded, &found)?;
        let _ = write!(words, "\nwritten to {}", out.display());
    }
    Ok(Output::new(value(&found), words))
}

/// The mass by the loads of all cables: the weighted mean of their shares.
fn mass(cables: &[Result<Identified, String>], modelled_kg: f64) -> Option<Value> {
    let shares = cables.iter().flatten().filter_map(|found| found.motor.map(|motor| motor.load_share));
    let (mut weights, mut sum, mut count) = (0.0, 0.0, 0.0);
    let mut all = Vec::new();
    for share in shares {
        let weight = share.sigma.powi(-2);
        (weights, sum, count) = (weights + weight, sum + weight * share.value, count + 1.0);
        all.push(share.value);
    }
    if count < 1.0 {
        return None;
    }
    let mean = sum / weights;
    // Friction of pulleys differs between cables: the mean is no better than their spread says.
    let spread = all.iter().map(|share| (share - mean).powi(2)).sum::<f64>() / count;
    let sigma = (1.0 / weights + spread / (count - 1.0).max(1.0)).sqrt();
    Some(Value { value: mean * modelled_kg, sigma: sigma * modelled_kg })
}

fn pair(value: Value) -> Json {
    json!({ "value": value.value, "sigma": value.sigma })
}

fn value(found: &Findings) -> Json {
    let cables: Vec<Json> = found.cables.iter().map(cable).collect();
    let stiffness_n = stiffness(&found.stiffness);
    json!({
        "used_s": found.used_s, "cables": cables, "node_mass_kg": found.mass_kg.map(pair), "stiffness_n": stiffness_n,
    })
}

fn stiffness(found: &FlightStiffness) -> Json {
    // Both are standard deviations as shares of the stiffness: before the flight, and what it leaves.
    let (before, left) = (calibration::flight::WIDE, found.left);
    match &found.stiffness_n {
        Found::Determined { value, std } => json!({ "value": value, "sigma": std, "left": left, "before": before }),
        Found::Undetermined(why) => json!({ "undetermined": why, "left": left, "before": before }),
    }
}

fn cable(found: &Result<Identified, String>) -> Json {
    let found = match found {
        Ok(found) => found,
        Err(why) => return json!({ "failed": why }),
    };
    let drive = &found.drive;
    let motor = found.motor.map(|motor| {
        json!({
            "resistance_ohm": pair(motor.resistance_ohm), "force_constant_n_a": pair(motor.force_constant_n_a),
            "inertia_kg": pair(motor.inertia_kg), "load_share": pair(motor.load_share),
            "gear_friction": pair(motor.gear_friction), "coulomb_n": pair(motor.coulomb_n),
            "viscous_n_s_m": pair(motor.viscous_n_s_m), "friction_n": pair(motor.friction_n),
            "tension_n": motor.tension_n,
        })
    });
    json!({
        "delay_s": pair(drive.delay_s), "lag_s": pair(drive.lag_s), "total_s": pair(drive.total_s),
        "loop_rad_s": drive.loop_rad_s.map(pair), "residual_m": drive.residual_m, "motor": motor,
    })
}

/// A value and its deviation in the table.
fn cell(value: Value, scale: f64, decimals: usize) -> String {
    format!("{:.decimals$} +- {:.decimals$}", scale * value.value, scale * value.sigma)
}

/// A row of the table: its name, and the value of a cable.
type Row<'a> = (&'a str, &'a dyn Fn(&Identified) -> Option<String>);

fn text(found: &Findings) -> String {
    let rows: [Row<'_>; 10] = [
        ("delay, ms", &|one| Some(cell(one.drive.delay_s, 1e3, 1))),
        ("lag, ms", &|one| Some(cell(one.drive.lag_s, 1e3, 1))),
        ("delay + lag, ms", &|one| Some(cell(one.drive.total_s, 1e3, 1))),
        ("speed loop, rad/s", &|one| one.drive.loop_rad_s.map(|value| cell(value, 1.0, 0))),
        ("length left, mm", &|one| Some(format!("{:.3}", 1e3 * one.drive.residual_m))),
        ("resistance, ohm", &|one| one.motor.map(|motor| cell(motor.resistance_ohm, 1.0, 2))),
        ("force constant, N/A", &|one| one.motor.map(|motor| cell(motor.force_constant_n_a, 1.0, 1))),
        ("inertia, kg", &|one| one.motor.map(|motor| cell(motor.inertia_kg, 1.0, 1))),
        ("friction, N", &|one| one.motor.map(|motor| cell(motor.friction_n, 1.0, 1))),
        ("load / model", &|one| one.motor.map(|motor| cell(motor.load_share, 1.0, 3))),
    ];
    let mut text = format!("from {:.0} s of the run; +- is one standard deviation\n{:<20}", found.used_s, "cable");
    for number in 1..=found.cables.len() {
        let _ = write!(text, "{number:>18}");
    }
    for (name, of) in rows {
        let _ = write!(text, "\n{name:<20}");
        for one in &found.cables {
            let cell = one.as_ref().ok().and_then(of).unwrap_or_else(|| "-".to_owned());
            let _ = write!(text, "{cell:>18}");
        }
    }
    for (number, why) in
        found.cables.iter().enumerate().filter_map(|(index, one)| Some((index + 1, one.as_ref().err()?)))
    {
        let _ = write!(text, "\ncable {number}: {why}");
    }
    if let Some(mass) = found.mass_kg {
        let _ = write!(text, "\nnode with its sensors: {} kg", cell(mass, 1.0, 3));
    }
    let _ = match &found.stiffness.stiffness_n {
        Found::Determined { value, std } => {
            let value = Value { value: *value, sigma: *std };
            write!(text, "\nstiffness of the cables: {} N", cell(value, 1.0, 0))
        }
        Found::Undetermined(why) => write!(text, "\nstiffness of the cables: {why}"),
    };
    text
}

fn write(out: &Path, run: &Path, recorded: &rows::Recorded, found: &Findings) -> Answer {
    let cannot = |why: std::io::Error| Failure::NotNow(format!("{} cannot be written: {why}", out.display()));
    std::fs::create_dir_all(out).map_err(cannot)?;
    std::fs::write(out.join("identified.toml"), file::text(run, found)).map_err(cannot)?;
    page::save(out, recorded, found)
}
