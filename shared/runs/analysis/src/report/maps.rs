//! Sensor maps for the page.

use super::samples::Sensors;
use crate::map;
use georeference::{LoggerConfig, SensorMap};
use std::collections::BTreeMap;
use std::path::Path;

/// Number of cells along the longer side, a resolution for viewing only.
const CELLS: f64 = 48.0;

/// Computes the maps of the sensors of a run by name, in the area of each sensor; empty without a robot file or without
/// samples along the path.
pub fn maps_of(run: &Path, sensors: &Sensors) -> BTreeMap<String, SensorMap> {
    if sensors.channels().is_empty() {
        return BTreeMap::new();
    }
    let Ok(config) = map::logger_config(run) else { return BTreeMap::new() };
    map::maps_within(run, &config, &areas(sensors, &config), CELLS).unwrap_or_default()
}

/// Returns the area that each sensor covered.
fn areas(sensors: &Sensors, config: &LoggerConfig) -> BTreeMap<String, [[f64; 2]; 2]> {
    let mut areas: BTreeMap<String, [[f64; 2]; 2]> = BTreeMap::new();
    for (channel, sensor) in sensors.channels() {
        let Some((_, name)) = channel.split_once('/') else { continue };
        for (place, _) in sensor.places.points() {
            let point = config.plane.project(*place);
            let area = areas.entry(name.to_owned()).or_insert([point; 2]);
            let [low, high] = area;
            for (k, x) in point.into_iter().enumerate() {
                low[k] = low[k].min(x);
                high[k] = high[k].max(x);
            }
        }
    }
    areas
}
