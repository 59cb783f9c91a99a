//! A sensor over time, without a clock: decodes readings, counts bad frames, and marks stale values.

use messages::{Header, Reading, put_text};

use crate::line::TextLines;
use crate::modbus::Modbus;
use crate::settings::{ProtocolSection, SensorFile};
use crate::tfmini::Tfmini;
use crate::{Frame, Protocol};

/// One sensor.
#[derive(Debug)]
pub struct Sensor {
    protocol: Box<dyn Protocol>,
    /// The last reading, with the fields common to all readings.
    reading: Reading,
    latency_ns: u64,
    stale_ns: u64,
    /// Time of the last reading, stale ones included, ns.
    last_ns: u64,
    /// Time between two requests, ns.
    period_ns: u64,
    /// Time of the last request, ns.
    requested_ns: u64,
}

impl Sensor {
    /// Creates the sensor of a file that [`SensorFile::load`] has checked, at `now_ns`.
    ///
    /// # Errors
    /// The registers cannot be requested: one sentence.
    pub fn new(file: &SensorFile, now_ns: u64) -> Result<Self, String> {
        let protocol: Box<dyn Protocol> = match file.protocol() {
            ProtocolSection::Tfmini(section) => Box::new(Tfmini::new(section.resolution_m)),
            ProtocolSection::Line(section) => Box::new(TextLines::new(section, &file.values)),
            ProtocolSection::Modbus(section) => Box::new(
                Modbus::new(section, &file.values)
                    .map_err(|error| format!("the registers cannot be requested: {error}"))?,
            ),
        };
        let (quantities, units) = file.quantities_and_units();
        let mut reading = Reading {
            value: [f64::NAN; crate::VALUES],
            latency_s: file.latency_s,
            lever_m: file.lever_m,
            count: quantities.len() as u8,
            quality: Reading::QUALITY_STALE,
            ..Reading::default()
        };
        put_text(&mut reading.quantity, &quantities.join(","));
        put_text(&mut reading.unit, &units.join(","));
        let ns = |seconds: f64| (seconds * 1e9) as u64;
        let period_ns = ns(1.0 / file.rate_hz());
        let (latency_ns, stale_ns) = (ns(file.latency_s), ns(file.stale_s));
        Ok(Self { protocol, reading, latency_ns, stale_ns, last_ns: now_ns, period_ns, requested_ns: 0 })
    }

    /// Resets the decoder after the port was opened.
    pub fn connected(&mut self) {
        self.protocol.reset();
    }

    /// Returns the request to send now, for a device that must be polled.
    pub fn request(&mut self, now_ns: u64) -> Option<&[u8]> {
        if now_ns < self.requested_ns.saturating_add(self.period_ns) {
            return None;
        }
        let (request, unanswered) = self.protocol.request()?;
        self.requested_ns = now_ns;
        self.reading.bad_frames += u64::from(unanswered);
        Some(request)
    }

    /// Decodes a byte received at `now_ns`; returns a reading if it completes a good frame.
    pub fn push(&mut self, byte: u8, now_ns: u64) -> Option<Reading> {
        let reading = &mut self.reading;
        match self.protocol.push(byte)? {
            Frame::Bad => {
                reading.bad_frames += 1;
                None
            }
            Frame::Values(values, quality) => {
                reading.frames += 1;
                (reading.value, reading.quality) = (values, quality);
                reading.header = Header::at(now_ns);
                reading.header.oldest_input_ns = now_ns.saturating_sub(self.latency_ns);
                self.last_ns = now_ns;
                Some(*reading)
            }
        }
    }

    /// Returns the last reading, marked as stale, if no reading has arrived for `stale_s`.
    pub fn stale_reading(&mut self, now_ns: u64) -> Option<Reading> {
        if now_ns < self.last_ns.saturating_add(self.stale_ns) {
            return None;
        }
        self.last_ns = now_ns;
        self.reading.quality = Reading::QUALITY_STALE;
        self.reading.header.stamp_ns = now_ns;
        Some(self.reading)
    }

    /// Returns the numbers of good and bad frames so far.
    #[must_use]
    pub fn counts(&self) -> (u64, u64) {
        (self.reading.frames, self.reading.bad_frames)
    }
}
