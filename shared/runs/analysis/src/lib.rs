//! Analysis of recorded runs: contents, report page, maps, tables, accuracy, motor tables.
//!
//! Invariants:
//! * A run is only read; results are written to separate files.
//! * Results depend on the files of the run alone, so they are the same years later.
#![forbid(unsafe_code)]

pub mod accuracy;
pub mod accuracy_plot;
mod colours;
mod command_line;
pub mod counters;
mod drive_units;
pub mod export;
pub mod identify;
pub mod incidents;
pub mod map;
pub mod motor_table;
pub mod portrait;
pub mod report;
pub mod run_list;
mod run_time;
pub mod runs;
pub mod tracker;

pub use command_line::Command;
