//! Calibration compared with simulated truth, an independent minimiser and the published figures; insufficient data.

#![allow(clippy::unwrap_used, clippy::expect_used)]
#![allow(clippy::needless_range_loop, reason = "anchors are compared by index")]

mod heights;
mod joint;
mod length_check;
mod lengths;
mod paper;
mod patterns;
mod pulleys;
mod refusals;
mod regions;
mod stand_in;
mod survey;
