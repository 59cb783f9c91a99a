//! Map of the samples of one sensor.

use messages::{FieldMap, Header, Reading, Sample, put_text, text_of};
use survey::SurveyError;
use survey::grid::{GridMap, GridSample};

use crate::{LoggerConfig, Plane, SensorConfig};

/// Conversion of samples to map values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Mapping {
    plane: Plane,
    /// Index of the mapped value, from 0.
    value: usize,
    looks_down: bool,
    sigma: Option<f64>,
}

impl Mapping {
    /// Returns the conversion for a sensor; `None` if the sensor has no map.
    fn new(plane: Plane, sensor: &SensorConfig) -> Option<Self> {
        let value = sensor.section.map_value.unwrap_or(1).checked_sub(1)?;
        Some(Self { plane, value, looks_down: sensor.section.looks_down, sigma: sensor.section.sigma })
    }

    /// Converts a sample; `None` if the value is missing or invalid.
    fn grid_sample(&self, sample: &Sample) -> Option<GridSample> {
        if sample.quality == Reading::QUALITY_INVALID || self.value >= usize::from(sample.count) {
            return None;
        }
        let number = *sample.value.get(self.value)?;
        let value = if self.looks_down { sample.position_m[2] - number } else { number };
        let [xx, yy] = self.plane.project(sample.position_std_m).map(|std_m| std_m * std_m);
        Some(GridSample {
            position_m: self.plane.project(sample.position_m),
            position_covariance_m2: [xx, 0.0, yy],
            value,
            value_sigma: self.sigma,
            stamp_ns: sample.header.stamp_ns,
        })
    }
}

/// Map of one sensor that is updated with each sample.
#[derive(Debug, Clone)]
pub struct SensorMap {
    mapping: Mapping,
    grid: GridMap,
    /// Sum of the variances of the node's height, m², and their count; a sensor that looks down has this height error
    /// in its map.
    heights_m2: (f64, u64),
    names: [String; 2],
    updated: bool,
}

impl SensorMap {
    /// Creates an empty map with at most `side` cells along each side; `None` if the sensor has no map.
    ///
    /// # Errors
    /// An invalid area or cell size.
    pub fn new(config: &LoggerConfig, sensor: &SensorConfig, side: usize) -> Result<Option<Self>, SurveyError> {
        let Some(mapping) = Mapping::new(config.plane, sensor) else { return Ok(None) };
        let spec = config.grid(side)?;
        let grid = GridMap::new(spec, config.options(sensor, spec.cell_m))?;
        Ok(Some(Self { mapping, grid, heights_m2: (0.0, 0), names: Default::default(), updated: false }))
    }

    /// Returns an empty map with the same settings on another grid.
    #[must_use]
    pub fn with_grid(&self, grid: GridMap) -> Self {
        Self { grid, heights_m2: (0.0, 0), updated: false, ..self.clone() }
    }

    /// Adds a sample.
    pub fn add(&mut self, sample: &Sample) {
        let Some(point) = self.mapping.grid_sample(sample) else { return };
        self.grid.add(&point);
        self.updated = true;
        if self.mapping.looks_down {
            self.heights_m2.0 += sample.position_std_m[2] * sample.position_std_m[2];
            self.heights_m2.1 += 1;
        }
        if self.names[0].is_empty() {
            self.names = self.names_from(sample);
        }
    }

    /// Returns quantity and unit of the map from a sample.
    fn names_from(&self, sample: &Sample) -> [String; 2] {
        if self.mapping.looks_down {
            return ["height".to_owned(), "m".to_owned()];
        }
        let word = |text: &[u8]| {
            let text = text_of(text);
            let mut words = text.split(',');
            words.nth(self.mapping.value).or(text.split(',').next_back()).unwrap_or_default().to_owned()
        };
        [word(&sample.quantity), word(&sample.unit)]
    }

    /// Returns quantity and unit of the map; empty before the first sample.
    #[must_use]
    pub fn names(&self) -> &[String; 2] {
        &self.names
    }

    /// Returns the plane of the map.
    #[must_use]
    pub fn plane(&self) -> Plane {
        self.mapping.plane
    }

    /// Returns whether the map shows heights below a sensor that looks down.
    #[must_use]
    pub fn looks_down(&self) -> bool {
        self.mapping.looks_down
    }

    /// Returns the grid.
    #[must_use]
    pub fn grid(&self) -> &GridMap {
        &self.grid
    }

    /// Returns the grid for refreshing.
    pub fn grid_mut(&mut self) -> &mut GridMap {
        &mut self.grid
    }

    /// Returns the standard deviation common to all cells, m: that of the node's height if the sensor looks down, else
    /// 0.
    #[must_use]
    pub fn common_sigma(&self) -> f64 {
        let (sum, count) = self.heights_m2;
        if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
    }

    /// Returns value and standard deviation of a cell.
    #[must_use]
    pub fn value(&self, column: usize, row: usize) -> Option<(f64, f64)> {
        let cell = self.grid.cell(column, row)?;
        let common = self.common_sigma();
        Some((cell.value, (cell.sigma * cell.sigma + common * common).sqrt()))
    }

    /// Returns the position of a sample in the plane of the map, and the value used from it.
    #[must_use]
    pub fn point(&self, sample: &Sample) -> Option<([f64; 2], f64)> {
        self.mapping.grid_sample(sample).map(|point| (point.position_m, point.value))
    }

    /// Fills the message to publish if there are new samples; returns whether it did. The map must have at most
    /// [`FieldMap::SIDE`] cells along each side.
    pub fn publishable(&mut self, into: &mut FieldMap) -> bool {
        let spec = *self.grid.spec();
        if !self.updated || spec.columns > FieldMap::SIDE || spec.rows > FieldMap::SIDE {
            return false;
        }
        self.updated = false;
        self.grid.refresh();
        let counts = self.grid.counts();
        into.header = Header::at(counts.newest_ns);
        (into.origin_m, into.cell_m, into.reach_m) = (spec.origin_m, spec.cell_m, self.grid.options().reach_m);
        (into.samples, into.outside) = (counts.inside, counts.outside);
        (into.columns, into.rows) = (spec.columns as u32, spec.rows as u32);
        let common = self.common_sigma();
        into.value.fill(f32::NAN);
        into.sigma.fill(f32::NAN);
        for (at, cell) in self.grid.cells().iter().enumerate() {
            if let Some(cell) = cell {
                into.value[at] = cell.value as f32;
                into.sigma[at] = (cell.sigma * cell.sigma + common * common).sqrt() as f32;
            }
        }
        put_text(&mut into.quantity, &self.names[0]);
        put_text(&mut into.unit, &self.names[1]);
        true
    }
}
