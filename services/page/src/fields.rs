//! The last ten minutes of every number that the robot publishes, for the charts of browsers that open later.
//!
//! Memory is bounded: a number keeps 1200 values of four bytes, and a bounded number of numbers is kept.

use messages::schema::{Primitive, Schema, Value as Read};
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, VecDeque};

/// Time between two values of a number, ms, and how many are kept: ten minutes.
pub(crate) const STEP_MS: f64 = 500.0;
const ROWS: usize = 1200;
/// Largest number of numbers: 10 MB.
const NUMBERS: usize = 2048;
/// Byte arrays of this length and more are texts.
const TEXT_BYTES: usize = 16;
/// What every sample begins with, which is no measurement.
const HEADER: &str = "header.";

/// The numbers of all channels.
#[derive(Debug, Default)]
pub(crate) struct Fields {
    channels: BTreeMap<String, Channel>,
}

#[derive(Debug)]
struct Channel {
    schema: Schema,
    size: usize,
    /// Names of the numbers, in the order of a row.
    names: Vec<String>,
    /// The newest sample, until it is noted.
    newest: Option<Vec<u8>>,
    /// Times of the rows, ms in time of the server, and the rows one after the other.
    at_ms: VecDeque<f64>,
    rows: VecDeque<f32>,
}

impl Fields {
    /// Begins a channel, or begins it again if its type has changed; without a readable definition it is left out.
    pub(crate) fn define(&mut self, channel: &str, definition: Option<&str>, size: usize) {
        let schema = definition.and_then(|text| Schema::parse(text).ok()).filter(|schema| schema.size() == size);
        let Some(schema) = schema else { return };
        let names = names(&schema);
        if self.channels.get(channel).is_some_and(|known| known.names == names && known.size == size) {
            return;
        }
        self.channels.remove(channel);
        let kept: usize = self.channels.values().map(|channel| channel.names.len()).sum();
        if names.is_empty() || kept + names.len() > NUMBERS {
            return;
        }
        let (at_ms, rows) = (VecDeque::new(), VecDeque::new());
        self.channels.insert(channel.to_owned(), Channel { schema, size, names, newest: None, at_ms, rows });
    }

    /// Takes a sample; the newest one counts.
    pub(crate) fn take(&mut self, channel: &str, sample: &[u8]) {
        if let Some(channel) = self.channels.get_mut(channel).filter(|known| known.size == sample.len()) {
            channel.newest = Some(sample.to_vec());
        }
    }

    /// Adds a row to each channel that has published since the last one.
    pub(crate) fn note(&mut self, now_ms: f64) {
        for channel in self.channels.values_mut() {
            let Some(sample) = channel.newest.take() else { continue };
            if channel.at_ms.len() >= ROWS {
                channel.at_ms.pop_front();
                channel.rows.drain(..channel.names.len());
            }
            channel.at_ms.push_back(now_ms);
            let numbers =
                channel.schema.fields().iter().filter(|field| is_number(&field.path, field)).flat_map(|field| {
                    Read::read(field, &sample)
                        .into_iter()
                        .flat_map(|value| value.numbers())
                        .map(|number| number.as_f64() as f32)
                });
            channel.rows.extend(numbers);
        }
    }

    /// The channels with the names of their numbers.
    pub(crate) fn told(&self) -> Value {
        let rows = self.channels.iter().map(|(name, channel)| (name.clone(), json!(channel.names)));
        rows.collect::<Map<_, _>>().into()
    }

    /// The values of a number after an instant, with their times, both in the order of time.
    pub(crate) fn series(&self, channel: &str, name: &str, after_ms: f64) -> Option<(Vec<f64>, Vec<Option<f32>>)> {
        let channel = self.channels.get(channel)?;
        let (column, width) = (channel.names.iter().position(|own| own == name)?, channel.names.len());
        let first = channel.at_ms.iter().position(|at_ms| *at_ms > after_ms).unwrap_or(channel.at_ms.len());
        let value = |row: usize| channel.rows.get(row * width + column).copied().filter(|value| value.is_finite());
        let times = channel.at_ms.range(first..).copied().collect();
        Some((times, (first..channel.at_ms.len()).map(value).collect()))
    }
}

fn names(schema: &Schema) -> Vec<String> {
    let fields = schema.fields().iter().filter(|field| is_number(&field.path, field));
    let all = fields.flat_map(|field| match field.count {
        Some(count) => (1..=count).map(|at| format!("{} {at}", field.path)).collect(),
        None => vec![field.path.clone()],
    });
    all.collect()
}

fn is_number(path: &str, field: &messages::schema::SchemaField) -> bool {
    let is_text = field.primitive == Primitive::Uint8 && field.count.is_some_and(|count| count >= TEXT_BYTES);
    let name = path.rsplit('.').next().unwrap_or(path);
    let is_padding = name.strip_prefix("pad").is_some_and(|rest| rest.bytes().all(|byte| byte.is_ascii_digit()));
    !is_text && !is_padding && !path.starts_with(HEADER)
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::ros::Payload;
    use messages::{Header, MotorState};

    fn state(seq: u64) -> MotorState {
        let header = Header { seq, ..Header::default() };
        MotorState { header, length_m: [seq as f64; 8], ..MotorState::default() }
    }

    #[test]
    fn ten_minutes_of_each_number_are_kept_in_bounded_memory() {
        let mut fields = Fields::default();
        fields.define("motor/state", Some(MotorState::schema()), size_of::<MotorState>());
        fields.define("other", None, 8);
        let told = fields.told();
        let names = told["motor/state"].as_array().unwrap();
        assert!(names.contains(&json!("length_m 3")) && told.get("other").is_none(), "{told}");
        assert!(!names.iter().any(|name| name.as_str().unwrap().starts_with(HEADER)), "{told}");
        for row in 0..ROWS as u64 + 10 {
            fields.take("motor/state", bytemuck::bytes_of(&state(row)));
            fields.note(row as f64 * STEP_MS);
            // Without a new sample there is no row.
            fields.note(row as f64 * STEP_MS + 1.0);
        }
        let (times, values) = fields.series("motor/state", "length_m 3", -1.0).unwrap();
        assert_eq!((times.len(), values[0], values[ROWS - 1]), (ROWS, Some(10.0), Some(ROWS as f32 + 9.0)));
        let (times, values) = fields.series("motor/state", "length_m 3", times[ROWS - 3]).unwrap();
        assert_eq!((times.len(), values.len()), (2, 2));
        assert!(fields.series("motor/state", "length_m 9", 0.0).is_none() && fields.series("x", "y", 0.0).is_none());
        // The same type again keeps what was; a sample of another size is no sample.
        fields.define("motor/state", Some(MotorState::schema()), size_of::<MotorState>());
        fields.take("motor/state", &[0; 8]);
        fields.note(1e9);
        assert_eq!(fields.series("motor/state", "length_m 3", -1.0).unwrap().0.len(), ROWS);
    }
}
