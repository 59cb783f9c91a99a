//! Sensors on serial ports: what they say becomes the standard [`messages::Reading`] on `sensor/NAME`.
//!
//! One program, `sensor FILE.toml`, and one process for each sensor. Rangefinder, lines of text and Modbus registers differ in their
//! [`Protocol`] and in nothing else, so opening, losing and finding a port, counting bad frames and marking old values stand here once.
//!
//! # Invariants
//! * A [`Protocol`] and a [`Sensor`] have no clock and no I/O; any bytes are taken, and after garbage the next whole frame is understood.
//! * A bad frame is counted and never published. A device that is silent or gone ends nothing: its last value is repeated as stale.
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
