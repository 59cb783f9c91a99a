//! What a map and its files need to know of all samples of a sensor before the first one is added.

use super::kinds::sensor_of;
use super::merge::Origin;
use georeference::{LoggerConfig, Plane, SensorMap};
use messages::Sample;
use survey::grid::{GridMap, GridSpec};

/// Cell that contains every sample.
const EVERYWHERE: GridSpec = GridSpec { origin_m: [-1e9; 2], cell_m: 2e9, columns: 1, rows: 1 };

/// Samples of one sensor as a whole.
pub(super) struct Extent {
    /// A map of one cell, which selects the samples and shows whether they have a scale; `None` if the sensor has no
    /// map.
    whole: Option<SensorMap>,
    plane: Plane,
    /// Smallest rectangle around the samples of the map, m.
    pub corners_m: Option<[[f64; 2]; 2]>,
    /// Number of samples.
    pub samples: u64,
    /// Number of those that were computed.
    pub computed: u64,
    /// Number of samples of the map.
    pub points: u64,
    /// Largest number of values of a sample.
    pub values: usize,
    /// The first sample.
    pub first: Option<Sample>,
    /// Time of the oldest and of the newest sample, ns.
    pub period_ns: Option<(u64, u64)>,
    /// Sum of the coordinates across the plane, m.
    across_m: f64,
}

impl Extent {
    /// Creates that of no samples.
    pub(super) fn new(config: &LoggerConfig, name: &str) -> Self {
        Self {
            whole: whole(config, name),
            plane: config.plane,
            corners_m: None,
            samples: 0,
            computed: 0,
            points: 0,
            values: 0,
            first: None,
            period_ns: None,
            across_m: 0.0,
        }
    }

    /// Adds a sample.
    pub(super) fn add(&mut self, origin: Origin, sample: &Sample) {
        self.samples += 1;
        self.computed += u64::from(origin == Origin::Computed);
        self.values = self.values.max(usize::from(sample.count).min(sample.value.len()));
        self.first.get_or_insert(*sample);
        let stamp_ns = sample.header.stamp_ns;
        let (oldest, newest) = self.period_ns.get_or_insert((stamp_ns, stamp_ns));
        (*oldest, *newest) = ((*oldest).min(stamp_ns), (*newest).max(stamp_ns));
        self.across_m += self.plane.across(sample.position_m);
        let Some(whole) = &mut self.whole else { return };
        let Some((place, value)) = whole.point(sample) else { return };
        self.points += u64::from(value.is_finite());
        let [low, high] = self.corners_m.get_or_insert([place; 2]);
        for k in 0..2 {
            (low[k], high[k]) = (low[k].min(place[k]), high[k].max(place[k]));
        }
        whole.add(sample);
    }

    /// Returns whether the samples show how large an error may be, see [`GridMap::has_scale`].
    pub(super) fn has_scale(&self) -> bool {
        self.whole.as_ref().is_some_and(|whole| whole.grid().has_scale())
    }

    /// Returns the mean coordinate across the plane, m.
    pub(super) fn mean_across_m(&self) -> f64 {
        self.across_m / self.samples.max(1) as f64
    }

    /// Returns a word for where the samples come from.
    pub(super) fn origin(&self) -> &'static str {
        match self.computed {
            0 => "recorded",
            all if all == self.samples => "computed",
            _ => "recorded and computed",
        }
    }
}

/// Returns the empty map of one cell of a sensor.
fn whole(config: &LoggerConfig, name: &str) -> Option<SensorMap> {
    let sensor = config.sensor(sensor_of(name))?;
    let grid = GridMap::new(EVERYWHERE, config.options(&sensor, EVERYWHERE.cell_m)).ok()?;
    Some(SensorMap::new(config, &sensor, 1).ok()??.with_grid(grid))
}
