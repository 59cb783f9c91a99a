//! Adds to each reading of a sensor the place where it was taken, and makes a map of the readings; live and from
//! recorded runs.
//!
//! A reading arrives late, delayed by the sensor and the serial port. Its place is where the sensor was when the
//! reading was taken. Every reading therefore waits for an estimate of the node that is newer, and its place is
//! interpolated between the two around it.
//!
//! Invariants:
//! * [`Logger`] and [`SensorMap`] are pure: no clock, no I/O. The sensor logger runs them live, `nims map` on recorded
//!   runs, with the same result.
//! * A reading either becomes one sample or is counted with the reason ([`Counts`]).
//! * Nothing is allocated per reading: rings and grids are allocated when a sensor appears.
#![forbid(unsafe_code)]

mod decode;
mod logger;
mod map;
mod settings;
mod text;

pub use decode::Decoder;
pub use logger::{Counts, Logger};
pub use map::{Plane, SensorMap};
pub use settings::{LoggerConfig, SensorConfig};
pub use text::complaint;
