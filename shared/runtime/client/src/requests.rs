//! Requests to the processes of a running robot.

use crate::robot::{Running, ask};
use bus::Bus;
use cable_robot::Robot;
use command::{Answer, Failure};
use config::{RESOLVED, SystemFile};
use messages::Request;

/// Process that moves the robot.
pub const MOTOR_IO: &str = "motor-io";
/// Process that plans missions and single moves.
pub const PLANNER: &str = "planner";
/// Virtual motor box, which makes faults on request.
pub const MOTOR_BOX: &str = "motor-box";
/// Process that starts and ends the others; the name under which the supervisor joins the domain.
pub const SUPERVISOR: &str = "nims";

/// Sends a request and turns a refusal into a failure.
///
/// # Errors
/// Refused, with the reason, or not answered.
pub fn send(bus: &Bus, process: &str, request: &Request) -> Answer<String> {
    Failure::unless_accepted(&ask(bus, process, request)?)
}

/// The system file of the run of this domain, without the true world of a virtual motor box.
///
/// # Errors
/// The supervisor left no record of the run, or the file cannot be read any more.
pub fn system_of(bus: &Bus) -> Answer<SystemFile> {
    copy_of(bus, RESOLVED)
}

/// The system file of the run of this domain with the true world of a virtual motor box: for tools that judge the
/// robot, not for its processes.
///
/// # Errors
/// As [`system_of`].
pub fn true_system_of(bus: &Bus) -> Answer<SystemFile> {
    copy_of(bus, config::MOTOR_BOX)
}

fn copy_of(bus: &Bus, name: &str) -> Answer<SystemFile> {
    let running = running(bus)?;
    let copy = running.run.join(name);
    // The robot can still be landed after its run folder was deleted.
    let path = if copy.is_file() { &copy } else { &running.system_file };
    SystemFile::load(path).map_err(Failure::not_now)
}

/// What the supervisor of this domain runs.
///
/// # Errors
/// The supervisor left no record of the run.
pub fn running(bus: &Bus) -> Answer<Running> {
    Running::read(bus.domain()).ok_or_else(|| {
        Failure::NotNow(format!("the robot in the domain `{}` was not started by `nims up`", bus.domain().name()))
    })
}

/// The robot of the run of this domain.
///
/// # Errors
/// As [`system_of`].
pub fn robot_of(bus: &Bus) -> Answer<Robot> {
    system_of(bus)?.robot_file().map_err(Failure::not_now)?.robot().map_err(Failure::not_now)
}
