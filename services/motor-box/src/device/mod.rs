//! A sensor on the node with its own port: it measures the truth and uses the real sensor's protocol.

mod line;
mod modbus;
mod tfmini;

use std::collections::VecDeque;

use plant::Plant;
use plant::ground::{Field, Ground};
use serial::Random;

use self::line::Template;
use self::modbus::Slave;
use self::tfmini::Tfmini;
use crate::BoxError;
use crate::wire::Wire;

/// Configuration of a device.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviceConfig {
    /// Name under which programs open its port.
    pub link: std::path::PathBuf,
    /// Baud rate of the wire.
    pub baud: u32,
    /// Period of readings, ns.
    pub period_ns: u64,
    /// Time from the measurement to the first byte of the answer, ns.
    pub latency_ns: u64,
    /// Position on the node, m.
    pub lever_m: [f64; 3],
    /// Standard deviation of its values, in their unit.
    pub noise: f64,
    /// Measurement and protocol.
    pub kind: DeviceKind,
}

/// Measurement and protocol of a device.
#[derive(Debug, Clone, PartialEq)]
pub enum DeviceKind {
    /// Measures the distance straight down to the ground and sends frames continuously.
    Tfmini {
        /// Width of its beam, rad.
        beam_rad: f64,
        /// Resolution, m.
        resolution_m: f64,
    },
    /// Sends text lines continuously.
    Line {
        /// With `{0}`, `{1}` .. for the values.
        template: String,
        /// Field of each value.
        fields: Vec<Field>,
    },
    /// Answers requests for registers.
    Modbus {
        /// Address.
        unit_id: u8,
        /// Register of the first value; each is a float32 in two.
        register: u16,
        /// Field of each value.
        fields: Vec<Field>,
    },
}

#[derive(Debug)]
enum Speech {
    Tfmini(Tfmini),
    Line(Template, Vec<Field>),
    Modbus(Slave, Vec<Field>),
}

/// A device on its wire.
#[derive(Debug)]
pub(crate) struct Device {
    pub wire: Wire,
    config: DeviceConfig,
    speech: Speech,
    random: Random,
    /// Time of the next measurement, ns.
    next_ns: u64,
    /// Measured values and the times at which they are sent, ns.
    measured: VecDeque<(u64, Vec<f64>)>,
}

impl Device {
    /// Creates a device and publishes its port.
    pub fn new(config: DeviceConfig, seed: u64) -> Result<Self, BoxError> {
        let speech = match &config.kind {
            DeviceKind::Tfmini { beam_rad, resolution_m } => {
                Speech::Tfmini(Tfmini { beam_rad: *beam_rad, resolution_m: *resolution_m })
            }
            DeviceKind::Line { template, fields } => Speech::Line(Template::new(template), fields.clone()),
            DeviceKind::Modbus { unit_id, register, fields } => {
                Speech::Modbus(Slave::new(*unit_id, *register), fields.clone())
            }
        };
        Ok(Self {
            wire: Wire::new(&config.link, config.baud, seed)?,
            speech,
            random: Random::new(!seed),
            next_ns: config.period_ns,
            measured: VecDeque::new(),
            config,
        })
    }

    /// Time of the next event that is not caused by a program, ns.
    pub fn next_ns(&self) -> u64 {
        let say_ns = self.measured.front().map_or(u64::MAX, |(at_ns, _)| *at_ns);
        self.next_ns.min(say_ns).min(self.wire.next_ns().unwrap_or(u64::MAX))
    }

    /// True if a measurement is due by `now_ns`.
    pub fn is_due(&self, now_ns: u64) -> bool {
        now_ns >= self.next_ns
    }

    /// Advances to `now_ns`; `plant` places the device.
    pub fn live(&mut self, now_ns: u64, plant: &Plant, ground: &Ground) -> Result<(), BoxError> {
        if self.is_due(now_ns) {
            // Readings missed in a pause are not made up for.
            let missed = (now_ns - self.next_ns) / self.config.period_ns;
            self.next_ns += (missed + 1) * self.config.period_ns;
            let values = self.measure(plant.place_m(self.config.lever_m), ground);
            self.measured.push_back((now_ns + self.config.latency_ns, values));
        }
        self.wire.take_in(now_ns)?;
        while let Some((at_ns, byte)) = self.wire.next_for_units(now_ns) {
            if let Speech::Modbus(slave, _) = &mut self.speech {
                let answer = slave.receive(at_ns, byte);
                self.wire.answer(|wire| wire.push(at_ns, answer));
            }
        }
        while let Some((at_ns, _)) = self.measured.front()
            && *at_ns <= now_ns
            && let Some((at_ns, values)) = self.measured.pop_front()
        {
            match &mut self.speech {
                Speech::Tfmini(tfmini) => {
                    let frame = tfmini.frame(values.first().copied().unwrap_or(f64::NAN));
                    self.wire.answer(|wire| wire.push(at_ns, &frame));
                }
                Speech::Line(template, _) => {
                    let line = template.line(&values);
                    self.wire.answer(|wire| wire.push(at_ns, line.as_bytes()));
                }
                Speech::Modbus(slave, _) => slave.store(&values),
            }
        }
        self.wire.hand_out(now_ns)?;
        Ok(())
    }

    fn measure(&mut self, place_m: [f64; 3], ground: &Ground) -> Vec<f64> {
        let true_values: Vec<f64> = match &self.speech {
            Speech::Tfmini(tfmini) => vec![ground.distance_m(place_m, tfmini.beam_rad)],
            Speech::Line(_, fields) | Speech::Modbus(_, fields) => {
                fields.iter().map(|field| field.value(place_m)).collect()
            }
        };
        true_values.into_iter().map(|value| value + self.config.noise * gaussian(&mut self.random)).collect()
    }
}

/// Draws an approximately normal number with mean 0 and variance 1: the sum of twelve uniform ones.
fn gaussian(random: &mut Random) -> f64 {
    (0..12).map(|_| (random.bits() >> 11) as f64 / (1_u64 << 53) as f64).sum::<f64>() - 6.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_the_size_that_is_asked_for() {
        let mut random = Random::new(7);
        let values: Vec<f64> = (0..10_000).map(|_| gaussian(&mut random)).collect();
        let mean = values.iter().sum::<f64>() / 1e4;
        let variance = values.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / 1e4;
        assert!(mean.abs() < 0.05 && (variance - 1.0).abs() < 0.05, "{mean} {variance}");
    }
}
