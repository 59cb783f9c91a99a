//! A serial line: the real one and the simulated one.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod pipe;
mod real;
