//! `[sensor_logger]`: storage of sensor readings and live maps.

use crate::Problem;
use crate::number::number;
use serde::{Deserialize, Serialize};

/// `[sensor_logger]`.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct SensorLoggerSection {
    /// Longest time that a reading waits for a newer estimate, s.
    pub wait_s: f64,
    /// Standard deviation of the time of a reading, s.
    pub time_sigma_s: f64,
    /// Time between two maps of a sensor, s.
    pub map_period_s: f64,
    /// Side of a cell of the maps, m. Default: 64 cells across the area.
    pub map_cell_m: Option<f64>,
    /// Distance up to which a sample contributes to the maps, m. Default: four cells.
    pub map_reach_m: Option<f64>,
    /// Two opposite corners of the maps, m; `[x, z]` for a planar robot. Default: the bounding box of the anchors.
    #[serde(deserialize_with = "crate::table_if_given")]
    pub map_area_m: Option<[[f64; 2]; 2]>,
    /// Largest number of live maps; further sensors have samples only.
    pub maps: usize,
    /// Excluded sensors (names; a trailing `*` matches any ending).
    pub exclude: Vec<String>,
    /// Settings of single sensors.
    pub sensor: Vec<LoggedSensorSection>,
}

impl Default for SensorLoggerSection {
    fn default() -> Self {
        Self {
            wait_s: 1.0,
            time_sigma_s: 0.002,
            map_period_s: 1.0,
            map_cell_m: None,
            map_reach_m: None,
            map_area_m: None,
            maps: 16,
            exclude: Vec::new(),
            sensor: Vec::new(),
        }
    }
}

/// `[[sensor_logger.sensor]]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct LoggedSensorSection {
    /// NAME of its channel `sensor/NAME`.
    pub name: String,
    /// Time from the measurement to the `stamp_ns` of its reading, s. Default: from `oldest_input_ns` of the reading.
    pub latency_s: Option<f64>,
    /// Standard deviation of the time of its readings, s. Default: that of `[sensor_logger]`.
    pub time_sigma_s: Option<f64>,
    /// Position of the sensor relative to the node, m. Default: as in its readings, otherwise zero.
    #[serde(default, deserialize_with = "crate::exactly_if_given")]
    pub lever_m: Option<[f64; 3]>,
    /// For readings of a custom type: the numeric fields that are values, at most eight. Default: the first
    /// floating-point fields, or the first numbers if it has none.
    pub fields: Vec<String>,
    /// Number of the value in the map, from 1; 0: no map. Default 1.
    pub map_value: Option<usize>,
    /// The value is a distance straight down, m; the map then shows the height of the surface.
    pub looks_down: bool,
    /// Standard deviation of a value, in its unit. Default: estimated from the scatter of all values.
    pub sigma: Option<f64>,
    /// Diameter of the area that one reading covers, m.
    pub footprint_m: f64,
}

/// Checks the ranges of the values.
pub(super) fn check(section: &SensorLoggerSection) -> Result<(), Problem> {
    number("sensor_logger.wait_s", section.wait_s, "0.05 to 10 s", |v| (0.05..=10.0).contains(&v))?;
    number("sensor_logger.time_sigma_s", section.time_sigma_s, "0 to 1 s", |v| (0.0..=1.0).contains(&v))?;
    number("sensor_logger.map_period_s", section.map_period_s, "0.2 to 60 s", |v| (0.2..=60.0).contains(&v))?;
    for (key, value) in [("map_cell_m", section.map_cell_m), ("map_reach_m", section.map_reach_m)] {
        if let Some(value) = value {
            number(&format!("sensor_logger.{key}"), value, "0.001 to 100 m", |v| (1e-3..=100.0).contains(&v))?;
        }
    }
    for value in section.map_area_m.into_iter().flatten().flatten() {
        number("sensor_logger.map_area_m", value, "two corners within 1000 m", |v| v.abs() <= 1000.0)?;
    }
    for (index, sensor) in section.sensor.iter().enumerate() {
        let here = |problem: Problem| {
            problem.within(&format!("sensor_logger.sensor.{index}"), &format!("the sensor \"{}\"", sensor.name))
        };
        if section.sensor[..index].iter().any(|other| other.name == sensor.name) {
            let sentence = format!(
                "two entries of `sensor_logger.sensor` are called \"{}\"; accepted: each name once",
                sensor.name
            );
            return Err(here(Problem::at("name", sentence)));
        }
        sensor.check().map_err(here)?;
    }
    Ok(())
}

impl LoggedSensorSection {
    fn check(&self) -> Result<(), Problem> {
        if self.name.is_empty() {
            let sentence = "`sensor_logger.sensor.name` is empty; accepted: NAME of the channel sensor/NAME";
            return Err(Problem::at("name", sentence));
        }
        if let Some(value) = self.latency_s {
            number("latency_s", value, "0 to 10 s", |v| (0.0..=10.0).contains(&v))?;
        }
        if let Some(value) = self.time_sigma_s {
            number("time_sigma_s", value, "0 to 1 s", |v| (0.0..=1.0).contains(&v))?;
        }
        for value in self.lever_m.into_iter().flatten() {
            number("lever_m", value, "within 10 m", |v| v.abs() <= 10.0)?;
        }
        if let Some(value) = self.sigma {
            number("sigma", value, "above 0, at most 1e6", |v| v > 0.0 && v <= 1e6)?;
        }
        number("footprint_m", self.footprint_m, "0 to 100 m", |v| (0.0..=100.0).contains(&v))?;
        let too_many_fields = self.fields.len() > 8;
        if too_many_fields || self.map_value.is_some_and(|value| value > 8) {
            let sentence = format!(
                "the sensor \"{}\" has more than 8 values; accepted: up to 8 `fields`, `map_value` of 0 to 8",
                self.name
            );
            return Err(Problem::at(if too_many_fields { "fields" } else { "map_value" }, sentence));
        }
        Ok(())
    }
}
