//! The viewer: every channel of a robot live, over the WebSocket protocol of Foxglove and Lichtblick.
//!
//! Invariants:
//! * A tool is offered every channel, known or not, under the definition that the recorder would write for it.
//! * A channel is listened to only while some tool wants it, and at most so many of its samples per second are passed
//!   on ([`Budget`]). What a slow tool does not take is dropped; a publisher never waits.
//! * It listens on this machine alone unless it is told otherwise, and nothing that a tool sends moves the robot.

#![forbid(unsafe_code)]

mod budget;
mod offer;
mod viewer;

pub use budget::Budget;
pub use viewer::{Settings, Viewer, ViewerError};
