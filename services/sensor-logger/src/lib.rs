//! Any sensor's readings with the place where each was taken, and a live map of what they say.
//!
//! A reading arrives late: a sensor takes its time, and so does a serial line. What counts is where the sensor was when the reading was
//! true. So every reading waits until there is an estimate of the node that is newer than it, and gets its place from the two around it.
//! It goes out on `sample/NAME`; and what all samples of a sensor say about the field it measures goes out on `map/NAME`.
//!
//! Invariants:
//! * [`Logger`] and [`SensorMap`] are pure: no clock, no I/O; live ([`process`]) and from old runs alike, with the same result.
//! * A reading becomes one sample or is counted, with the reason ([`Counts`]); none goes missing without a word.
//! * Nothing is allocated per reading: rings and grids are made when a sensor appears.
//! * Nothing depends on it: the robot flies without it, and what it makes can be made again from the run (`nims map`).
#![forbid(unsafe_code)]

mod decode;
mod logger;
mod map;
pub mod process;
mod settings;
mod words;

pub use decode::Decoder;
pub use logger::{Counts, Logger};
pub use map::{Plane, SensorMap};
pub use settings::{LoggerConfig, SensorConfig};
pub use words::complaint;
