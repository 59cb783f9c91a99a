//! Properties of maps, tracks and the selection of areas for a finer scan.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod adaptive;
mod coverage;
mod fields;
mod grid;
mod track;
