//! Kernel statistics about CPU time that threads were denied. They distinguish an overloaded computer from a silent
//! drive, a dead controller or a slack cable.
//!
//! A [`Thread`] measures how long one thread was runnable without running, a [`Pressure`] how long any thread of the
//! machine was, and a [`Load`] how many runnable threads there are. Every user can read these statistics.
//!
//! Invariants:
//! * Files are opened once; polling reads them without allocating and without waiting.
//! * A kernel without a statistic (no `/proc/pressure`, no `schedstat`) yields no value; nothing is guessed.
#![forbid(unsafe_code)]

pub mod busy;
mod machine;
mod thread;

pub use machine::{Load, Pressure};
pub use thread::{State, Thread};
