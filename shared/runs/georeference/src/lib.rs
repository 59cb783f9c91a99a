//! Readings of any sensor with the place where each was taken, and a map of what they say; live and from recorded runs alike.
//!
//! A reading arrives late: a sensor takes its time, and so does a serial port. What counts is where the sensor was when the reading was
//! true. So every reading waits until there is an estimate of the node that is newer than it, and gets its place from the two around it.
//!
//! Invariants:
//! * [`Logger`] and [`SensorMap`] are pure: no clock, no I/O. The sensor logger runs them live, `nims map` on recorded runs, with the same
//!   result.
//! * A reading becomes one sample or is counted, with the reason ([`Counts`]).
//! * Nothing is allocated per reading: rings and grids are made when a sensor appears.
#![forbid(unsafe_code)]

mod decode;
mod logger;
mod map;
mod plane;
mod settings;
mod text;

pub use decode::Decoder;
pub use logger::{Counts, Logger};
pub use map::SensorMap;
pub use plane::Plane;
pub use settings::{LoggerConfig, SensorConfig};
pub use text::complaint;
