//! The last ten minutes of every number that the robot publishes, for the charts of browsers that open later.
//!
//! Memory is bounded: a number keeps 1200 values of four bytes, and a bounded number of numbers is kept. A channel that
//! has been silent for ten minutes gives its place to another one, and takes one again with its next sample.

use messages::schema::{Primitive, Schema, Value as Read};
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, VecDeque};

/// Time between two values of a number, ms, and how many are kept: ten minutes.
pub(crate) const STEP_MS: f64 = 500.0;
const ROWS: usize = 1200;
const KEPT_MS: f64 = ROWS as f64 * STEP_MS;
/// Largest number of numbers: 10 MB; of one channel, so that none takes the places of all others; and of definitions.
const NUMBERS: usize = 2048;
const NUMBERS_OF_CHANNEL: usize = 256;
const DEFINITIONS: usize = 256;
/// A longer time without a sample is a silence, over which no line is drawn, ms; of a channel that publishes seldom, so
/// many times its usual time between two samples.
const SILENCE_MS: f64 = 5000.0;
const SILENCE_STEPS: f64 = 4.0;
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
    /// Whether its numbers are kept.
    has_place: bool,
    /// The newest sample, until it is noted.
    newest: Option<Vec<u8>>,
    /// Time of the newest sample, or of the definition until there is one; none until the next note.
    last_ms: Option<f64>,
    /// Time between the newest two samples that were noted, ms.
    step_ms: f64,
    /// Times of the rows, ms in time of the server, and the rows one after the other.
    at_ms: VecDeque<f64>,
    rows: VecDeque<f32>,
}

impl Channel {
    fn new(schema: Schema, size: usize, names: Vec<String>) -> Self {
        let (at_ms, rows) = (VecDeque::new(), VecDeque::new());
        Self { schema, size, names, has_place: false, newest: None, last_ms: None, step_ms: 0.0, at_ms, rows }
    }

    /// Drops what is older than ten minutes, and with the last of it the place.
    fn forget(&mut self, now_ms: f64) {
        let old = self.at_ms.iter().take_while(|at_ms| **at_ms <= now_ms - KEPT_MS).count();
        self.drop_rows(old);
        let last_ms = *self.last_ms.get_or_insert(now_ms);
        if last_ms <= now_ms - KEPT_MS {
            // This gives the memory back too.
            (self.at_ms, self.rows, self.has_place, self.step_ms) = (VecDeque::new(), VecDeque::new(), false, 0.0);
        }
    }

    fn drop_rows(&mut self, count: usize) {
        self.at_ms.drain(..count);
        self.rows.drain(..count * self.names.len());
    }

    fn push(&mut self, at_ms: f64, row: impl Iterator<Item = f32>) {
        self.drop_rows((self.at_ms.len() + 1).saturating_sub(ROWS));
        self.at_ms.push_back(at_ms);
        self.rows.extend(row);
    }

    fn note(&mut self, now_ms: f64, sample: &[u8]) {
        if let Some(last_ms) = self.at_ms.back().copied() {
            let step_ms = now_ms - last_ms;
            if step_ms > SILENCE_MS.max(SILENCE_STEPS * self.step_ms) {
                self.push(last_ms + STEP_MS, std::iter::repeat_n(f32::NAN, self.names.len()));
            }
            self.step_ms = step_ms;
        }
        let fields = self.schema.fields().iter().filter(|field| is_number(&field.path, field));
        let numbers = fields.flat_map(|field| Read::read(field, sample).into_iter().flat_map(|value| value.numbers()));
        let row: Vec<f32> = numbers.take(self.names.len()).map(|number| number.as_f64() as f32).collect();
        self.last_ms = Some(now_ms);
        self.push(now_ms, row.into_iter());
    }
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
        if self.channels.len() >= DEFINITIONS {
            let silent = self.channels.iter().find(|(_, known)| !known.has_place).map(|(name, _)| name.clone());
            let Some(silent) = silent else { return };
            self.channels.remove(&silent);
        }
        if names.is_empty() {
            return;
        }
        let mut made = Channel::new(schema, size, names);
        made.has_place = self.has_room_for(made.names.len());
        self.channels.insert(channel.to_owned(), made);
    }

    fn has_room_for(&self, numbers: usize) -> bool {
        let kept: usize = self.channels.values().filter(|one| one.has_place).map(|one| one.names.len()).sum();
        kept + numbers <= NUMBERS
    }

    /// Takes a sample; the newest one counts.
    pub(crate) fn take(&mut self, channel: &str, sample: &[u8]) {
        if let Some(channel) = self.channels.get_mut(channel).filter(|known| known.size == sample.len()) {
            channel.newest = Some(sample.to_vec());
        }
    }

    /// Adds a row to each channel that has published since the last one, and drops what is older than ten minutes.
    pub(crate) fn note(&mut self, now_ms: f64) {
        let mut kept = 0;
        for channel in self.channels.values_mut() {
            channel.forget(now_ms);
            kept += if channel.has_place { channel.names.len() } else { 0 };
        }
        for channel in self.channels.values_mut() {
            let Some(sample) = channel.newest.take() else { continue };
            if !channel.has_place {
                if kept + channel.names.len() > NUMBERS {
                    continue;
                }
                channel.has_place = true;
                kept += channel.names.len();
            }
            channel.note(now_ms, &sample);
        }
    }

    /// The channels with the names of their numbers.
    pub(crate) fn told(&self) -> Value {
        let kept = self.channels.iter().filter(|(_, channel)| channel.has_place);
        kept.map(|(name, channel)| (name.clone(), json!(channel.names))).collect::<Map<_, _>>().into()
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
    all.take(NUMBERS_OF_CHANNEL).collect()
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
        fields.note((ROWS + 10) as f64 * STEP_MS);
        assert_eq!(fields.series("motor/state", "length_m 3", -1.0).unwrap().0.len(), ROWS - 1);
    }

    /// A channel of so many numbers.
    fn define(fields: &mut Fields, channel: &str, numbers: usize) {
        fields.define(channel, Some(&format!("float64[{numbers}] value")), 8 * numbers);
    }

    #[test]
    fn a_silent_channel_gives_its_memory_and_its_place_back() {
        let mut fields = Fields::default();
        let (many, names) = (NUMBERS / NUMBERS_OF_CHANNEL, |n: usize| format!("sensor/{n}"));
        for n in 0..=many {
            define(&mut fields, &names(n), NUMBERS_OF_CHANNEL + 40);
        }
        let sample = vec![0; 8 * (NUMBERS_OF_CHANNEL + 40)];
        let told = |fields: &Fields| fields.told().as_object().unwrap().keys().cloned().collect::<Vec<_>>();
        assert_eq!(told(&fields), (0..many).map(names).collect::<Vec<_>>());
        assert_eq!(fields.told()["sensor/0"].as_array().unwrap().len(), NUMBERS_OF_CHANNEL);
        fields.note(0.0);
        for n in 0..=many {
            fields.take(&names(n), &sample);
        }
        fields.note(STEP_MS);
        // The last one publishes on, and waits for the place of one that does not.
        for step in 2..=ROWS as u64 + 1 {
            assert_eq!(told(&fields).len(), many);
            fields.take(&names(many), &sample);
            fields.note(step as f64 * STEP_MS);
        }
        assert_eq!(told(&fields), [names(many)]);
        assert!(fields.channels["sensor/0"].rows.capacity() == 0);
        fields.take("sensor/0", &sample);
        fields.note(KEPT_MS + 3.0 * STEP_MS);
        assert_eq!(fields.series("sensor/0", "value 1", 0.0).unwrap().0.len(), 1);
        for n in 0..2 * DEFINITIONS {
            define(&mut fields, &format!("other/{n}"), 200);
        }
        assert_eq!(fields.channels.len(), DEFINITIONS);
    }

    #[test]
    fn no_line_is_drawn_over_a_silence() {
        let mut fields = Fields::default();
        define(&mut fields, "sensor/x", 1);
        let mut publish = |at_ms: f64| {
            fields.take("sensor/x", &at_ms.to_le_bytes());
            fields.note(at_ms);
            let (times, values) = fields.series("sensor/x", "value 1", -1.0).unwrap();
            values.iter().zip(times).filter(|(value, _)| value.is_none()).map(|(_, at)| at).collect::<Vec<_>>()
        };
        assert!(publish(0.0).is_empty() && publish(500.0).is_empty() && publish(1000.0).is_empty());
        assert_eq!(publish(20_000.0), [1500.0]);
        // A channel that publishes each 20 s is not silent.
        assert_eq!(publish(40_000.0), [1500.0]);
        assert_eq!(publish(60_000.0), [1500.0]);
        assert_eq!(publish(200_000.0), [1500.0, 60_500.0]);
    }
}
