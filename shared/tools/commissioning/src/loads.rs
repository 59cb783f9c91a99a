//! `nims loads`: stiffness of the cables, routed lengths and weight of the node from measurements with a known weight,
//! written into the robot file.

mod file;
mod robot_file;

pub(crate) use file::{LoadsFile, LoadsSetup, SinkingEntry, WeighingEntry, position};

use crate::config_kind::measurements;
use cable_robot::{Robot, STANDARD_GRAVITY};
use calibration::{Found, Loads};
use command::{Answer, Failure, Output};
use config::{FileKind, RobotFile, file as files, toml_file};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Standard deviations to each side of a 95 % interval.
const SIGMAS_95: f64 = 1.96;

/// `nims loads`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// File of measurements with a known weight; configs/measurements/loads3.toml is a commented example.
    pub measurements: PathBuf,
    /// Write what is determined into the robot file; its comments stay.
    #[arg(long)]
    pub write: bool,
}

/// Runs `nims loads`.
///
/// # Errors
/// A file that cannot be used or written.
pub fn run(args: &Args) -> Answer<Output> {
    let path = args.measurements.as_path();
    let file: LoadsFile = measurements(FileKind::Loads, path)?;
    let folder = files::folder_of(path);
    let found = judge(&file, folder).map_err(|why| Failure::bad(format!("{}: {why}", path.display())))?;
    let mut output = Output::new(found.value.clone(), found.words.trim_end());
    if args.write {
        let written = write(&found)?;
        let robot = found.robot_path.display().to_string();
        output.words += &match written {
            true => format!("\nWritten into {robot}."),
            false => format!("\n{robot} stays as it is."),
        };
        output.value["written"] = json!(written.then_some(robot));
    }
    Ok(output)
}

/// What the measurements determine.
pub(crate) struct LoadsResult {
    /// The result as JSON.
    value: Value,
    /// The result as text lines.
    pub words: String,
    /// The robot file.
    robot_path: PathBuf,
    /// Its text now.
    text: String,
    /// Its text with what is determined; None if nothing is.
    renewed: Option<String>,
}

/// Loads a robot file that loads are measured for, with its text.
///
/// # Errors
/// One sentence: why it cannot be used.
fn load(path: &Path) -> Result<(Robot, RobotFile, String), String> {
    let file = RobotFile::load(path).map_err(|error| error.to_string())?;
    let text = files::read_text(path).map_err(|error| format!("{} cannot be read: {error}", path.display()))?;
    let robot = file.robot().map_err(|error| error.to_string())?;
    if robot.stiffness_n().is_none() {
        return Err(format!(
            "{} has rigid cables; give stiffness_n in [lines], as the data sheet of the cable has it",
            path.display()
        ));
    }
    Ok((robot, file, text))
}

/// The robot of a robot file that loads are measured for.
///
/// # Errors
/// One sentence: why it cannot be used.
pub(crate) fn robot(path: &Path) -> Result<Robot, String> {
    load(path).map(|(robot, ..)| robot)
}

/// Estimates what the measurements determine. `folder`: that of their file.
///
/// # Errors
/// One clause without the file name: what cannot be used.
pub(crate) fn judge(file: &LoadsFile, folder: &Path) -> Result<LoadsResult, String> {
    let robot_path = folder.join(&file.robot);
    let (robot, robot_file, text) = load(&robot_path)?;
    let measured = file.measurements(&robot)?;
    let parts = robot_file.parts().map_err(|error| error.to_string())?;
    let found = calibration::loads(&parts, &measured).map_err(|error| error.to_string())?;
    let renewed = robot_file::renewed(&text, &robot, &found)?;
    if let Some(renewed) = &renewed {
        toml_file::parse::<RobotFile>(renewed, &robot_path).map_err(|error| error.to_string())?;
    }
    Ok(LoadsResult { value: answer(&found), words: words(&robot, &found), robot_path, text, renewed })
}

/// Writes what is determined into the robot file, atomically. Returns false if nothing is.
///
/// # Errors
/// The file changed since it was read, or cannot be written.
fn write(found: &LoadsResult) -> Answer<bool> {
    let Some(renewed) = &found.renewed else { return Ok(false) };
    let path = &found.robot_path;
    let cannot = |why: String| Failure::NotNow(format!("{} cannot be written: {why}", path.display()));
    let now = files::read_text(path).map_err(|error| cannot(error.to_string()))?;
    if now != found.text {
        return Err(cannot("another program changed it; run the command again".to_owned()));
    }
    files::replace(path, renewed).map_err(|error| cannot(error.to_string()))?;
    Ok(true)
}

fn answer(found: &Loads) -> Value {
    let one = |found: &Found| match found {
        Found::Determined { value, std } => json!({ "value": value, "std": std }),
        Found::Undetermined(why) => json!({ "undetermined": why }),
    };
    json!({
        "stiffness_n": one(&found.stiffness_n),
        "routed_change_m": one(&found.routed_change_m),
        "node_weight_n": one(&found.node_weight_n),
    })
}

fn words(robot: &Robot, found: &Loads) -> String {
    let mut text = String::new();
    let mut say = |name: &str, found: &Found, determined: &dyn Fn(f64, f64) -> String| {
        let _ = match found {
            Found::Determined { value, std } => writeln!(text, "{name}: {}", determined(*value, *std)),
            Found::Undetermined(why) => writeln!(text, "{name}: not determined; {why}"),
        };
    };
    let between = |value: f64, std: f64| (value - SIGMAS_95 * std, value + SIGMAS_95 * std);
    say("stiffness EA", &found.stiffness_n, &|value, std| {
        let (low, high) = between(value, std);
        let stated = robot.stiffness_n().unwrap_or_default();
        format!("{value:.0} N, with 95 % confidence {low:.0} to {high:.0} N; the robot file has {stated:.0} N")
    });
    say("routed lengths", &found.routed_change_m, &|value, std| {
        let (low, high) = between(value, std);
        format!("{value:+.2} m on those of the robot file, with 95 % confidence {low:+.2} to {high:+.2} m")
    });
    say("weight of the node", &found.node_weight_n, &|value, std| {
        let (low, high) = between(value, std);
        let stated = robot.net_weight_n();
        format!(
            "{value:.2} N ({:.3} kg), with 95 % confidence {low:.2} to {high:.2} N; the robot file has {stated:.2} N",
            value / STANDARD_GRAVITY
        )
    });
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of a robot, in its own folder.
    fn site(change: impl Fn(String) -> String) -> (tempfile::TempDir, Args) {
        let folder = tempfile::tempdir().unwrap();
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs");
        let at = |name: &str| folder.path().join(name);
        std::fs::copy(configs.join("robots/lab3.toml"), at("lab3.toml")).unwrap();
        let text = std::fs::read_to_string(configs.join("measurements/loads3.toml")).unwrap();
        std::fs::write(at("loads.toml"), change(text.replace("../robots/lab3.toml", "lab3.toml"))).unwrap();
        let args = Args { measurements: at("loads.toml"), write: false };
        (folder, args)
    }

    #[test]
    fn the_example_renews_its_robot_file() {
        let (folder, args) = site(|text| text);
        let read = || std::fs::read_to_string(folder.path().join("lab3.toml")).unwrap();
        let before = read();
        let looked = run(&args).unwrap();
        assert_eq!(read(), before);
        let written = run(&Args { write: true, ..args }).unwrap();
        assert!(written.value["written"].is_string() && written.words.contains("lab3.toml"), "{}", written.words);
        let robot = RobotFile::load(&folder.path().join("lab3.toml")).unwrap();
        // What the example was computed from: 6600 N and 1.25 kg. The intervals contain it, unlike the robot file.
        let number = |key: &str, of: &str| looked.value[key][of].as_f64().unwrap();
        let truth =
            [("stiffness_n", 6600.0, 6000.0), ("node_weight_n", 1.25 * STANDARD_GRAVITY, 1.2 * STANDARD_GRAVITY)];
        for (key, true_n, stated_n) in truth {
            let off_n = (number(key, "value") - true_n).abs();
            assert!(off_n < SIGMAS_95 * number(key, "std") && off_n < (stated_n - true_n).abs(), "{}", looked.value);
        }
        let written = [robot.lines.stiffness_n.unwrap(), robot.robot.node_mass_kg * STANDARD_GRAVITY];
        for (written, (key, ..)) in written.into_iter().zip(truth) {
            assert!((written / number(key, "value") - 1.0).abs() < 1e-3, "{written} {}", looked.value);
        }
        assert!(looked.value["routed_change_m"]["undetermined"].is_string());
        for words in ["stiffness EA", "95 %", "weight of the node", "not determined"] {
            assert!(looked.words.contains(words), "{}", looked.words);
        }
    }

    #[test]
    fn unusable_measurements_are_refused_by_entry() {
        let refused = |from: &str, to: &str| {
            let (_folder, args) = site(|text| {
                assert!(text.contains(from), "{from}");
                text.replacen(from, to, 1)
            });
            let failure = run(&args).err().unwrap();
            assert_eq!(failure.exit_code(), 2);
            failure.to_string()
        };
        assert!(refused("lengths_m = [", "lengths_m = [5.0, ").contains("[[sinking]] number 1"));
        assert!(refused("added_kg = 2.0", "added_kg = 2000.0").contains("2000"));
        assert!(refused("sunk_m = 0.0635", "sunk_m = -0.0635").contains("sinking 1"));
        assert!(refused("up_a = [", "up_a = [0.1, ").contains("weighing 1"));
        assert!(refused("up_a", "upwards_a").contains("upwards_a"));
        assert!(refused("robot = \"lab3.toml", "robot = \"lab4.toml").contains("lab4.toml"));
    }
}
