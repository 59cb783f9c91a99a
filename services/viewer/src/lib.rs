//! The viewer: every channel of a robot live, over the WebSocket protocol of Foxglove and Lichtblick.
//!
//! Invariants:
//! * The viewer offers every channel, of known or unknown type, under the definition that the recorder would write for
//!   it.
//! * It subscribes to a channel only while a tool requests it, and limits how many of its samples it forwards per
//!   second ([`Budget`]). Samples that a slow tool does not take are dropped; a publisher never waits.
//! * It shows the graph of processes and channels, and the parameters in use, while a tool asks for them; a tool
//!   changes none.
//! * By default it accepts connections from this machine only, and only of users who may look: the kernel states who
//!   connects, before a byte is read or sent. Nothing that a tool sends moves the robot.
//! * What a tool can make it keep is bounded, and so is the time that connections of other users take.

#![forbid(unsafe_code)]

mod budget;
mod graph;
mod hub;
mod offer;
mod outbox;
mod parameters;
mod peer;
mod permission;
mod protocol;
mod server;
mod viewer;

pub use budget::Budget;
pub use viewer::{Settings, Viewer, ViewerError};
