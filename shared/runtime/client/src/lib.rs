//! Finds a running robot, sends requests to its processes, and reads their channels.
//!
//! Invariants:
//! * A client moves nothing itself: motor-io and the planner decide, and the client returns their answer unchanged.
//! * Every request ends: an answer comes within [`ANSWER`], or the request fails.
//! * An emergency stop needs neither a place on the bus nor memory ([`emergency_stop`]).
#![forbid(unsafe_code)]

mod process_table;
mod requests;
mod robot;

pub use process_table::{follow, state_name};
pub use requests::{MOTOR_BOX, MOTOR_IO, PLANNER, SUPERVISOR, robot_of, running, send, system_of, true_system_of};
pub use robot::{
    ANSWER, RUNNING_FILE, Running, ask, domain, emergency_stop, estimate, join, join_as, newest, sample,
    sentence_of_stop, unrecorded, unrecorded_of,
};
