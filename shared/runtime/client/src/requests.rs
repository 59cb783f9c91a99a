//! Requests to the processes of a running robot.

use crate::link::RobotLink;
use cable_robot::Robot;
use command::{Answer, Failure};
use config::{RESOLVED, SystemFile};
use messages::Request;

/// Sends a request and turns a refusal into a failure.
///
/// # Errors
/// Refused, with the reason, or not answered.
pub fn send(link: &RobotLink, process: &str, request: &Request) -> Answer<String> {
    Failure::unless_accepted(&link.ask(process, request)?)
}

/// The system file of the run of this domain, without the true world of a virtual motor box.
///
/// # Errors
/// The supervisor left no record of the run, or the file cannot be read any more.
pub fn system_of(link: &RobotLink) -> Answer<SystemFile> {
    link.system_file(RESOLVED)
}

/// The system file of the run of this domain with the true world of a virtual motor box: for tools that judge the
/// robot, not for its processes.
///
/// # Errors
/// As [`system_of`].
pub fn true_system_of(link: &RobotLink) -> Answer<SystemFile> {
    link.system_file(config::MOTOR_BOX)
}

/// The robot of the run of this domain.
///
/// # Errors
/// As [`system_of`].
pub fn robot_of(link: &RobotLink) -> Answer<Robot> {
    system_of(link)?.robot_file().map_err(Failure::not_now)?.robot().map_err(Failure::not_now)
}
