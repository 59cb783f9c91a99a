//! What maps and tracks promise, and where a finer scan goes.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod adaptive;
mod grid;
mod track;
