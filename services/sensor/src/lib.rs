//! Reads sensors on serial ports and publishes the standard [`messages::Reading`] on `sensor/NAME`.
//!
//! One program, `sensor FILE.toml`, and one process for each sensor. Rangefinders, text lines and Modbus registers
//! differ only in their [`Protocol`]. Opening, losing and finding a port, counting bad frames and marking old values
//! are common to all.
//!
//! # Invariants
//! * A [`Protocol`] and a [`Sensor`] have no clock and no I/O. They accept any bytes, and resynchronise at the next
//!   whole frame.
//! * A bad frame is counted and never published. If a device is silent or gone, the process continues and repeats the
//!   last value, marked as stale.
#![forbid(unsafe_code)]

mod line;
mod modbus;
mod process;
mod sensor;
mod settings;
mod tfmini;

pub use process::serve;
pub use sensor::Sensor;
pub use settings::SensorFile;

/// A decoded frame of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Frame {
    /// Values, and `Reading::QUALITY_*`.
    Values([f64; VALUES], u8),
    /// A damaged frame.
    Bad,
}

/// Largest number of values of one reading.
pub const VALUES: usize = 8;

/// The protocol of a device: decodes bytes to values.
pub trait Protocol: std::fmt::Debug + Send {
    /// Resets the decoder after the port was opened, which may be in the middle of a frame.
    fn reset(&mut self);

    /// Decodes one byte; returns a frame if the byte completes one.
    fn push(&mut self, byte: u8) -> Option<Frame>;

    /// Returns the next request for a device that must be polled, and whether the last request was not answered.
    fn request(&mut self) -> Option<(&[u8], bool)> {
        None
    }
}
