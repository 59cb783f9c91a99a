//! Settings of the logger, resolved from the system file.

use cable_robot::Robot;
use config::{LoggedSensorSection, SensorLoggerSection};
use survey::SurveyError;
use survey::grid::{GridOptions, GridSpec};

use crate::Plane;

/// Settings for all sensors, and the overrides for single ones.
#[derive(Debug, Clone, PartialEq)]
pub struct LoggerConfig {
    /// The section of the system file.
    pub section: SensorLoggerSection,
    /// Plane of the maps.
    pub plane: Plane,
    /// Two opposite corners of the maps, m.
    pub area_m: [[f64; 2]; 2],
}

/// Settings of one sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorConfig {
    /// Entry in the system file; defaults if it has none.
    pub section: LoggedSensorSection,
    /// Standard deviation of the time of measurement, s.
    pub time_sigma_s: f64,
}

impl LoggerConfig {
    /// Resolves the settings for a robot.
    #[must_use]
    pub fn from_section(section: &SensorLoggerSection, robot: &Robot) -> Self {
        let plane = if robot.is_planar() { Plane::Upright } else { Plane::Level };
        let anchors = || robot.anchors().iter().map(|anchor| plane.project((*anchor).into()));
        let corner = |from: f64, pick: fn(f64, f64) -> f64| {
            std::array::from_fn(|k| anchors().map(|anchor| anchor[k]).fold(from, pick))
        };
        let mut area_m =
            section.map_area_m.unwrap_or([corner(f64::INFINITY, f64::min), corner(f64::NEG_INFINITY, f64::max)]);
        if plane == Plane::Upright && section.map_area_m.is_none() {
            area_m[0][1] = area_m[0][1].min(robot.ground_m());
        }
        Self { section: section.clone(), plane, area_m }
    }

    /// Returns the settings of a sensor by name; `None` if it is excluded.
    #[must_use]
    pub fn sensor(&self, name: &str) -> Option<SensorConfig> {
        let excluded = self.section.exclude.iter().any(|pattern| match pattern.strip_suffix('*') {
            Some(beginning) => name.starts_with(beginning),
            None => name == pattern,
        });
        if excluded {
            return None;
        }
        let entry = self.section.sensor.iter().find(|sensor| sensor.name == name);
        let section =
            entry.cloned().unwrap_or_else(|| LoggedSensorSection { name: name.to_owned(), ..Default::default() });
        let time_sigma_s = section.time_sigma_s.unwrap_or(self.section.time_sigma_s);
        Some(SensorConfig { section, time_sigma_s })
    }

    /// Returns the grid of live maps with at most `side` cells along each side.
    ///
    /// # Errors
    /// An area without extent.
    pub fn grid(&self, side: usize) -> Result<GridSpec, SurveyError> {
        let [a, b] = self.area_m;
        let low: [f64; 2] = std::array::from_fn(|k| a[k].min(b[k]));
        let high: [f64; 2] = std::array::from_fn(|k| a[k].max(b[k]));
        let longest_m = (high[0] - low[0]).max(high[1] - low[1]);
        let least_m = longest_m / side as f64;
        let cell_m = self.section.map_cell_m.map_or(least_m, |cell_m| cell_m.max(least_m));
        GridSpec::covering(low, high, cell_m)
    }

    /// Returns the map options of a sensor for this cell size.
    #[must_use]
    pub fn options(&self, sensor: &SensorConfig, cell_m: f64) -> GridOptions {
        let options = GridOptions::for_cell(cell_m);
        GridOptions {
            footprint_m: sensor.section.footprint_m,
            reach_m: self.section.map_reach_m.unwrap_or(options.reach_m),
            ..options
        }
    }
}
