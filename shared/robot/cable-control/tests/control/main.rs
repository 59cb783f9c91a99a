//! Control, held to independent solutions and its own properties; what of it and of the mathematics may run in the loop.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[path = "../../../cable-robot/tests/mathematics/counting/mod.rs"]
mod counting;
mod drive_lag;
mod no_alloc;
mod no_panic;
mod preview;
