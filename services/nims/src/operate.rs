//! Requests to the running robot: each is answered by one sentence.

use crate::cli::{Goto, PathKind, Run, Zero};
use crate::failure::{Answer, Failure};
use crate::live::{self, Running};
use crate::points;
use bus::Bus;
use cable_robot::{Profile, Robot, Segment, Vector3, kinematics};
use config::{BoxFile, RESOLVED};
use messages::{OperatorRequest, put_text};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Duration;

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
    Failure::of(&live::ask(bus, process, request)?)
}

/// The answer of an accepted request as JSON.
#[must_use]
pub fn accepted(sentence: &str) -> Value {
    json!({ "accepted": true, "answer": sentence })
}

/// `nims zero`.
///
/// # Errors
/// The position or the lengths make no sense for this robot; refused; not answered.
pub fn zero(bus: &Bus, asked: &Zero) -> Answer<String> {
    let robot = robot_of(bus)?;
    let request = match (&asked.at, &asked.lengths) {
        (Some(at), _) => {
            let at = points::position(&robot, at)?;
            standing(&robot, &at)?;
            with_args(OperatorRequest::VERB_ZERO_AT, &at)?
        }
        (None, Some(lengths)) => {
            kinematics::forward_kinematics(robot.anchors(), &lengths.0, None).map_err(Failure::bad)?;
            with_args(OperatorRequest::VERB_ZERO_LENGTHS, &lengths.0)?
        }
        (None, None) => return Err(Failure::BadInput("give --at X,Y,Z or --lengths A,B,..".to_owned())),
    };
    send(bus, MOTOR_IO, &request)
}

/// `nims jog`.
///
/// # Errors
/// No such cable; refused; not answered.
pub fn jog(bus: &Bus, cable: u8, metres: f64) -> Answer<String> {
    let cables = robot_of(bus)?.cable_count();
    if usize::from(cable) > cables {
        return Err(Failure::BadInput(format!("there is no cable {cable}; this robot has cables 1 to {cables}")));
    }
    send(bus, MOTOR_IO, &with_args(OperatorRequest::VERB_JOG, &[f64::from(cable), metres])?)
}

/// `nims speed`.
///
/// # Errors
/// Out of range; refused; not answered.
pub fn speed(bus: &Bus, percent: f64) -> Answer<String> {
    if !(5.0..=100.0).contains(&percent) {
        return Err(Failure::BadInput(format!(
            "the speed is {percent} percent; accepted: 5 to 100 percent of the planned speed"
        )));
    }
    send(bus, MOTOR_IO, &with_args(OperatorRequest::VERB_SPEED, &[percent / 100.0])?)
}

/// `nims goto`.
///
/// # Errors
/// A point where the robot cannot be, a speed it does not have; refused; not answered.
///
/// A single move is not refused where nothing is being recorded: it may be the way home. It is said.
pub fn goto(bus: &Bus, asked: &Goto) -> Answer<String> {
    path_of(asked)?;
    let robot = robot_of(bus)?;
    let to = points::position(&robot, &asked.to)?;
    standing(&robot, &to)?;
    let speed = asked.speed.unwrap_or(0.0);
    if asked.speed.is_some() && !(speed > 0.0 && speed <= robot.speed_limit_m_s()) {
        let limit = robot.speed_limit_m_s();
        return Err(Failure::BadInput(format!(
            "--speed is {speed}; accepted: above 0, at most this robot's {limit} m/s"
        )));
    }
    let (path, mu) = path_of(asked)?;
    let [x, y, z] = to;
    let answer = send(bus, PLANNER, &with_args(OperatorRequest::VERB_GOTO, &[x, y, z, speed, path, mu])?)?;
    // The node moves already: whatever goes wrong here, the planner has accepted.
    match live::unrecorded(bus) {
        Ok(None) => {}
        Ok(Some(why)) => eprintln!("nims: warning: nothing is being recorded ({why})"),
        Err(failure) => eprintln!("nims: warning: it is not known whether this is being recorded ({failure})"),
    }
    Ok(answer)
}

/// The path of a move as the planner has it: its number, and how much it sags, 1/m.
fn path_of(asked: &Goto) -> Answer<(f64, f64)> {
    match (asked.path, asked.mu) {
        (PathKind::Line, None) => Ok((0.0, 0.0)),
        (PathKind::Parabola, Some(mu)) if mu > 0.0 && mu <= 10.0 => Ok((1.0, mu)),
        (PathKind::Parabola, Some(mu)) => {
            Err(Failure::BadInput(format!("--mu is {mu}; accepted: above 0, at most 10 per metre")))
        }
        // The planner then takes what loses least in the motors.
        (PathKind::Parabola, None) => Ok((1.0, 0.0)),
        (PathKind::Lateral, None) => Ok((2.0, 0.0)),
        (PathKind::Line | PathKind::Lateral, Some(_)) => {
            Err(Failure::BadInput("--mu is for a parabola; add --path parabola, or leave it out".to_owned()))
        }
    }
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

/// `nims run`: reads the mission, tries it against the robot from where the node is, and only then asks for it.
///
/// # Errors
/// A mission that cannot be read or flown; refused; not answered.
pub fn run_checked(bus: &Bus, asked: &Run) -> Answer<String> {
    let file = box_of(bus)?;
    let path = mission_path(&asked.mission, Some(&file.planner.missions))?;
    let mission = planner::mission::Mission::read(&path).map_err(Failure::bad)?;
    if let Some(why) = live::unrecorded(bus)?.filter(|_| !asked.unrecorded) {
        return Err(Failure::NotNow(format!(
            "the mission is not started, because nothing is being recorded ({why}): put that right, or fly it with --unrecorded"
        )));
    }
    // Where the node is not known the planner has the better words for why it does not start.
    // What is left of a mission only the planner knows.
    if !asked.go_on
        && let Some(from) = present(bus)?
    {
        crate::findings::fly(&mission, &file, &from)?;
    }
    send(bus, PLANNER, &run_request(&path, asked.go_on)?)
}

/// `nims run --dry-run`: the answer, and its sentence.
///
/// # Errors
/// A configuration or mission that cannot be read, or no starting point.
pub fn dry_run(domain: Option<&str>, asked: &Run) -> Answer<(Value, String)> {
    let (file, here) = match &asked.config {
        Some(config) => (BoxFile::load(config).map_err(Failure::bad)?, None),
        None => {
            let bus = live::join(domain)?;
            (box_of(&bus)?, present(&bus)?)
        }
    };
    let from = match (asked.from, here, &file.motor_box) {
        (Some(from), ..) => {
            let robot = file.robot_file().map_err(Failure::bad)?.robot().map_err(Failure::bad)?;
            points::position(&robot, &from)?
        }
        (None, Some(from), _) => from,
        (None, None, Some(virtual_box)) => virtual_box.start_m.position_m,
        (None, None, None) => {
            return Err(Failure::BadInput("say where the mission begins with --from X,Y,Z".to_owned()));
        }
    };
    let path = mission_path(&asked.mission, Some(&file.planner.missions))?;
    let mission = planner::mission::Mission::read(&path).map_err(Failure::bad)?;
    Ok(match crate::findings::fly(&mission, &file, &from) {
        Ok(flight) => {
            let sentence = format!("mission \"{}\" can be flown: {}", mission.name, flight.words());
            let value = json!({ "feasible": true, "segments": flight.segments, "length_m": flight.length_m,
                "duration_s": flight.duration_s, "energy_j": flight.energy_j });
            (value, sentence)
        }
        Err(why) => (
            json!({ "feasible": false, "why": why.to_string() }),
            format!("mission \"{}\" cannot be flown: {why}", mission.name),
        ),
    })
}

/// A mission by path, or by name in the box's folder of missions.
///
/// # Errors
/// There is no such file.
pub fn mission_path(asked: &Path, missions: Option<&Path>) -> Answer<PathBuf> {
    let mut candidates = vec![asked.to_path_buf()];
    if let Some(folder) = missions {
        candidates.push(folder.join(asked));
        candidates.push(folder.join(asked).with_extension("toml"));
    }
    let Some(found) = candidates.iter().find(|path| path.is_file()).or(candidates.iter().find(|path| path.exists()))
    else {
        let beside = missions.map(|folder| format!(", nor in {}", folder.display())).unwrap_or_default();
        return Err(Failure::BadInput(format!("there is no mission file {}{beside}", asked.display())));
    };
    std::path::absolute(found).map_err(Failure::bad)
}

/// The box that the supervisor of this domain runs.
///
/// # Errors
/// It left no word, or its file cannot be read any more.
pub fn box_of(bus: &Bus) -> Answer<BoxFile> {
    let Some(running) = Running::of(bus.domain()) else {
        return Err(Failure::NotNow(format!(
            "the robot in the domain `{}` was not started by `nims up`",
            bus.domain().name()
        )));
    };
    let copy = running.run.join(RESOLVED);
    // Who deleted the folder of the run shall still be able to land the robot.
    let path = if copy.is_file() { &copy } else { &running.box_file };
    BoxFile::load(path).map_err(Failure::not_now)
}

fn robot_of(bus: &Bus) -> Answer<Robot> {
    box_of(bus)?.robot_file().map_err(Failure::not_now)?.robot().map_err(Failure::not_now)
}

/// Where the node is, if it is known.
fn present(bus: &Bus) -> Answer<Option<[f64; 3]>> {
    let estimate = live::estimate(bus, Duration::from_millis(500))?;
    Ok(estimate.filter(|estimate| estimate.valid == 1).map(|estimate| estimate.position_m))
}

/// Whether the node can hang at rest at this point; whether it can also get there is for the planner to say.
fn standing(robot: &Robot, at: &[f64; 3]) -> Answer {
    let cannot = |why: String| Failure::BadInput(format!("the node cannot hang there: {why}"));
    let path = cable_robot::Path::Dwell(Vector3::from(*at));
    let profile = Profile::dwell(1.0).map_err(|error| cannot(error.to_string()))?;
    let rest = Segment { id: 1, path, profile, start_s: 0.0 };
    let distribution = robot.default_distribution();
    rest.check(robot, distribution, 1.0).map(|_| ()).map_err(|refusal| cannot(refusal.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_asked_for_with_its_sag() {
        let goto = |path, mu| path_of(&Goto { to: [1.0, 2.0, 3.0].into(), speed: None, path, mu });
        assert_eq!(goto(PathKind::Line, None), Ok((0.0, 0.0)));
        assert_eq!(goto(PathKind::Parabola, Some(0.1)), Ok((1.0, 0.1)));
        // Without a sag the planner takes the one that loses least; it is told so by 0.
        assert_eq!(goto(PathKind::Parabola, None), Ok((1.0, 0.0)));
        assert_eq!(goto(PathKind::Lateral, None), Ok((2.0, 0.0)));
        for (path, mu) in
            [(PathKind::Line, Some(0.1)), (PathKind::Lateral, Some(0.1)), (PathKind::Parabola, Some(-0.1))]
        {
            let failure = goto(path, mu).unwrap_err();
            assert!(failure.exit_code() == 2 && failure.to_string().contains("--mu"), "{failure}");
        }
    }
}
