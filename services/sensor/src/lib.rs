//! Reads sensors on serial ports and publishes the standard [`messages::Reading`] on `sensor/NAME`.
//!
//! One program, `sensor FILE.toml`, and one process for each sensor. Rangefinders, text lines and Modbus registers
//! differ only in their [`Protocol`]. Opening, losing and finding a port, counting bad frames and marking old values
//! are common to all.
//!
//! # Invariants
//! * A [`Protocol`] and a [`Sensor`] have no clock and no I/O. They accept any bytes, and resynchronise at the next
//!   whole frame.
//! * A bad frame is counted and never published. If a device is silent or gone, the process goes on and repeats the
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

/// What a sensor said.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Frame {
    /// Values, and `Reading::QUALITY_*`.
    Values([f64; VALUES], u8),
    /// Something that was meant as a frame and is none.
    Bad,
}

/// Values of one reading at most.
pub const VALUES: usize = 8;

/// How a device speaks: bytes to values.
pub trait Protocol: std::fmt::Debug + Send {
    /// The line has been opened: what comes next may begin in the middle of a frame.
    fn reset(&mut self);

    /// Takes one byte; says so when it ends a frame.
    fn take(&mut self, byte: u8) -> Option<Frame>;

    /// For a device that speaks when it is asked: the question, and whether the one before was left without an answer.
    fn question(&mut self) -> Option<(&[u8], bool)> {
        None
    }
}
