//! Control compared with independent solutions and its own properties; allocations and panics in the control loop.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[path = "../../../cable-robot/tests/mathematics/counting/mod.rs"]
mod counting;
mod drive_lag;
mod no_alloc;
mod no_panic;
mod preview;
