//! The trait and the fleet with a family that is not a real one.

#![allow(clippy::unwrap_used, clippy::expect_used)]

mod fake;
mod inline;
mod ports;
