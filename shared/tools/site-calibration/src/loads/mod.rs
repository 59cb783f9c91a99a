//! Stiffness of the cables, routed lengths and weight of the node, from measurements with a known weight.

mod file;
mod robot_file;

pub use file::{LoadsFile, LoadsSetup, SinkingEntry, WeighingEntry, position};

use cable_robot::{Robot, RobotParts, STANDARD_GRAVITY};
use calibration::{Found, Loads};
use config::{RobotFile, toml_file};
use serde_json::{Value, json};

/// Standard deviations to each side of a 95 % interval.
pub const SIGMAS_95: f64 = 1.96;

/// A robot that loads are measured for.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadsRobot {
    robot: Robot,
    parts: RobotParts,
    text: String,
}

impl LoadsRobot {
    /// The robot of a robot file with this text; `name` is for sentences.
    ///
    /// # Errors
    /// One clause: why it cannot be used.
    pub fn new(file: &RobotFile, text: String, name: &str) -> Result<Self, String> {
        let robot = file.robot().map_err(|error| error.to_string())?;
        if robot.stiffness_n().is_none() {
            return Err(say!(
                "{name} has rigid cables; give stiffness_n in [lines], as the data sheet of the cable has it"
            ));
        }
        let parts = file.parts().map_err(|error| error.to_string())?;
        Ok(Self { robot, parts, text })
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// The text of its file.
    pub fn text(&self) -> &str {
        &self.text
    }
}

/// What the measurements determine.
pub struct LoadsResult {
    /// The result as JSON.
    pub value: Value,
    /// The result as text lines.
    pub words: String,
    /// The text of the robot file with what is determined; None if nothing is.
    pub renewed: Option<String>,
}

/// Estimates what the measurements determine.
///
/// # Errors
/// One clause without the file name: what cannot be used.
pub fn judge(file: &LoadsFile, of: &LoadsRobot) -> Result<LoadsResult, String> {
    let measured = file.measurements(&of.robot)?;
    let found = calibration::loads(&of.parts, &measured).map_err(|error| error.to_string())?;
    let renewed = robot_file::renewed(&of.text, &of.robot, &found)?;
    if let Some(renewed) = &renewed {
        toml_file::parse::<RobotFile>(renewed, &file.robot).map_err(|error| error.to_string())?;
    }
    Ok(LoadsResult { value: answer(&found), words: words(&of.robot, &found), renewed })
}

/// Formats the measurements as a file of that name, with an explanatory header.
///
/// # Errors
/// A value that TOML cannot hold.
pub fn file_text(file: &LoadsFile, name: &str) -> Result<String, toml::ser::Error> {
    let body = toml::to_string(file)?;
    Ok(format!(
        "# Measurements with a known weight, written by `nims setup` (which drops comments added here while it continues);\n\
         # `nims loads {name}` reads them. configs/measurements/loads3.toml explains every key.\n\n{body}"
    ))
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
    let between = |value: f64, std: f64| (value - SIGMAS_95 * std, value + SIGMAS_95 * std);
    let stiffness = match &found.stiffness_n {
        Found::Undetermined(why) => say!("stiffness EA: not determined; {why}"),
        Found::Determined { value, std } => {
            let ((low, high), stated) = (between(*value, *std), robot.stiffness_n().unwrap_or_default());
            say!(
                "stiffness EA: {value:.0} N, with 95 % confidence {low:.0} to {high:.0} N; the robot file has {stated:.0} N"
            )
        }
    };
    let routed = match &found.routed_change_m {
        Found::Undetermined(why) => say!("routed lengths: not determined; {why}"),
        Found::Determined { value, std } => {
            let (low, high) = between(*value, *std);
            say!(
                "routed lengths: {value:+.2} m on those of the robot file, with 95 % confidence {low:+.2} to {high:+.2} m"
            )
        }
    };
    let weight = match &found.node_weight_n {
        Found::Undetermined(why) => say!("weight of the node: not determined; {why}"),
        Found::Determined { value, std } => {
            let ((low, high), stated) = (between(*value, *std), robot.net_weight_n());
            say!(
                "weight of the node: {value:.2} N ({:.3} kg), with 95 % confidence {low:.2} to {high:.2} N; the robot file has {stated:.2} N",
                value / STANDARD_GRAVITY
            )
        }
    };
    format!("{stiffness}\n{routed}\n{weight}\n")
}
