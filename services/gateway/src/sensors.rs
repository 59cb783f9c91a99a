//! Sensors that publish through the gateway: readings of declared quantities, and samples of an own message; by whom
//! and how often.

use crate::budget::Budget;
use crate::events::{ClientId, OwnMessage};
use config::PluginSection;
use gateway_protocol::Published;
use messages::{Declaration, Header, Reading, put_text};
use robot_state::Reason;
use robot_state::answers::detail;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Readings that may come at once after a pause.
const BURST: f64 = 2.0;
/// How often connections may take a sensor, per second, and at once: a program that connects for each reading, or that
/// is restarted, is served; one that does nothing else is not.
const TAKES_PER_S: f64 = 1.0;
const TAKES: f64 = 10.0;
/// Largest age of a reading or of a sample, s: an older one would be placed by estimates that are not kept.
const OLDEST_S: f64 = 10.0;
const OLDEST_NS: u64 = (OLDEST_S * 1e9) as u64;
/// Most sensors at once that the system file does not declare.
const UNDECLARED: usize = 16;

/// A declared sensor.
#[derive(Debug)]
struct Sensor {
    section: PluginSection,
    /// The connection that publishes it, since its first reading or its declaration.
    holder: Option<ClientId>,
    /// The message that this connection has declared.
    message: Option<Arc<Declaration>>,
    /// It is in the system file.
    declared: bool,
    budget: Budget,
    takes: Budget,
    accepted: u64,
    refused: u64,
}

/// The declared sensors by name.
#[derive(Debug, Default)]
pub(crate) struct Sensors(BTreeMap<String, Sensor>);

impl Sensors {
    /// The sensors that a system file declares.
    pub(crate) fn new(declared: &[PluginSection]) -> Self {
        let sensor = |section: &PluginSection| (section.name.clone(), Sensor::new(section.clone(), true));
        Self(declared.iter().map(sensor).collect())
    }

    /// Returns whether a plug-in has that name.
    pub(crate) fn declares(&self, name: &str) -> bool {
        self.0.get(name).is_some_and(|sensor| sensor.declared)
    }

    /// Stores the message that a connection declares for its sensor. `may_add`: also for a sensor that the system file
    /// does not declare.
    ///
    /// # Errors
    /// The sensor is not declared or has quantities, another connection has it or connections take it too often; the
    /// message cannot be published.
    #[allow(clippy::result_large_err)] // it is the answer
    pub(crate) fn declare(
        &mut self,
        now_ns: u64,
        client: ClientId,
        (name, message): (&str, &str),
        definition: &[u8],
        may_add: bool,
    ) -> Result<OwnMessage, Reason> {
        if !self.0.contains_key(name) && may_add {
            if self.0.values().filter(|sensor| !sensor.declared).count() >= UNDECLARED {
                let why = format_args!("{UNDECLARED} sensors publish that the system file does not declare; end one");
                return Err(Reason::NotAsked { why: detail(why) });
            }
            let section = PluginSection::undeclared(name).map_err(|why| Reason::NotAsked { why: detail(why) })?;
            self.0.insert(name.to_owned(), Sensor::new(section, false));
        }
        let unknown = || Reason::SensorNotDeclared { sensor: detail(name) };
        let sensor = self.0.get_mut(name).ok_or_else(unknown)?;
        let made = sensor.declare(now_ns, client, message, definition);
        if made.is_err() {
            self.free_undeclared();
        }
        made
    }

    /// Checks a sample of `size` bytes, and makes its header.
    ///
    /// # Errors
    /// The connection has declared no message for the sensor, it comes too often, or it is not of its message.
    #[allow(clippy::result_large_err)] // it is the answer
    pub(crate) fn sample(
        &mut self,
        now_ns: u64,
        client: ClientId,
        name: &str,
        stamp_ns: Option<u64>,
        size: usize,
    ) -> Result<(OwnMessage, Header), Reason> {
        let undeclared = || {
            let why = format_args!("this connection has declared no message of sensor/{name}; send `declare` first");
            Reason::NotAsked { why: detail(why) }
        };
        let sensor = self.0.get_mut(name).filter(|sensor| sensor.holder == Some(client)).ok_or_else(undeclared)?;
        let own = sensor.own().ok_or_else(undeclared)?;
        sensor.check_sample(now_ns, stamp_ns, size, own.message.size())?;
        let stamp_ns = stamp_ns.unwrap_or(now_ns);
        Ok((own, Header { stamp_ns, oldest_input_ns: stamp_ns, ..Header::default() }))
    }

    /// Makes the sample of a reading.
    ///
    /// # Errors
    /// The sensor is not declared, another connection has it, it comes too often, or its values are not those declared.
    #[allow(clippy::result_large_err)] // it is the answer
    pub(crate) fn reading(&mut self, now_ns: u64, client: ClientId, given: &Published) -> Result<Reading, Reason> {
        let unknown = || Reason::SensorNotDeclared { sensor: detail(&given.sensor) };
        let sensor = self.0.get_mut(&given.sensor).ok_or_else(unknown)?;
        if sensor.section.declares_a_message() {
            let why = "the sensor has a message of its own; send samples, or add quantity and unit to its plug-in";
            return Err(Reason::NotAsked { why: detail(why) });
        }
        if sensor.holder.is_some_and(|holder| holder != client) {
            return Err(Reason::SensorTaken { sensor: detail(&given.sensor) });
        }
        let made = sensor.make(now_ns, given);
        if made.is_ok() && sensor.holder.is_none() && !sensor.takes.spend(now_ns) {
            sensor.refused += 1;
            return Err(Reason::SensorTakenTooOften { sensor: detail(&given.sensor) });
        }
        match made {
            Ok(_) => sensor.holder = Some(client),
            Err(_) => sensor.refused += 1,
        }
        made
    }

    /// Frees the sensors of a connection that is gone.
    pub(crate) fn free(&mut self, client: ClientId) {
        for sensor in self.0.values_mut().filter(|sensor| sensor.holder == Some(client)) {
            (sensor.holder, sensor.message) = (None, None);
        }
        self.free_undeclared();
    }

    fn free_undeclared(&mut self) {
        self.0.retain(|_, sensor| sensor.declared || sensor.holder.is_some());
    }
}

impl Sensor {
    fn new(section: PluginSection, declared: bool) -> Self {
        let (budget, takes) = (Budget::new(section.rate_hz, BURST, 0), Budget::new(TAKES_PER_S, TAKES, 0));
        Self { section, holder: None, message: None, declared, budget, takes, accepted: 0, refused: 0 }
    }

    fn own(&self) -> Option<OwnMessage> {
        let (name, rate_hz) = (self.section.name.clone(), self.section.rate_hz);
        self.message.clone().map(|message| OwnMessage { name, message, rate_hz })
    }

    #[allow(clippy::result_large_err)] // it is the answer
    fn declare(
        &mut self,
        now_ns: u64,
        client: ClientId,
        message: &str,
        definition: &[u8],
    ) -> Result<OwnMessage, Reason> {
        let name = detail(&self.section.name);
        let refuse = |why: &str| Err(Reason::NotAsked { why: detail(why) });
        if !self.section.declares_a_message() {
            return refuse(
                "the system file names the quantities of this sensor; publish readings, or remove quantity and unit there",
            );
        }
        if self.holder.is_some_and(|holder| holder != client) {
            return Err(Reason::SensorTaken { sensor: name });
        }
        if self.message.is_some() {
            return refuse("this connection has declared the message of the sensor already; open another connection");
        }
        // Before the message is read: that takes time.
        if !self.takes.spend(now_ns) {
            return Err(Reason::SensorTakenTooOften { sensor: name });
        }
        let Ok(definition) = std::str::from_utf8(definition) else {
            return refuse("the definition is not UTF-8; send the text of a ROS 2 message");
        };
        match Declaration::new(message, definition) {
            Ok(message) => (self.holder, self.message) = (Some(client), Some(Arc::new(message))),
            Err(error) => return refuse(&error.to_string()),
        }
        self.own().ok_or(Reason::SensorTaken { sensor: name })
    }

    #[allow(clippy::result_large_err)] // it is the answer
    fn check_sample(&mut self, now_ns: u64, stamp_ns: Option<u64>, size: usize, wanted: usize) -> Result<(), Reason> {
        if size != wanted {
            let why = format_args!("the sample has {size} bytes; accepted: {wanted}, as its message has");
            return Err(Reason::NotAsked { why: detail(why) });
        }
        if stamp_ns.is_some_and(|stamp_ns| stamp_ns > now_ns || stamp_ns + OLDEST_NS < now_ns) {
            let why = format_args!("stamp_ns is not of the last {OLDEST_S} s; accepted: CLOCK_MONOTONIC, ns");
            return Err(Reason::NotAsked { why: detail(why) });
        }
        if !self.budget.spend(now_ns) {
            return Err(Reason::ReadingsTooOften { rate_hz: self.section.rate_hz });
        }
        Ok(())
    }

    #[allow(clippy::result_large_err)] // it is the answer
    fn make(&mut self, now_ns: u64, given: &Published) -> Result<Reading, Reason> {
        let declared = self.section.quantity.len();
        if given.values.len() != declared {
            let given = given.values.len();
            let why = format_args!("the reading has {given} values; accepted: {declared}, as the system file declares");
            return Err(Reason::NotAsked { why: detail(why) });
        }
        let latency_s = given.age_s.unwrap_or(0.0);
        if !(0.0..=OLDEST_S).contains(&latency_s) {
            let why = format_args!("age_s is {latency_s}; accepted: 0 to {OLDEST_S} s");
            return Err(Reason::NotAsked { why: detail(why) });
        }
        if !self.budget.spend(now_ns) {
            return Err(Reason::ReadingsTooOften { rate_hz: self.section.rate_hz });
        }
        self.accepted += 1;
        let mut reading = Reading {
            value: [f64::NAN; 8],
            latency_s,
            lever_m: self.section.lever_m,
            frames: self.accepted,
            bad_frames: self.refused,
            count: declared as u8,
            quality: given.quality.number(),
            ..Reading::default()
        };
        // A value that is null is one that the device does not report.
        for (value, given) in reading.value.iter_mut().zip(&given.values) {
            *value = given.unwrap_or(f64::NAN);
        }
        (reading.header.stamp_ns, reading.header.oldest_input_ns) =
            (now_ns, now_ns.saturating_sub((latency_s * 1e9) as u64));
        put_text(&mut reading.quantity, &self.section.quantity.join(","));
        put_text(&mut reading.unit, &self.section.unit.join(","));
        Ok(reading)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gateway_protocol::ReadingQuality;
    use messages::text_of;

    const SECOND: u64 = 1_000_000_000;

    fn sensors() -> Sensors {
        Sensors::new(&[PluginSection {
            name: "soil".to_owned(),
            quantity: vec!["moisture".to_owned(), "temperature".to_owned()],
            unit: vec!["%".to_owned(), "°C".to_owned()],
            rate_hz: 4.0,
            lever_m: [0.0, 0.0, -0.5],
            ..PluginSection::default()
        }])
    }

    fn published(values: &[Option<f64>]) -> Published {
        Published {
            sensor: "soil".to_owned(),
            values: values.to_vec(),
            quality: ReadingQuality::Good,
            age_s: Some(0.5),
        }
    }

    #[test]
    fn a_reading_has_the_declared_names_and_the_time_of_its_arrival() {
        let reading = sensors().reading(9 * SECOND, 1, &published(&[Some(41.5), None])).unwrap();
        assert_eq!((reading.value[0], reading.count, reading.lever_m), (41.5, 2, [0.0, 0.0, -0.5]));
        assert!(reading.value[1].is_nan());
        assert_eq!((reading.header.stamp_ns, reading.header.oldest_input_ns), (9 * SECOND, 8_500_000_000));
        assert_eq!(
            (text_of(&reading.quantity), text_of(&reading.unit)),
            ("moisture,temperature".into(), "%,°C".into())
        );
    }

    #[test]
    fn only_what_is_declared_passes_at_its_rate_from_one_connection() {
        let mut sensors = sensors();
        let good = published(&[Some(1.0), Some(2.0)]);
        let mut code = |now_ns, client, given: &Published| {
            sensors.reading(now_ns, client, given).map_or_else(|reason| reason.code(), |_| 0)
        };
        assert_eq!(code(SECOND, 1, &Published { sensor: "other".to_owned(), ..good.clone() }), 465);
        assert_eq!(code(SECOND, 1, &published(&[Some(1.0)])), 456);
        assert_eq!(code(SECOND, 1, &Published { age_s: Some(-1.0), ..good.clone() }), 456);
        assert_eq!(code(SECOND, 1, &Published { age_s: Some(f64::NAN), ..good.clone() }), 456);
        // Four a second after two at once.
        let passed = (0..100).filter(|_| code(SECOND, 1, &good) == 0).count();
        let later = (1..=100).filter(|step| code(SECOND + step * SECOND / 100, 1, &good) == 0).count();
        assert_eq!((passed, later, code(2 * SECOND, 1, &good)), (2, 4, 467));
        assert_eq!(code(9 * SECOND, 2, &good), 466);
        sensors.free(2);
        assert!(sensors.reading(9 * SECOND, 2, &good).is_err());
        sensors.free(1);
        assert!(sensors.reading(9 * SECOND, 2, &good).is_ok());
    }

    #[test]
    fn connections_take_a_sensor_ten_times_at_once_and_then_once_a_second() {
        let mut sensors = sensors();
        let good = published(&[Some(1.0), Some(2.0)]);
        // A connection for each of four readings a second.
        let codes: Vec<u16> = (0..100)
            .map(|client| {
                let given = sensors.reading(SECOND + client * SECOND / 4, client, &good);
                sensors.free(client);
                given.map_or_else(|reason| reason.code(), |_| 0)
            })
            .collect();
        let taken = codes.iter().filter(|code| **code == 0).count();
        assert!((10 + 24..=10 + 25).contains(&taken), "{taken}");
        assert!(codes.iter().all(|code| [0, 473].contains(code)), "{codes:?}");
        // Who keeps the connection is not affected.
        let kept = (0..100).filter(|step| sensors.reading((60 + step) * SECOND, 500, &good).is_ok()).count();
        assert_eq!(kept, 100);
    }
}
