//! Sensor maps for the page.

use super::samples::Sensors;
use crate::map;
use georeference::SensorMap;
use std::collections::BTreeMap;
use std::path::Path;

/// Computes the maps of the sensors of a run by name, the same as `nims map` does; empty without a robot file or
/// without samples along the path.
pub fn maps_of(run: &Path, sensors: &Sensors) -> BTreeMap<String, SensorMap> {
    if sensors.channels().is_empty() {
        return BTreeMap::new();
    }
    let Ok(config) = map::logger_config(run) else { return BTreeMap::new() };
    map::maps_of_run(run, &config).unwrap_or_default()
}
