//! What the kernel records about processor time that a thread did not get. It keeps a starved computer from being
//! mistaken for a silent drive, a dead controller or a slack cable.
//!
//! A [`Thread`] measures how long one thread was runnable without running, a [`Pressure`] how long any thread of the
//! machine was, and a [`Load`] how many threads want to run. Every user may read these.
//!
//! Invariants:
//! * Files are opened once; a reading neither allocates nor waits.
//! * Where a kernel lacks the statistics (`/proc/pressure`, `schedstat`), the result is empty, never an estimate.
#![forbid(unsafe_code)]

pub mod busy;
mod machine;
mod thread;

pub use machine::{Load, Pressure};
pub use thread::{State, Thread};
