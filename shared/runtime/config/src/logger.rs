//! `[sensor_logger]`: storage of sensor readings and live maps.

use crate::Problem;
use crate::section::{above, between};

crate::section! {
    /// `[sensor_logger]`.
    pub struct SensorLoggerSection {
        /// Longest time that a reading waits for a newer estimate, s.
        pub wait_s: f64 = 1.0 => between(0.05, 10.0, "s"),
        /// Standard deviation of the time of a reading, s.
        pub time_sigma_s: f64 = 0.002 => between(0.0, 1.0, "s"),
        /// Time between two maps of a sensor, s.
        pub map_period_s: f64 = 1.0 => between(0.2, 60.0, "s"),
        /// Side of a cell of the maps, m. Default: 64 cells across the area.
        pub map_cell_m: Option<f64> = None => between(1e-3, 100.0, "m"),
        /// Distance up to which a sample contributes to the maps, m. Default: four cells.
        pub map_reach_m: Option<f64> = None => between(1e-3, 100.0, "m"),
        /// Two opposite corners of the maps, m; `[x, z]` for a planar robot. Default: the bounding box of the anchors.
        #[serde(deserialize_with = "crate::table_if_given")]
        pub map_area_m: Option<[[f64; 2]; 2]> = None => between(-1000.0, 1000.0, "m").each("two corners"),
        /// Largest number of live maps; further sensors have samples only.
        pub maps: usize = 16,
        /// Excluded sensors (names; a trailing `*` matches any ending).
        pub exclude: Vec<String> = Vec::new(),
        /// Settings of single sensors.
        pub sensor: Vec<LoggedSensorSection> = Vec::new(),
    }
}

crate::section! {
    /// `[[sensor_logger.sensor]]`.
    pub struct LoggedSensorSection {
        /// NAME of its channel `sensor/NAME`.
        pub name: String = String::new(),
        /// Time from the measurement to the `stamp_ns` of its reading, s. Default: from `oldest_input_ns` of the
        /// reading.
        pub latency_s: Option<f64> = None => between(0.0, 10.0, "s"),
        /// Standard deviation of the time of its readings, s. Default: that of `[sensor_logger]`.
        pub time_sigma_s: Option<f64> = None => between(0.0, 1.0, "s"),
        /// Position of the sensor relative to the node, m. Default: as in its readings, otherwise zero.
        #[serde(deserialize_with = "crate::exactly_if_given")]
        pub lever_m: Option<[f64; 3]> = None => between(-10.0, 10.0, "m").each("coordinates"),
        /// For readings of a custom type: the numeric fields that are values, at most eight. Default: the first
        /// floating-point fields, or the first numbers if it has none.
        pub fields: Vec<String> = Vec::new(),
        /// Number of the value in the map, from 1; 0: no map. Default 1.
        pub map_value: Option<usize> = None => between(0.0, 8.0, ""),
        /// The value is a distance straight down, m; the map then shows the height of the surface.
        pub looks_down: bool = false,
        /// Standard deviation of a value, in its unit. Default: estimated from the scatter of all values.
        pub sigma: Option<f64> = None => above(0.0, 1e6, ""),
        /// Diameter of the area that one reading covers, m.
        pub footprint_m: f64 = 0.0 => between(0.0, 100.0, "m"),
        /// Least and greatest believable value, one pair for each value in order. Values beyond are flagged and not in
        /// the map. Default: any value is believed.
        pub range: Vec<[f64; 2]> = Vec::new(),
    }
}

/// Checks the section.
pub(super) fn check(section: &SensorLoggerSection) -> Result<(), Problem> {
    section.check_ranges("sensor_logger")?;
    for (index, sensor) in section.sensor.iter().enumerate() {
        let here = |problem: Problem| {
            problem.within(&format!("sensor_logger.sensor.{index}"), &format!("the sensor \"{}\"", sensor.name))
        };
        if section.sensor[..index].iter().any(|other| other.name == sensor.name) {
            let sentence = format!(
                "two entries of `sensor_logger.sensor` are called \"{}\"; accepted: each name once",
                sensor.name
            );
            return Err(here(Problem::with_sentence("name", sentence)));
        }
        sensor.check().map_err(here)?;
    }
    Ok(())
}

impl LoggedSensorSection {
    fn check(&self) -> Result<(), Problem> {
        if self.name.is_empty() {
            let sentence = "`sensor_logger.sensor.name` is empty; accepted: NAME of the channel sensor/NAME";
            return Err(Problem::with_sentence("name", sentence));
        }
        self.check_ranges("")?;
        if self.fields.len() > 8 {
            let sentence = format!("the sensor \"{}\" has more than 8 `fields`; accepted: up to 8", self.name);
            return Err(Problem::with_sentence("fields", sentence));
        }
        // A comparison with NaN is false.
        let is_range = |[low, high]: &[f64; 2]| low < high;
        if self.range.len() > 8 || !self.range.iter().all(is_range) {
            let sentence = format!(
                "`range` of the sensor \"{}\" is {:?}; accepted: up to 8 pairs of a least and a greater value",
                self.name, self.range
            );
            return Err(Problem::with_sentence("range", sentence));
        }
        Ok(())
    }
}
