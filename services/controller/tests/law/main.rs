//! Tests of the controller: its laws, and the independence of the two estimator slots.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod controller;
mod free_slot;
