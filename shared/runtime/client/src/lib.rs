//! Finding a running robot, sending requests to its processes, and reading their samples.
//!
//! Invariants:
//! * A client moves nothing itself: motor-io and the planner decide, and their answer is passed on unchanged.
//! * A request is answered within [`ANSWER`], or it fails.
//! * An emergency stop needs neither a place on the bus nor memory ([`emergency_stop`]).
#![forbid(unsafe_code)]

mod process_table;
mod requests;
mod robot;

pub use process_table::{follow, state_name};
pub use requests::{MOTOR_IO, PLANNER, SUPERVISOR, box_of, robot_of, running, sample, send};
pub use robot::{
    ANSWER, RUNNING_FILE, Running, ask, domain, emergency_stop, estimate, join, join_as, newest, unrecorded,
    unrecorded_of,
};
