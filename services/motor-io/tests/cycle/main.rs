//! The control cycle without a clock: commands, checks and samples.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod account;
mod allocation;
mod arbiter;
mod border;
#[path = "../../../../shared/robot/cable-robot/tests/mathematics/counting/mod.rs"]
mod counting;
mod faults;
mod free_slot;
mod gaps;
mod jogs;
mod judge;
mod jumps;
mod modes;
mod orders;
mod peers;
mod positions;
mod properties;
mod returns;
mod rig;
mod soft;
mod starved;
