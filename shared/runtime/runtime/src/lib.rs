//! The common parts of a process: arguments, configuration, log, signals, real-time scheduling, loop timing, heartbeat.
//!
//! A service is a library with a pure `step` over messages, and a `main.rs` that connects it to the bus. Example:
//!
//! ```no_run
//! use messages::{MotorState, NodeEstimate};
//! use runtime::{Args, Chassis};
//!
//! # #[derive(Default)] struct Estimator;
//! # impl Estimator { fn step(&mut self, _: &MotorState) -> NodeEstimate { NodeEstimate::default() } }
//! fn main() -> std::process::ExitCode {
//!     runtime::main("estimator", run)
//! }
//!
//! fn run(_args: &Args, chassis: &mut Chassis) -> anyhow::Result<()> {
//!     let mut estimator = Estimator::default(); // from chassis.system_file()?
//!     let mut states = chassis.bus().subscriber::<MotorState>("motor/state")?;
//!     let channel = format!("node/estimate/{}", chassis.slot().name());
//!     let mut estimates = chassis.bus().publisher::<NodeEstimate>(&channel)?;
//!     let mut waiter = chassis.waiter(&["motor/state"])?;
//!     chassis.ready()?;
//!     while chassis.running() {
//!         chassis.wait(&mut waiter, None)?;
//!         while let Some(state) = states.receive()? {
//!             chassis.pass_begin();
//!             estimates.send(&mut estimator.step(&state))?;
//!             chassis.pass_end();
//!         }
//!         chassis.report_lost(states.lost());
//!     }
//!     Ok(())
//! }
//! ```
//!
//! Invariants:
//! * Nothing here blocks the loop: a separate thread writes to the terminal, and the log and the heartbeat are
//!   published in the loop's idle time.
//! * SIGINT and SIGTERM request the end: they wake [`Chassis::wait`] at once, and the loop ends itself.
//! * A real-time setting that the system does not permit is skipped, with one warning that contains the cure.
//! * A program reports a failure in one sentence, and exits with 2 (bad input) or 1 (it could not be done now).

#![forbid(unsafe_code)]

mod args;
mod bad_input;
pub mod build;
mod chassis;
mod declared;
mod hash;
mod lease;
mod logging;
mod loop_schedule;
mod output;
pub mod realtime;
mod timing;
mod tuning;

pub use args::{Args, CommonArgs, VariantArgs};
pub use bad_input::BadInput;
pub use build::Program;
pub use bus::clock::now_ns;
pub use chassis::{
    CHANGES_VARIABLE, Chassis, DOMAIN_VARIABLE, ENDED, NAME_VARIABLE, ProcessStatus, SUCCESSOR_VARIABLE, exit_code,
    main, main_as,
};
pub use declared::{FirstOutput, parts_of};
pub use hash::{ProgramHash, hash_of};
pub use loop_schedule::LoopSchedule;
pub use output::{OUTPUT_FAULTS, Output};
pub use timing::Timing;
pub use tuning::{Change, TUNED_CHANNEL, Tuning};
