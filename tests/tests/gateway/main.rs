//! The gateway over its real socket, with a robot on the virtual motor box: roles, hostile clients, deaths, missions by
//! content, runs.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "../live/robot/mod.rs"]
mod robot;

mod held;
mod hostile;
mod own_messages;
mod python;
mod rig;
mod roles;
mod runs_and_sensors;
