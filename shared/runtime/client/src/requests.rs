//! Requests to the processes of a running robot.

use crate::robot::{Running, ask};
use bus::Bus;
use cable_robot::Robot;
use command::{Answer, Failure};
use config::{RESOLVED, SystemFile};
use messages::{OperatorRequest, put_text};
use std::path::Path;

/// Who answers which request.
pub const MOTOR_IO: &str = "motor-io";
/// Missions and single moves.
pub const PLANNER: &str = "planner";

/// A request without arguments.
#[must_use]
pub fn plain(verb: u8) -> OperatorRequest {
    OperatorRequest { verb, origin: OperatorRequest::ORIGIN_COMMAND, ..OperatorRequest::default() }
}

/// A request with numbers.
///
/// # Errors
/// More numbers than a request holds.
pub fn with_args(verb: u8, numbers: &[f64]) -> Answer<OperatorRequest> {
    let mut request = plain(verb);
    let Some(args) = request.args.get_mut(..numbers.len()) else {
        return Err(Failure::BadInput(format!(
            "{} numbers are too many; a robot has at most {} cables",
            numbers.len(),
            request.args.len()
        )));
    };
    args.copy_from_slice(numbers);
    Ok(request)
}

/// Sends a request and turns a refusal into a failure.
///
/// # Errors
/// Refused, with the reason, or not answered.
pub fn send(bus: &Bus, process: &str, request: &OperatorRequest) -> Answer<String> {
    Failure::of(&ask(bus, process, request)?)
}

/// The request to fly a mission that has been read and found sound.
///
/// # Errors
/// A path that is too long for a request.
pub fn run_request(mission: &Path, go_on: bool) -> Answer<OperatorRequest> {
    let text = mission.to_string_lossy();
    let mut request = plain(OperatorRequest::VERB_RUN);
    if go_on {
        request.args[0] = OperatorRequest::RUN_CONTINUE;
    }
    if text.len() > request.text.len() {
        return Err(Failure::BadInput(format!(
            "the path of the mission file is longer than {} bytes",
            request.text.len()
        )));
    }
    put_text(&mut request.text, &text);
    Ok(request)
}

/// The box that the supervisor of this domain runs.
///
/// # Errors
/// It left no word, or its file cannot be read any more.
pub fn box_of(bus: &Bus) -> Answer<SystemFile> {
    let Some(running) = Running::of(bus.domain()) else {
        return Err(Failure::NotNow(format!(
            "the robot in the domain `{}` was not started by `nims up`",
            bus.domain().name()
        )));
    };
    let copy = running.run.join(RESOLVED);
    // Who deleted the folder of the run shall still be able to land the robot.
    let path = if copy.is_file() { &copy } else { &running.system_file };
    SystemFile::load(path).map_err(Failure::not_now)
}

/// The robot that runs.
///
/// # Errors
/// As [`box_of`].
pub fn robot_of(bus: &Bus) -> Answer<Robot> {
    box_of(bus)?.robot_file().map_err(Failure::not_now)?.robot().map_err(Failure::not_now)
}
