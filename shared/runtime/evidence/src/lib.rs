//! What the kernel says about the processor time that a thread did not get: evidence, so that a starved computer is not mistaken for a
//! silent drive, a dead controller or a slack line.
//!
//! A [`Thread`] tells how long a thread of this machine was runnable without running, a [`Pressure`] how long any thread of the machine
//! was, and a [`Load`] how many there are. All of it can be read by every user.
//!
//! Invariants:
//! * Files are opened once; a look reads them without allocating and without waiting.
//! * A kernel that does not tell (no `/proc/pressure`, no `schedstat`) gives nothing, never a guess.
#![forbid(unsafe_code)]

pub mod busy;
mod machine;
mod thread;

pub use machine::{Load, Pressure};
pub use thread::{State, Thread};
