//! The driver against virtual units over a pipe with a virtual clock: in order, under faults, and after them.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod clockwork;
mod cycle;
mod faults;
mod slow;
