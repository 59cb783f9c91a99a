//! The viewer: every channel of a robot live, over the WebSocket protocol of Foxglove and Lichtblick.
//!
//! Invariants:
//! * The viewer offers every channel, of known or unknown type, under the definition that the recorder would write for
//!   it.
//! * It subscribes to a channel only while a tool requests it, and limits how many of its samples it forwards per
//!   second ([`Budget`]). Samples that a slow tool does not take are dropped; a publisher never waits.
//! * By default it accepts connections from this machine only, and nothing that a tool sends moves the robot.

#![forbid(unsafe_code)]

mod budget;
mod offer;
mod viewer;

pub use budget::Budget;
pub use viewer::{Settings, Viewer, ViewerError};
