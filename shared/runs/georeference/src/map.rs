//! Map of the samples of one sensor.

use messages::{FieldMap, Header, Reading, Sample, name_at, put_text, text_of};
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
    /// Least and greatest believable value.
    range: Option<[f64; 2]>,
}

impl Mapping {
    /// Returns the conversion for a sensor; `None` if the sensor has no map.
    fn new(plane: Plane, sensor: &SensorConfig) -> Option<Self> {
        let value = sensor.section.map_value.unwrap_or(1).checked_sub(1)?;
        let range = sensor.section.range.get(value).copied();
        Some(Self { plane, value, looks_down: sensor.section.looks_down, sigma: sensor.section.sigma, range })
    }

    /// Converts a sample; `None` if the value is missing, invalid or outside the range of the sensor.
    fn grid_sample(&self, sample: &Sample) -> Option<GridSample> {
        if sample.quality == Reading::QUALITY_INVALID || self.value >= usize::from(sample.count) {
            return None;
        }
        let number = *sample.value.get(self.value).filter(|number| number.is_finite())?;
        if self.range.is_some_and(|[low, high]| number < low || number > high) {
            return None;
        }
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

/// Coordinates across the plane of a map, m.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Across {
    low: f64,
    high: f64,
    mean: f64,
    /// Sum of the squared differences from the mean.
    squares: f64,
    count: f64,
}

impl Across {
    const NONE: Self = Self { low: f64::INFINITY, high: f64::NEG_INFINITY, mean: 0.0, squares: 0.0, count: 0.0 };

    /// Adds one (Welford 1962).
    fn add(&mut self, at: f64) {
        (self.low, self.high, self.count) = (self.low.min(at), self.high.max(at), self.count + 1.0);
        let before = at - self.mean;
        self.mean += before / self.count;
        self.squares += before * (at - self.mean);
    }

    fn deviation(&self) -> f64 {
        if self.count > 0.0 { (self.squares / self.count).sqrt() } else { 0.0 }
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
    /// Coordinates of the samples across the plane.
    across: Across,
    names: [String; 2],
    /// The sample whose quantity and unit the map has.
    first: Option<Box<Sample>>,
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
        Ok(Some(Self {
            mapping,
            grid,
            heights_m2: (0.0, 0),
            across: Across::NONE,
            names: Default::default(),
            first: None,
            updated: false,
        }))
    }

    /// Returns an empty map with the same settings on another grid.
    #[must_use]
    pub fn with_grid(&self, grid: GridMap) -> Self {
        Self { grid, heights_m2: (0.0, 0), across: Across::NONE, first: None, updated: false, ..self.clone() }
    }

    /// Adds a sample. One of another quantity or unit begins an empty map, because values of both have no mean.
    pub fn add(&mut self, sample: &Sample) {
        let Some(point) = self.mapping.grid_sample(sample) else { return };
        self.begin_kind(sample);
        self.grid.add(&point);
        self.updated = true;
        if self.mapping.looks_down {
            self.heights_m2.0 += sample.position_std_m[2] * sample.position_std_m[2];
            self.heights_m2.1 += 1;
        } else {
            self.across.add(self.mapping.plane.across(sample.position_m));
        }
    }

    /// Begins the map of the quantity and unit of a sample, unless it is that already.
    fn begin_kind(&mut self, sample: &Sample) {
        let is_same = |first: &Sample| first.quantity == sample.quantity && first.unit == sample.unit;
        if self.first.as_deref().is_some_and(is_same) {
            return;
        }
        let named = |sample: &Sample| {
            [&sample.quantity[..], &sample.unit].map(|names| name_at(&text_of(names), self.mapping.value).to_owned())
        };
        let is_other = self.first.as_deref().is_some_and(|first| named(first) != named(sample));
        if is_other && let Ok(grid) = GridMap::new(*self.grid.spec(), *self.grid.options()) {
            *self = self.with_grid(grid);
        }
        self.names = self.names_from(sample);
        self.first = Some(Box::new(*sample));
    }

    /// Returns quantity and unit of the map from a sample.
    fn names_from(&self, sample: &Sample) -> [String; 2] {
        if self.mapping.looks_down {
            return ["height".to_owned(), "m".to_owned()];
        }
        [&sample.quantity[..], &sample.unit].map(|names| name_at(&text_of(names), self.mapping.value).to_owned())
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

    /// Returns the lowest and the highest coordinate of the samples across the plane, m, if they are farther apart than
    /// a cell is wide, so that the map is that of no single plane; never for a sensor that looks down.
    #[must_use]
    pub fn mixed_m(&self) -> Option<[f64; 2]> {
        let Across { low, high, .. } = self.across;
        (high - low > self.grid.spec().cell_m).then_some([low, high])
    }

    /// Returns the standard deviation common to all cells, in the unit of the map: that of the node's height if the
    /// sensor looks down, else what the field changes over the distance of the samples from their mean plane, if it
    /// changes across the plane as in it.
    #[must_use]
    pub fn common_sigma(&self) -> f64 {
        let (sum, count) = self.heights_m2;
        if count == 0 { self.grid.change_over(self.across.deviation()) } else { (sum / count as f64).sqrt() }
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

#[cfg(test)]
mod tests {
    use super::*;
    use config::{LoggedSensorSection, SensorLoggerSection};

    /// A raster at each of these heights over a field that grows with x and, as much, with z.
    fn map_of(heights_m: &[f64]) -> SensorMap {
        let section = SensorLoggerSection { map_cell_m: Some(0.1), ..SensorLoggerSection::default() };
        let config = LoggerConfig { section, plane: Plane::Level, area_m: [[0.0; 2], [2.0; 2]] };
        let sensor = SensorConfig { section: LoggedSensorSection::default(), time_sigma_s: 0.0 };
        let mut map = SensorMap::new(&config, &sensor, 64).unwrap().unwrap();
        for z in heights_m {
            for i in 0..2000 {
                let (x, y) = (f64::from(i % 100) * 0.02, 0.05 + f64::from(i / 100) * 0.1);
                let mut sample = Sample { count: 1, position_m: [x, y, *z], ..Sample::default() };
                sample.value[0] = 2.0 + 0.5 * x + 0.5 * z + 0.01 * (f64::from(i) * 1.7).sin();
                map.add(&sample);
            }
        }
        map.grid_mut().refresh_all();
        map
    }

    #[test]
    fn another_quantity_or_unit_begins_another_map() {
        let mut map = map_of(&[0.8]);
        let (samples, before) = (map.grid().counts().inside, map.value(10, 10).unwrap().0);
        let mut sample = Sample { count: 1, position_m: [0.21, 0.21, 0.8], ..Sample::default() };
        (sample.value[0], sample.value[1]) = (300.0, 4.0);
        put_text(&mut sample.unit, "K");
        map.add(&sample);
        assert_eq!((map.grid().counts().inside, map.names()[1].as_str()), (1, "K"));
        assert!(samples == 2000 && before < 4.0, "{samples} {before}");
        // Another value has another unit.
        put_text(&mut sample.unit, "K,m");
        map.add(&sample);
        assert_eq!(map.grid().counts().inside, 2);
    }

    #[test]
    fn samples_of_several_heights_are_noticed_and_counted_in_the_deviation() {
        let (level, mixed) = (map_of(&[0.8]), map_of(&[0.3, 0.8, 1.3]));
        assert_eq!((level.mixed_m(), mixed.mixed_m()), (None, Some([0.3, 1.3])));
        assert!(level.common_sigma() < 1e-9);
        let (_, sigma) = mixed.value(10, 10).unwrap();
        let (_, alone) = level.value(10, 10).unwrap();
        // heights differ by 0.41 m RMS from their mean, over which the field changes by 0.14 in a mean direction
        assert!((0.1..0.3).contains(&sigma) && alone < 0.02, "{sigma} {alone}");
    }
}
