//! Colours of the pictures and of the page of a run, as numbers in [`plot::COLOURS`].

use plot::{BLACK, GREY};

/// Teal for estimates: not the colour of any of the first six cables.
pub const ESTIMATE: usize = 6;
/// The true position, which only a simulation has.
pub const TRUTH: usize = BLACK;
/// What the controller aims at.
pub const SETPOINT: usize = GREY;
