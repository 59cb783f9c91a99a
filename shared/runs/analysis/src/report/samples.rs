//! Sensor readings over time and along the path.

use super::trace::{DecimatedPoints, Trace};
use config::{LoggedSensorSection, SensorLoggerSection};
use georeference::{Doubt, Quality, Tally, value_fields};
use messages::schema::{Schema, SchemaField, Value};
use messages::{NodeEstimate, Reading, Sample, name_at, text_of};
use runlog::RecordedSample;
use serde::Serialize;
use std::collections::{BTreeMap, VecDeque};

/// Minimum silence of a sensor that interrupts its curve, s.
const GAP_S: f64 = 5.0;
/// Number of stored estimates for positions at the time of a reading; covers more than the delay of a reading.
const MAX_ESTIMATES: usize = 1024;
/// Maximum number of values per channel: as many as a reading has. Others are counted in [`Sensor::left_out`].
const MAX_VALUES: usize = 8;

/// Data of one channel.
pub struct Sensor {
    /// Curves with quantity and unit, or with the name of the field.
    pub values: Vec<(String, Trace)>,
    /// Number of each of these values in its sample, from 0.
    numbers: Vec<usize>,
    /// Flags of each of these values.
    quality: Vec<Quality>,
    /// Number of samples that repeat no earlier one.
    spoken: u64,
    /// Number of the newest of these that has each of these values, from 1.
    newest: Vec<u64>,
    /// Position of the node, m, and the value that is the first of [`Sensor::values`].
    pub places: DecimatedPoints<([f64; 3], f64)>,
    /// Number of samples.
    pub samples: u64,
    /// Number of samples marked as doubtful or stale.
    pub doubtful: u64,
    /// Number of values that are not in [`Sensor::values`]: those beyond the limit by number and name, and those of
    /// arrays by the number of the first one and the name of the field.
    left_out: BTreeMap<(usize, String), usize>,
    /// Definitions of a custom type by the index of the channel, because a sensor may have another one after its
    /// recorder was restarted.
    definitions: BTreeMap<usize, Definition>,
    /// Its entry in the system file.
    settings: LoggedSensorSection,
}

/// What is read from each sample of a custom type.
#[derive(Default)]
struct Definition {
    /// Offset of the time stamp, bytes; `None` without a header.
    stamp_at: Option<usize>,
    /// The values in the report, each with its index in [`Sensor::values`].
    shown: Vec<(usize, SchemaField)>,
}

/// One kind of flag.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Flag {
    /// Number of flagged places.
    pub count: u64,
    /// Time of the first one, s since the start of the run.
    pub first_s: Option<f64>,
    /// The largest one: of a gap and a flat line its duration, s; of a spike its size, and of values outside the range
    /// their distance from it, in the unit of the value.
    pub largest: f64,
}

/// Flags of one value of a sensor.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Flags {
    /// Silences.
    pub gaps: Flag,
    /// Times with the same value, the last one included.
    pub flat_lines: Flag,
    /// Values far from both neighbours.
    pub spikes: Flag,
    /// Values outside the range in the system file.
    pub outside: Flag,
}

impl Flags {
    fn new(quality: &Quality) -> Self {
        let flag = |doubt: Doubt| {
            let Tally { count, first_ns, largest } = quality.tally(doubt);
            Flag { count, first_s: first_ns.map(|first_ns| first_ns as f64 * 1e-9), largest }
        };
        Self {
            gaps: flag(Doubt::Gap),
            flat_lines: flag(Doubt::Flat),
            spikes: flag(Doubt::Spike),
            outside: flag(Doubt::Range),
        }
    }
}

/// Range of one value of a sensor.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Extremes {
    /// Quantity and unit.
    pub name: String,
    /// Least and greatest value.
    pub range: Option<[f64; 2]>,
    /// Gaps, flat lines, spikes, and values outside the range in the system file.
    pub flags: Flags,
}

/// All channels `sensor/*` and `sample/*`.
#[derive(Default)]
pub struct Sensors {
    channels: BTreeMap<String, Sensor>,
    recent: VecDeque<(u64, [f64; 3])>,
    settings: Vec<LoggedSensorSection>,
}

impl Sensors {
    /// Creates it with the settings of the sensors from the system file.
    #[must_use]
    pub fn new(section: SensorLoggerSection) -> Self {
        Self { settings: section.sensor, ..Self::default() }
    }

    /// Returns the channels by name.
    #[must_use]
    pub fn channels(&self) -> &BTreeMap<String, Sensor> {
        &self.channels
    }

    /// Judges the silence of each sensor at the end of the run, s since its start: one that did not speak again has no
    /// later reading that shows it. Values of an earlier definition, which the last sample does not have, ended with
    /// it.
    pub fn close(&mut self, end_s: f64) {
        let end_ns = (end_s.max(0.0) * 1e9).round() as u64;
        for sensor in self.channels.values_mut() {
            let all = sensor.quality.iter_mut().zip(&sensor.newest);
            let present = all.filter(|(_, newest)| **newest == sensor.spoken);
            present.for_each(|(quality, _)| quality.close(end_ns, &mut |_| ()));
        }
    }

    /// Records the position of the node.
    pub fn node_at(&mut self, estimate: &NodeEstimate) {
        if self.recent.len() == MAX_ESTIMATES {
            self.recent.pop_front();
        }
        self.recent.push_back((estimate.header.stamp_ns, estimate.position_m));
    }

    /// Records a sensor sample.
    pub fn record(&mut self, time_s: f64, recorded: &RecordedSample<'_>) {
        let reading = recorded.decode::<Reading>();
        let sample = recorded.decode::<Sample>();
        let settings = || {
            let (_, name) = recorded.channel.name.split_once('/').unwrap_or_default();
            self.settings.iter().find(|sensor| sensor.name == name).cloned().unwrap_or_default()
        };
        let sensor = self.channels.entry(recorded.channel.name.clone()).or_insert_with(|| Sensor::new(settings()));
        sensor.samples += 1;
        // What a driver repeats is no new value, as for the sensor logger.
        if reading.is_some_and(|reading| reading.quality == Reading::QUALITY_STALE) {
            sensor.doubtful += 1;
            return;
        }
        sensor.spoken += 1;
        let (place, values) = if let Some(reading) = reading {
            sensor.doubtful += u64::from(reading.quality != Reading::QUALITY_GOOD);
            let named = Names::new(&reading.quantity, &reading.unit, reading.count).of(&reading.value);
            (position_at(&self.recent, reading.header.stamp_ns), sensor.shown(named))
        } else if let Some(sample) = sample {
            sensor.doubtful += u64::from(sample.quality != Reading::QUALITY_GOOD);
            let named = Names::new(&sample.quantity, &sample.unit, sample.count).of(&sample.value);
            (Some(sample.position_m), sensor.shown(named))
        } else {
            let (stamp_ns, values) = sensor.read(recorded);
            (stamp_ns.and_then(|stamp_ns| position_at(&self.recent, stamp_ns)), values)
        };
        for (at, value) in values {
            if let (0, Some(place)) = (at, place) {
                sensor.places.add((place, value));
            }
            sensor.newest[at] = sensor.spoken;
            sensor.values[at].1.add(time_s, value);
            sensor.quality[at].add((time_s.max(0.0) * 1e9).round() as u64, value, &mut |_| ());
        }
    }
}

/// Quantities and units of the values of a sample.
struct Names {
    quantities: String,
    units: String,
    count: usize,
}

impl Names {
    fn new(quantities: &[u8], units: &[u8], count: u8) -> Self {
        let (quantities, units) = (text_of(quantities), text_of(units));
        Self { quantities, units, count: usize::from(count).min(MAX_VALUES) }
    }

    /// Returns the values with their names: the quantity and the unit of each.
    fn of(&self, values: &[f64]) -> Vec<(usize, String, f64)> {
        let named = |i: usize| (name_at(&self.quantities, i), name_at(&self.units, i));
        let is_repeated = |i: usize| (0..self.count).any(|other| other != i && named(other) == named(i));
        let numbered = self.count > 1 && self.quantities.split(',').count() < self.count;
        let name = |i: usize| {
            let (quantity, unit) = named(i);
            let quantity = if quantity.is_empty() { "value" } else { quantity };
            let quantity =
                if numbered || is_repeated(i) { format!("{quantity} [{}]", i + 1) } else { quantity.to_owned() };
            if unit.is_empty() { quantity } else { format!("{quantity}, {unit}") }
        };
        values.iter().take(self.count).enumerate().map(|(i, value)| (i, name(i), *value)).collect()
    }
}

impl Sensor {
    fn new(settings: LoggedSensorSection) -> Self {
        Self {
            settings,
            values: Vec::new(),
            numbers: Vec::new(),
            quality: Vec::new(),
            spoken: 0,
            newest: Vec::new(),
            places: DecimatedPoints::default(),
            samples: 0,
            doubtful: 0,
            left_out: BTreeMap::new(),
            definitions: BTreeMap::new(),
        }
    }

    /// Returns quantity and unit of each value with its least and its greatest value.
    #[must_use]
    pub fn extremes(&self) -> Vec<Extremes> {
        let values = self.values.iter().zip(&self.quality);
        let row = |((name, trace), quality): (&(String, Trace), &Quality)| Extremes {
            name: name.clone(),
            range: trace.extremes(),
            flags: Flags::new(quality),
        };
        values.map(row).collect()
    }

    /// Returns the number of values that are in none of the curves and figures.
    #[must_use]
    pub fn left_out(&self) -> usize {
        self.left_out.values().sum()
    }

    /// Returns the time stamp of a sample of a custom type, and its values that are shown, each with its index in
    /// [`Sensor::values`].
    fn read(&mut self, recorded: &RecordedSample<'_>) -> (Option<u64>, Vec<(usize, f64)>) {
        if !self.definitions.contains_key(&recorded.index) {
            // A definition that cannot be read has no values.
            let schema = Schema::parse(&recorded.channel.schema).ok();
            let definition = schema.map(|schema| self.define(&schema)).unwrap_or_default();
            self.definitions.insert(recorded.index, definition);
        }
        let Some(definition) = self.definitions.get(&recorded.index) else { return (None, Vec::new()) };
        let stamp = definition.stamp_at.and_then(|at| recorded.sample.get(at..at + 8)?.try_into().ok());
        let value = |field: &SchemaField| Some(Value::read(field, recorded.sample)?.number()?.as_f64());
        let shown = definition.shown.iter().filter_map(|(at, field)| Some((*at, value(field)?)));
        (stamp.map(u64::from_le_bytes), shown.collect())
    }

    /// Chooses the values of a custom type that are shown, of those that the sensor logger picks the ones without
    /// arrays, and counts the others.
    fn define(&mut self, schema: &Schema) -> Definition {
        let stamp_at = schema.field("header.stamp_ns").map(|field| field.offset);
        let fields = value_fields(schema, &self.settings.fields).or_else(|_| value_fields(schema, &[]));
        let (mut number, mut shown) = (0, Vec::new());
        for field in fields.unwrap_or_default() {
            let own = number;
            number += field.count.unwrap_or(1);
            match field.count {
                Some(count) => _ = self.left_out.insert((own, field.path), count),
                None => shown.extend(self.place(own, field.path.clone()).map(|at| (at, field))),
            }
        }
        Definition { stamp_at, shown }
    }

    /// Returns the values that are shown, each with its index in [`Sensor::values`].
    fn shown(&mut self, named: Vec<(usize, String, f64)>) -> Vec<(usize, f64)> {
        named.into_iter().filter_map(|(number, name, value)| Some((self.place(number, name)?, value))).collect()
    }

    /// Returns the index in [`Sensor::values`] of a value with this number and name. One that is not there is added, or
    /// counted as left out where there is no room.
    fn place(&mut self, number: usize, name: String) -> Option<usize> {
        // Two values may have one name, and another driver may give a value another name.
        let mut known = self.values.iter().zip(&self.numbers);
        let at = known.position(|((known, _), own)| *known == name && *own == number);
        if at.is_some() {
            return at;
        }
        if self.values.len() == MAX_VALUES {
            self.left_out.insert((number, name), 1);
            return None;
        }
        self.values.push((name, Trace::new(GAP_S)));
        self.numbers.push(number);
        self.quality.push(Quality::new(self.settings.range.get(number).copied()));
        self.newest.push(0);
        Some(self.values.len() - 1)
    }
}

/// Returns the position of the node at this time according to the nearest estimate.
fn position_at(estimates: &VecDeque<(u64, [f64; 3])>, stamp_ns: u64) -> Option<[f64; 3]> {
    let at = estimates.partition_point(|(stamp, _)| *stamp < stamp_ns);
    let near = [at.checked_sub(1), Some(at)].into_iter().flatten().filter_map(|at| estimates.get(at));
    near.min_by_key(|(stamp, _)| stamp.abs_diff(stamp_ns)).map(|(_, place)| *place)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A definition of twenty numbers with names that begin so.
    fn definition(prefix: &str) -> Schema {
        let text: String = (0..20).map(|number| format!("float64 {prefix}{number}\n")).collect();
        Schema::parse(&text).expect("a definition")
    }

    #[test]
    fn of_each_sample_only_the_values_that_are_shown_are_read() {
        let mut sensor = Sensor::new(LoggedSensorSection::default());
        // The second one as after a restart of the recorder.
        for _ in 0..2 {
            let shown = sensor.define(&definition("a")).shown;
            assert!(shown.iter().map(|(at, _)| *at).eq(0..MAX_VALUES));
            assert_eq!(sensor.left_out(), 12);
        }
        assert!(sensor.define(&definition("b")).shown.is_empty());
        assert_eq!((sensor.values.len(), sensor.left_out()), (MAX_VALUES, 32));
    }
}
