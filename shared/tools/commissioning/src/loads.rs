//! `nims loads`: stiffness of the cables, routed lengths and weight of the node from measurements with a known weight,
//! written into the robot file.

use crate::config_kind::measurements;
use command::{Answer, Failure, Output};
use config::{FileKind, RobotFile, file as files};
use serde_json::json;
use site_calibration::loads::{LoadsFile, LoadsRobot, judge};
use std::path::{Path, PathBuf};

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
    let robot_path = files::folder_of(path).join(&file.robot);
    let bad = |why: String| Failure::bad(format!("{}: {why}", path.display()));
    let robot = robot(&robot_path).map_err(bad)?;
    let found = judge(&file, &robot).map_err(bad)?;
    let mut output = Output::new(found.value.clone(), found.words.trim_end());
    if args.write {
        let written = write(&robot_path, robot.text(), found.renewed.as_deref())?;
        let robot = robot_path.display().to_string();
        output.words += &match written {
            true => format!("\nWritten into {robot}."),
            false => format!("\n{robot} stays as it is."),
        };
        output.value["written"] = json!(written.then_some(robot));
        output.words += &replaced(&robot_path).unwrap_or_default();
    }
    Ok(output)
}

/// Loads the robot file that measurements name.
///
/// # Errors
/// One clause: why it cannot be used.
pub(crate) fn robot(path: &Path) -> Result<LoadsRobot, String> {
    let file = RobotFile::load(path).map_err(|error| error.to_string())?;
    let text = files::read_text(path).map_err(|error| format!("{} cannot be read: {error}", path.display()))?;
    LoadsRobot::new(&file, text, &path.display().to_string())
}

/// What the identified file of the robot file replaces of that which measurements determine.
fn replaced(path: &Path) -> Option<String> {
    const MEASURED: [&str; 2] = ["robot.node_mass_kg", "lines.stiffness_n"];
    let file = RobotFile::load(path).ok()?;
    let keys: Vec<&str> = (file.replaced.iter().map(|one| one.key).filter(|key| MEASURED.contains(key))).collect();
    let named = file.robot.identified.filter(|_| !keys.is_empty())?;
    let keys = keys.join(" and ");
    Some(format!("\n{} takes the place of {keys}; delete from it what was measured now.", named.display()))
}

/// Writes what is determined into the robot file, atomically. Returns false if nothing is.
///
/// # Errors
/// The file changed since it was read, or cannot be written.
fn write(path: &Path, text: &str, renewed: Option<&str>) -> Answer<bool> {
    let Some(renewed) = renewed else { return Ok(false) };
    let cannot = |why: String| Failure::NotNow(format!("{} cannot be written: {why}", path.display()));
    let now = files::read_text(path).map_err(|error| cannot(error.to_string()))?;
    if now != text {
        return Err(cannot("another program changed it; run the command again".to_owned()));
    }
    files::replace(path, renewed).map_err(|error| cannot(error.to_string()))?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cable_robot::STANDARD_GRAVITY;
    use site_calibration::loads::SIGMAS_95;

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
    fn what_the_identified_file_takes_the_place_of_is_stated() {
        let (folder, args) = site(|text| text);
        let (robot, found) = (folder.path().join("lab3.toml"), folder.path().join("found.toml"));
        let text = std::fs::read_to_string(&robot).unwrap();
        std::fs::write(&robot, text.replacen("[robot]", "[robot]\nidentified = \"found.toml\"", 1)).unwrap();
        std::fs::write(&found, "node_mass_kg = 1.21\ndelay_s = 0.03\nlag_s = 0.04\n").unwrap();
        let words = run(&Args { write: true, ..args }).unwrap().words;
        let last = words.lines().last().unwrap();
        assert!(last.contains("found.toml") && last.contains("robot.node_mass_kg"), "{words}");
        assert!(!last.contains("stiffness_n"), "{words}");
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
