//! Recorded runs as people need them: what is in them, a page, maps, tables, accuracy, motor tables.
//!
//! Invariants:
//! * A run is only read; what is made of it goes into files of its own.
//! * What is said of a run rests on its files alone, so that it is the same years later.
#![forbid(unsafe_code)]

pub mod accuracy;
pub mod accuracy_plot;
mod command_line;
pub mod counters;
pub mod export;
pub mod map;
pub mod motor_table;
pub mod report;
pub mod runs;
pub mod tracker;

pub use command_line::Command;
