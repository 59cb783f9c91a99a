//! What a sensor says over time, without a clock: readings, bad frames counted, silence marked.

use messages::{Header, Reading, put_text};

use crate::line::Lines;
use crate::modbus::Modbus;
use crate::settings::{SensorFile, Speech};
use crate::tfmini::Tfmini;
use crate::{Frame, Protocol};

/// One sensor.
#[derive(Debug)]
pub struct Sensor {
    protocol: Box<dyn Protocol>,
    /// The last one, and what all have in common.
    reading: Reading,
    latency_ns: u64,
    stale_ns: u64,
    /// When the last reading was given, stale ones included, ns.
    last_ns: u64,
    /// For one that has to be asked: how often, and when it was asked, ns.
    period_ns: u64,
    asked_ns: u64,
}

impl Sensor {
    /// The sensor that a file (as [`SensorFile::load`] checked it) describes, at `now_ns`.
    ///
    /// # Errors
    /// One sentence: the protocol has no such question.
    pub fn new(file: &SensorFile, now_ns: u64) -> Result<Self, String> {
        let protocol: Box<dyn Protocol> = match file.speech() {
            Speech::Tfmini(section) => Box::new(Tfmini::new(section.resolution_m)),
            Speech::Line(section) => Box::new(Lines::new(section, &file.values)),
            Speech::Modbus(section) => Box::new(
                Modbus::new(section, &file.values)
                    .map_err(|error| format!("the registers cannot be asked for: {error}"))?,
            ),
        };
        let (quantities, units) = file.words();
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
        Ok(Self { protocol, reading, latency_ns, stale_ns, last_ns: now_ns, period_ns, asked_ns: 0 })
    }

    /// The line has been opened.
    pub fn connected(&mut self) {
        self.protocol.reset();
    }

    /// What the device has to be asked now, if it has to be asked at all.
    pub fn question(&mut self, now_ns: u64) -> Option<&[u8]> {
        if now_ns < self.asked_ns.saturating_add(self.period_ns) {
            return None;
        }
        let (question, unanswered) = self.protocol.question()?;
        self.asked_ns = now_ns;
        self.reading.bad_frames += u64::from(unanswered);
        Some(question)
    }

    /// Takes a byte that came at `now_ns`; gives a reading when it ends a good frame.
    pub fn take(&mut self, byte: u8, now_ns: u64) -> Option<Reading> {
        let reading = &mut self.reading;
        match self.protocol.take(byte)? {
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

    /// The last reading once more, as stale, if there has been none for too long.
    pub fn look(&mut self, now_ns: u64) -> Option<Reading> {
        if now_ns < self.last_ns.saturating_add(self.stale_ns) {
            return None;
        }
        self.last_ns = now_ns;
        self.reading.quality = Reading::QUALITY_STALE;
        self.reading.header.stamp_ns = now_ns;
        Some(self.reading)
    }

    /// Good readings and bad frames so far.
    #[must_use]
    pub fn counts(&self) -> (u64, u64) {
        (self.reading.frames, self.reading.bad_frames)
    }
}
