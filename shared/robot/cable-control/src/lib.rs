//! Control of a cable robot: laws from setpoint and position to velocities, delay and lag of the drives,
//! filters of lengths.
//!
//! | module | contents |
//! |---|---|
//! | [`law`] | the paper's LQ endpoint law and proportional feedforward |
//! | [`preview`] | a predictive law that includes the delay of the drives |
//! | [`drive_lag`] | delay and lag of drives, identified in operation |
//! | [`motor_model`] | the paper's motor model (18)-(19), identified in operation |
//! | [`length_filter`] | a Kalman filter on length and velocity of one cable |
//!
//! Invariants:
//! * Pure functions and small state machines: no clock, no I/O, no allocation after construction.
//! * Functions that IEEE 754 does not fix come from `libm`, so that every machine computes the same bits.
#![forbid(unsafe_code)]
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "`!(a <= b)` also rejects NaN, which `a > b` would accept")]
#![allow(clippy::needless_range_loop, reason = "matrix kernels read like their formulas, with indices")]

pub mod drive_lag;
pub mod law;
pub mod length_filter;
pub mod motor_model;
pub mod preview;
