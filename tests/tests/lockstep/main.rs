//! The same cores without processes, in lockstep with the plant: as fast as the machine computes.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod borders;
mod broken;
mod calibrated_worlds;
mod calibrations;
mod choices;
mod drawn;
mod drift;
mod drums;
mod energy;
mod export;
mod flights;
mod georeference;
mod identify;
mod identify_stiffness;
/// The template for a custom law.
#[path = "../../../scripts/templates/law/src/law.rs"]
mod law;
mod laws;
mod loads;
mod map;
/// The template for a custom estimation method.
#[path = "../../../scripts/templates/estimator/src/method.rs"]
mod method;
mod missions;
mod motor_table;
mod motors;
mod obstacles;
mod orders;
mod planar;
mod python_runs;
mod replay;
mod report;
mod scale;
mod sim;
mod sim_estimators;
mod slips;
mod soft;
mod takeover;
mod touch_down;
mod tuning;
mod walk;
mod wheels;
mod worlds;
