//! From readings to maps: estimation of a field from many samples at known positions.
//!
//! [`track`] computes the position of a sensor at the instant of its reading, between two estimates of the node,
//! with its uncertainty. [`grid`] is a regular map of a scalar in the plane with a standard deviation for every
//! cell. It adds one sample at a time, as a live map requires, and [`adaptive`] selects the areas where more
//! samples are most useful.
//!
//! Invariants:
//! * No clock, no I/O, no messages: times are numbers, and the same samples in the same order give the same bits.
//! * Adding a sample, refreshing the map and a track do not allocate.
//! * Unknown values are `None`, never a special number.
//!
//! ```
//! use survey::grid::{GridMap, GridOptions, GridSample, GridSpec};
//!
//! let spec = GridSpec::covering([0.0, 0.0], [1.0, 1.0], 0.1)?;
//! let mut map = GridMap::new(spec, GridOptions::default())?;
//! for i in 0..100 {
//!     let (x, y) = (0.01 * f64::from(i), 0.5);
//!     map.add(&GridSample::at([x, y], 20.0 + 3.0 * x));
//! }
//! map.refresh();
//! let cell = map.at([0.55, 0.55]).expect("a sample is near");
//! assert!((cell.value - 21.65).abs() < 0.01 && cell.sigma > 0.0);
//! assert!(map.at([0.05, 0.95]).is_none(), "no sample is near");
//! # Ok::<(), survey::SurveyError>(())
//! ```
#![forbid(unsafe_code)]

pub mod adaptive;
mod error;
pub mod grid;
pub mod track;

pub use error::SurveyError;
