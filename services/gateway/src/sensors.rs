//! Readings of plug-ins: what a declared sensor may publish, by whom and how often.

use crate::budget::Budget;
use crate::events::ClientId;
use config::PluginSection;
use gateway_protocol::Published;
use messages::{Reading, put_text};
use robot_state::Reason;
use robot_state::answers::detail;
use std::collections::BTreeMap;

/// Readings that may come at once after a pause.
const BURST: f64 = 2.0;
/// How often connections may take a sensor, per second, and at once: a program that connects for each reading, or that
/// is restarted, is served; one that does nothing else is not.
const TAKES_PER_S: f64 = 1.0;
const TAKES: f64 = 10.0;
/// Largest age of a reading, s: an older one would be placed by estimates that are not kept.
const OLDEST_S: f64 = 10.0;

/// A declared sensor.
#[derive(Debug)]
struct Sensor {
    section: PluginSection,
    /// The connection that publishes it, since its first reading.
    holder: Option<ClientId>,
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
        let sensor = |section: &PluginSection| Sensor {
            section: section.clone(),
            holder: None,
            budget: Budget::new(section.rate_hz, BURST, 0),
            takes: Budget::new(TAKES_PER_S, TAKES, 0),
            accepted: 0,
            refused: 0,
        };
        Self(declared.iter().map(|section| (section.name.clone(), sensor(section))).collect())
    }

    /// Returns whether a plug-in has that name.
    pub(crate) fn declares(&self, name: &str) -> bool {
        self.0.contains_key(name)
    }

    /// Makes the sample of a reading.
    ///
    /// # Errors
    /// The sensor is not declared, another connection has it, it comes too often, or its values are not those declared.
    #[allow(clippy::result_large_err)] // it is the answer
    pub(crate) fn reading(&mut self, now_ns: u64, client: ClientId, given: &Published) -> Result<Reading, Reason> {
        let unknown = || Reason::SensorNotDeclared { sensor: detail(&given.sensor) };
        let sensor = self.0.get_mut(&given.sensor).ok_or_else(unknown)?;
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
            sensor.holder = None;
        }
    }
}

impl Sensor {
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
