//! The gateway: the one way by which operators who are not the robot's user reach the robot.
//!
//! It runs as the robot's user, beside the supervisor and independent of it. It owns a Unix socket, knows the user and
//! the group of each client from the kernel, and carries out what the client's role permits. `docs/gateway.md` has the
//! protocol, `docs/access.md` the roles.
//!
//! Invariants:
//! * [`core::Core`] decides everything and is pure: bytes, peers and answers in, actions out. No bytes make it panic.
//! * Everything that a client can fill is bounded: frames, calls, subscriptions, connections, waiting bytes. Nothing
//!   that a client does or leaves undone delays another client for longer than one pass: what waits for the disk or for
//!   the channel of a sensor has a thread of its own.
//! * Requests that stop the robot have their own places on the bus, taken when the robot is joined. An emergency stop
//!   needs none.
//! * A client is no process of the robot's user: it starts no program of its own choice, and no name from it is opened
//!   as a path, also none in a robot file that it hands over. A plug-in that the system file declares is started by the
//!   service manager, as another user.
//! * A plug-in delivers readings of its declared sensor, or samples of a message that it declares itself, at its
//!   declared rate, and nothing else: the kernel names the unit in which its process runs. Its channel stays as long as
//!   the robot, however often it connects. A message that a sensor declares is none of the robot's own.
//! * One person at a time flies from pages, and both see it when another one takes over. A stop is open to all of them.
//! * The recorded request names the user at the other end of the connection, not the gateway.
#![forbid(unsafe_code)]

mod budget;
mod codes;
pub mod core;
mod disk;
mod events;
mod exec;
mod held;
mod hub;
mod lane;
mod lasting;
mod make;
mod outbox;
mod outlet;
mod own_channels;
pub mod plugin;
mod robot;
mod robot_file;
pub mod roles;
mod runs;
mod seat;
mod sensors;
mod server;
pub mod settings;
mod socket;
pub mod tokens;
mod users;

pub use exec::exec;
pub use robot_file::RobotTexts;
pub use server::Server;
