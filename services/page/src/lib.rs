//! The page: a robot on a tablet. A web server that shows the robot and passes requests to its gateway.
//!
//! Invariants:
//! * The page is a client of the gateway's socket and nothing else: it joins no shared memory, and only `start` starts
//!   programs, the gateway and a browser. The gateway decides what a browser may do, by the token that the browser
//!   holds; one without a token can look and stop.
//! * What a browser sends is bounded in size and rate, and what it does not take is replaced by what is newer: no
//!   browser delays the page, another browser or the robot.
//! * A stop waits for nothing that was asked before it: it goes over a connection of its own, and what was asked before
//!   it begins no motion afterwards.
//! * Every sentence about the robot comes from the robot, its gateway or the catalogue of `robot-state`.
//! * Nothing on the page comes from another server, and no text of a robot or a browser becomes markup.
//! * Other machines are served over TLS only.
#![forbid(unsafe_code)]

mod app;
mod assets;
mod certificate;
mod control;
mod crowd;
mod drives;
mod evaluations;
mod fields;
mod freshness;
mod gather;
mod here;
mod history;
mod http;
mod link;
mod listener;
mod observer;
mod pair;
mod places;
mod plain;
mod protocol;
mod robot;
mod scene;
mod server;
mod session;
pub mod settings;
mod setup;
mod start;
mod stops;
mod weigh;

pub use pair::{pair, revoke, tokens};
pub use server::serve;
pub use start::start;
