//! Adds the position to the readings of any sensor and maps them, live and from recorded runs.
//!
//! A reading arrives late because of delays in the sensor and the serial port. Its position is that of the sensor at
//! the time of measurement. Each reading therefore waits for a newer estimate of the node and gets its position by
//! interpolation between the two surrounding estimates.
//!
//! Invariants:
//! * [`Logger`] and [`SensorMap`] are pure: no clock, no I/O. The sensor logger runs them live, `nims map` on recorded
//!   runs, with the same result.
//! * Each reading is judged by itself ([`Quality`]), and becomes one sample or is counted with the reason ([`Counts`]).
//! * No allocation per reading: buffers and grids are allocated when a sensor appears.
#![forbid(unsafe_code)]

mod decode;
mod logger;
mod map;
mod plane;
mod quality;
mod settings;
mod text;

pub use decode::{Decoder, value_fields};
pub use logger::{Counts, Logger};
pub use map::SensorMap;
pub use plane::Plane;
pub use quality::{Doubt, Place, Quality, Tally};
pub use settings::{LoggerConfig, SensorConfig};
pub use text::{flag_sentence, unused_readings_sentence};
