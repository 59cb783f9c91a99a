//! The parameters that the robot's processes use, as they publish them on `system/config/NAME`; tools only read them.

use std::collections::BTreeMap;

use bus::clock::SECOND_NS;
use bus::{Bus, BusError, Tap};
use messages::{SystemConfig, text_of};
use serde::Serialize;
use serde_json::{Value, json};

/// Channels of the parameters; the rest of the name is that of the process.
const CHANNELS: &str = "system/config/";
/// Time after which every process has delivered its parameters to a new subscriber: two of their heartbeats, ns.
const COMPLETE_NS: u64 = SECOND_NS;
/// Changes by `nims set`, which the processes' own parameters contain too.
const CHANGES: &str = "system/config/nims";

/// A parameter as tools see it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Parameter {
    pub(crate) name: String,
    /// Says that a number without fraction is none of the integers.
    #[serde(rename = "type", skip_serializing_if = "Option::is_none")]
    kind: Option<&'static str>,
    value: Value,
}

/// By name, all parameters.
pub(crate) type Values = BTreeMap<String, Parameter>;

/// Receives the parameters of all processes.
#[derive(Debug)]
pub(crate) struct Parameters {
    taps: BTreeMap<String, Tap>,
    /// By process.
    values: BTreeMap<String, Values>,
    /// When they are complete.
    complete_ns: u64,
    /// Whether the hub does not have them yet.
    changed: bool,
}

impl Parameters {
    /// Begins at `now_ns`.
    pub(crate) fn new(now_ns: u64) -> Self {
        let (taps, values) = (BTreeMap::new(), BTreeMap::new());
        Self { taps, values, complete_ns: now_ns + COMPLETE_NS, changed: true }
    }

    /// Takes what has arrived on the channels of parameters among `channels`. Returns all parameters once they are
    /// complete, but only if some have arrived since, or if they are `awaited`, because comparing them takes long.
    ///
    /// # Errors
    /// Shared memory is damaged.
    pub(crate) fn poll<'a>(
        &mut self,
        bus: &Bus,
        channels: impl Iterator<Item = &'a str>,
        awaited: bool,
        now_ns: u64,
    ) -> Result<Option<Values>, BusError> {
        self.changed |= self.update(bus, channels)?;
        let due = now_ns >= self.complete_ns && (self.changed || awaited);
        self.changed &= !due;
        Ok(due.then(|| self.all()))
    }

    /// Subscribes to the channels of parameters among `channels`, and takes what has arrived. A channel that has no
    /// place for another subscriber is tried again at the next call. Returns whether any has arrived.
    ///
    /// # Errors
    /// Shared memory is damaged.
    fn update<'a>(&mut self, bus: &Bus, channels: impl Iterator<Item = &'a str>) -> Result<bool, BusError> {
        for channel in channels.filter(|channel| channel.starts_with(CHANNELS) && *channel != CHANGES) {
            if !self.taps.contains_key(channel)
                && let Ok(tap) = bus.tap(channel)
            {
                self.taps.insert(channel.to_owned(), tap);
            }
        }
        let mut arrived = false;
        for (channel, tap) in &mut self.taps {
            let process = &channel[CHANNELS.len()..];
            // Another build has another layout; its parameters are not shown.
            while let Some(config) =
                tap.receive(|raw| bytemuck::try_pod_read_unaligned::<SystemConfig>(raw.bytes).ok())?
            {
                if let Some(config) = config {
                    arrived = true;
                    self.values.insert(process.to_owned(), parsed(process, &text_of(&config.parameters)));
                }
            }
        }
        Ok(arrived)
    }

    /// Returns the parameters of all processes.
    fn all(&self) -> Values {
        self.values.values().flat_map(|values| values.clone()).collect()
    }
}

/// Reads TOML; a table becomes a part of the name, after that of the process. What is cut off has no value.
fn parsed(process: &str, text: &str) -> Values {
    let mut values = Values::new();
    if let Ok(table) = text.parse::<toml::Table>() {
        add(process, &toml::Value::Table(table), &mut values);
    }
    values
}

fn add(name: &str, value: &toml::Value, into: &mut Values) {
    if let toml::Value::Table(table) = value {
        return table.iter().for_each(|(key, value)| add(&format!("{name}.{key}"), value, into));
    }
    let kind = match value {
        toml::Value::Float(_) => Some("float64"),
        toml::Value::Array(of) if !of.is_empty() && of.iter().all(toml::Value::is_float) => Some("float64_array"),
        _ => None,
    };
    let value = shown(value);
    // Not a number has no place in JSON, and is shown as a text.
    let kind = kind.filter(|_| value.is_number() || value.as_array().is_some_and(|of| of.iter().all(Value::is_number)));
    into.insert(name.to_owned(), Parameter { name: name.to_owned(), kind, value });
}

fn shown(value: &toml::Value) -> Value {
    match value {
        toml::Value::String(text) => json!(text),
        toml::Value::Integer(number) => json!(number),
        toml::Value::Float(number) if number.is_finite() => json!(number),
        toml::Value::Float(number) => json!(number.to_string()),
        toml::Value::Boolean(truth) => json!(truth),
        toml::Value::Datetime(time) => json!(time.to_string()),
        toml::Value::Array(values) => values.iter().map(shown).collect(),
        toml::Value::Table(table) => table.iter().map(|(key, value)| (key.clone(), shown(value))).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bus::Domain;
    use bytemuck::Zeroable;
    use messages::put_text;

    #[test]
    fn parameters_are_handed_over_if_some_have_arrived_or_are_awaited() {
        let domain = Domain::for_test();
        let bus = Bus::join(&domain, "test").unwrap();
        let mut port = bus.publisher::<SystemConfig>("system/config/estimator").unwrap();
        let mut parameters = Parameters::new(0);
        let mut poll = |now_ns, awaited| {
            let channels = ["system/config/estimator"].into_iter();
            parameters.poll(&bus, channels, awaited, now_ns).unwrap().map(|values| values.len())
        };
        let after = COMPLETE_NS;
        assert_eq!(poll(after - 1, true), None, "not complete yet");
        assert_eq!(poll(after, false), Some(0), "the first time, also if there are none");
        assert_eq!(poll(after, false), None, "nothing has arrived");
        let mut config = SystemConfig::zeroed();
        put_text(&mut config.parameters, "rate_hz = 50.0\n");
        port.send(&mut config).unwrap();
        assert_eq!([poll(after, false), poll(after, false)], [Some(1), None]);
        assert_eq!([poll(after, true), poll(after, false)], [Some(1), None]);
    }

    #[test]
    fn tables_become_names_and_values_keep_their_types() {
        let text = "rate_hz = 50.0\n[motor]\nunits = [128, 129]\nlags_s = [0.5, 1.0]\nname = \"x\"\nlive = true\n\
                    none = nan\n[[port]]\npath = \"a\"\n";
        let values = parsed("motor-io", text);
        let found: Vec<Value> = values.values().map(|value| json!(value)).collect();
        let expected = [
            json!({"name": "motor-io.motor.lags_s", "type": "float64_array", "value": [0.5, 1.0]}),
            json!({"name": "motor-io.motor.live", "value": true}),
            json!({"name": "motor-io.motor.name", "value": "x"}),
            json!({"name": "motor-io.motor.none", "value": "NaN"}),
            json!({"name": "motor-io.motor.units", "value": [128, 129]}),
            json!({"name": "motor-io.port", "value": [{"path": "a"}]}),
            json!({"name": "motor-io.rate_hz", "type": "float64", "value": 50.0}),
        ];
        assert_eq!(found, expected);
        assert_eq!(parsed("x", "a = "), Values::new());
    }
}
