//! Running robots with their processes, in real time; one at a time.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod adaptive;
mod blobs;
mod captured;
mod chaos;
mod counters;
mod crew;
mod emergency;
mod faults;
mod live_tuning;
mod lives;
mod losses;
mod own_estimator;
mod own_law;
mod own_program;
mod plugged_sensors;
mod power;
mod processes;
mod robot;
mod sensor_logger;
mod serial_sensors;
mod service;
mod slips;
mod soft;
mod swaps;
mod visualization;
mod waiting;
