//! The file of measurements with a known weight that `nims loads` reads. Lengths are in m, masses in kg,
//! currents in A; entries count from 1.

use cable_robot::{CableVec, Robot, STANDARD_GRAVITY, kinematics};
use calibration::{LoadMeasurements, Sinking, Weighing};
use config::Point;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Heaviest accepted weight, kg: a person.
const HEAVIEST_KG: f64 = 200.0;

/// The file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoadsFile {
    /// The robot file, relative to the folder of this file.
    pub robot: PathBuf,
    /// Mass of the weight, kg, unless an entry states its own.
    pub added_kg: Option<f64>,
    /// Standard deviation of a sinking, m.
    pub sigma_sunk_m: Option<f64>,
    /// Standard deviation of a mean current, A.
    pub sigma_current_a: Option<f64>,
    /// Standard deviation of the routed lengths of the robot file, m; the same error for all.
    pub sigma_routed_m: Option<f64>,
    /// Sinkings under the weight.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sinking: Vec<SinkingEntry>,
    /// Motions up and down.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub weighing: Vec<WeighingEntry>,
    /// Progress of `nims setup`; absent in a complete file.
    pub setup: Option<LoadsSetup>,
}

/// Progress of the questions about the weight.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoadsSetup {
    /// The open place: a position, m.
    pub position_m: Option<Point>,
    /// Or the straight lengths of its cables, m.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lengths_m: Vec<f64>,
    /// The currents upwards of the open motion, A.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub up_a: Vec<f64>,
    /// There are no further places.
    #[serde(default)]
    pub places_done: bool,
    /// There are no further motions.
    #[serde(default)]
    pub motions_done: bool,
}

/// A weight that was hung on the node while all drums were at rest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SinkingEntry {
    /// Where the node hung before: its position, m.
    pub position_m: Option<Point>,
    /// Or the straight lengths of its cables, m.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lengths_m: Vec<f64>,
    /// Mass of the weight, kg.
    pub added_kg: Option<f64>,
    /// By how much the node sank, m.
    pub sunk_m: f64,
}

/// Mean currents while the node moved up and down through a place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WeighingEntry {
    /// The middle of the motion, m.
    pub position_m: Option<Point>,
    /// Or the straight lengths of its cables, m.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lengths_m: Vec<f64>,
    /// Mass of the weight that hung on the node, kg; 0: none.
    pub added_kg: f64,
    /// Upwards, one per motor, A; positive where it pulls the cable in.
    pub up_a: Vec<f64>,
    /// Downwards, A.
    pub down_a: Vec<f64>,
}

/// Returns a position, m, given as such or by the lengths of the cables.
///
/// # Errors
/// One clause: why there is none.
pub fn position(position_m: Option<&Point>, lengths_m: &[f64], robot: &Robot) -> Result<[f64; 3], String> {
    match (position_m, lengths_m) {
        (Some(at), []) => at.resolve(robot.is_planar()),
        (None, lengths_m) if lengths_m.len() == robot.cable_count() => {
            let found = kinematics::forward_kinematics(robot.anchors(), lengths_m, None);
            found.map(|found| found.position.into()).map_err(|error| say!("lengths_m: {error}"))
        }
        _ => Err(say!(
            "it needs position_m, or lengths_m with one length for each of the {} cables",
            robot.cable_count()
        )),
    }
}

impl LoadsFile {
    /// Converts the file to measurements.
    ///
    /// # Errors
    /// One clause without the file name: which entry cannot be used, and what to do.
    pub fn measurements(&self, robot: &Robot) -> Result<LoadMeasurements, String> {
        let weight_n = |kg: f64, entry: &str| {
            if (0.0..=HEAVIEST_KG).contains(&kg) {
                return Ok(kg * STANDARD_GRAVITY);
            }
            Err(say!("{entry}: added_kg is {kg}; accepted: 0 to {HEAVIEST_KG} kg"))
        };
        let sinking = |(k, entry): (usize, &SinkingEntry)| {
            let name = say!("[[sinking]] number {}", k + 1);
            let kg = entry.added_kg.or(self.added_kg).ok_or_else(|| {
                say!("{name} has no weight; give added_kg, in kg, there or once at the top of the file")
            })?;
            let position_m =
                position(entry.position_m.as_ref(), &entry.lengths_m, robot).map_err(|why| say!("{name}: {why}"))?;
            Ok(Sinking { position_m, added_n: weight_n(kg, &name)?, sunk_m: entry.sunk_m })
        };
        let weighing = |(k, entry): (usize, &WeighingEntry)| {
            let name = say!("[[weighing]] number {}", k + 1);
            let position_m =
                position(entry.position_m.as_ref(), &entry.lengths_m, robot).map_err(|why| say!("{name}: {why}"))?;
            let currents = |a: &[f64]| CableVec::from_slice(a).map_err(|why| say!("{name}: {why}"));
            let added_n = weight_n(entry.added_kg, &name)?;
            Ok(Weighing { position_m, added_n, up_a: currents(&entry.up_a)?, down_a: currents(&entry.down_a)? })
        };
        let usual = LoadMeasurements::default();
        Ok(LoadMeasurements {
            sinkings: self.sinking.iter().enumerate().map(sinking).collect::<Result<_, String>>()?,
            sigma_sunk_m: self.sigma_sunk_m.unwrap_or(usual.sigma_sunk_m),
            weighings: self.weighing.iter().enumerate().map(weighing).collect::<Result<_, String>>()?,
            sigma_current_a: self.sigma_current_a.unwrap_or(usual.sigma_current_a),
            sigma_routed_m: self.sigma_routed_m.unwrap_or(usual.sigma_routed_m),
        })
    }
}
