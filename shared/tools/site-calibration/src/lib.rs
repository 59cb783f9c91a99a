//! Measurements of a site: the questions that lead through them, and the calibration that they determine.
//!
//! Invariants:
//! * No input and output, no clock: a terminal and a page ask the same questions, and refuse the same answers with the
//!   same sentences.
//! * The measurements file is the whole state of the questions.
#![forbid(unsafe_code)]

#[macro_use]
mod say;

pub mod calibrate;
pub mod loads;
pub mod robot_file;
pub mod setup;
