//! Finds a running robot, sends requests to its processes, and reads their channels.
//!
//! Invariants:
//! * A client moves nothing itself: motor-io and the planner decide, and the client returns their answer unchanged.
//! * Every request ends: an answer comes within [`ANSWER`], or the request fails.
//! * A command is the same for the robot's user, who joins its shared memory, and for others, who use its gateway:
//!   [`RobotLink`] is the only difference.
//! * An emergency stop needs neither a place on the bus nor memory ([`emergency_stop`]).
#![forbid(unsafe_code)]

mod connection;
mod copy;
mod finding;
mod link;
mod process_table;
mod requests;
mod robot;
mod samples;
mod tap;

pub use connection::{TOKEN_VARIABLE, not_connected, trusted};
pub use copy::copy_run;
pub use finding::{GATEWAY_VARIABLE, Place, emergency_stop, gateway, gateway_socket, link, link_as};
pub use gateway_protocol::{FileRow, RunRow, TokenRow};
pub use link::{Gateway, LinkWaiter, RobotLink, Samples, Subscription, channel_row, unpack};
pub use process_table::{follow, state_name};
pub use requests::{robot_of, send, system_of, true_system_of};
pub use robot::{
    ANSWER, MOTOR_IO, PLANNER, RUNNING_FILE, Running, SUPERVISOR, VIRTUAL_BOX, domain, join, join_as, running, sample,
    sentence_of_stop,
};
pub use samples::{estimate, newest, unrecorded, unrecorded_of};
pub use tap::LinkTap;
