//! Requests to the running robot; the answer to each is one sentence.

use crate::wait::Follower;
use bus::Participant;
use cable_robot::{Robot, Vector3, kinematics};
use client::{MOTOR_IO, PLANNER, Place, RobotLink, SUPERVISOR, robot_of, send, system_of};
use command::values::{Numbers, finite, numbers, point};
use command::{Answer, Failure, Output, points};
use commissioning::plan::PathKind;
use config::{Point, SystemFile};
use messages::{GotoPath, OperatorRequest, Request};
use planner::mission::Mission;
use robot_state::Reason;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Commands that move the robot or bring it to rest.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Switch the motors on: from Disarmed to Holding.
    Arm,
    /// Switch the motors off at rest; the node sinks.
    Disarm,
    /// Slow down on the path and hold, keeping the motion.
    Hold,
    /// Slow down on the path and hold, dropping the motion.
    Stop,
    /// Stop the motors at once; needs `reset` afterwards.
    Estop,
    /// Leave a fault or an emergency stop after its cause is removed.
    Reset,
    /// Set the position of the node.
    Zero(ZeroArgs),
    /// Confirm, after a restart, that the position from before is still correct.
    ConfirmPosition,
    /// Pay out one cable slowly (negative: reel in).
    #[command(allow_negative_numbers = true)]
    Jog {
        /// Number of the cable, from 1.
        #[arg(value_parser = clap::value_parser!(u8).range(1..=8))]
        cable: u8,
        /// Length, m; positive pays out.
        #[arg(value_parser = finite, allow_negative_numbers = true)]
        metres: f64,
    },
    /// Let the cables carry the node and yield to a hand, until `hold`.
    Soft,
    /// Move the node to a point.
    Goto(GotoArgs),
    /// Fly a mission.
    Run(RunArgs),
    /// Slow down on the path, keeping the mission.
    Pause,
    /// Continue after pause or hold.
    Resume,
    /// Mark this instant in the run file, to find it again in the report.
    Mark {
        /// What is to be found again.
        #[arg(value_parser = clap::builder::NonEmptyStringValueParser::new())]
        text: String,
    },
    /// Set the speed of a mission.
    Speed {
        /// Percent of the planned speed, 5 to 100.
        #[arg(value_parser = finite, allow_negative_numbers = true)]
        percent: f64,
    },
}

impl Command {
    /// Sends the request to motor-io or the planner.
    ///
    /// # Errors
    /// The input is wrong, or the request is refused (with the reason) or not answered.
    pub fn run(&self, place: Place<'_>) -> Answer<Output> {
        let join = || client::link(place);
        // Commands that bring the robot to rest may use the places reserved for members.
        let ask = |request: Request, party: Participant| send(&client::link_as(place, party)?, MOTOR_IO, &request);
        let sentence = match self {
            Self::Arm => ask(Request::Arm, Participant::Command),
            Self::Disarm => ask(Request::Disarm, Participant::Member),
            Self::Hold => ask(Request::Hold, Participant::Member),
            Self::Stop => ask(Request::Stop, Participant::Member),
            Self::Estop => client::emergency_stop(place),
            Self::Reset => ask(Request::Reset, Participant::Command),
            Self::Zero(args) => zero(&join()?, args),
            Self::ConfirmPosition => ask(Request::ConfirmPosition, Participant::Command),
            Self::Jog { cable, metres } => jog(&join()?, *cable, *metres),
            Self::Soft => ask(Request::Soft, Participant::Command),
            Self::Goto(args) => return goto(&join()?, args),
            Self::Run(args) if args.dry_run => return dry_run(place, args),
            Self::Run(args) => return run(&join()?, args),
            Self::Pause => ask(Request::Pause, Participant::Member),
            Self::Resume => ask(Request::Resume, Participant::Command),
            Self::Mark { text } => send(&join()?, SUPERVISOR, &Request::Mark { text: text.clone() }),
            Self::Speed { percent } => speed(&join()?, *percent),
        };
        sentence.map(Output::accepted)
    }
}

/// `nims zero`: one of the two arguments.
#[derive(Debug, clap::Args)]
#[group(required = true, multiple = false)]
pub struct ZeroArgs {
    /// Position of the node, m.
    #[arg(long, value_name = "X,Y,Z|X,Z", value_parser = point, allow_hyphen_values = true)]
    pub at: Option<Point>,
    /// Lengths of the cables from pulley to node, m.
    #[arg(long, value_name = "A,B,..", value_parser = numbers, allow_hyphen_values = true)]
    pub lengths: Option<Numbers>,
}

/// `nims goto`.
#[derive(Debug, clap::Args)]
pub struct GotoArgs {
    /// Target, m.
    #[arg(value_name = "X,Y,Z|X,Z", value_parser = point, allow_hyphen_values = true)]
    pub to: Point,
    /// Shape of the path.
    #[arg(long, value_enum, default_value = "line")]
    pub path: PathKind,
    /// Sag of a parabola, 1/m, above 0; default: the sag with the smallest energy loss in the motors.
    #[arg(long, value_name = "PER_M", value_parser = finite, allow_negative_numbers = true)]
    pub mu: Option<f64>,
    /// Cruise speed, m/s; default: the planner's.
    #[arg(long, value_name = "M_S", value_parser = finite, allow_negative_numbers = true)]
    pub speed: Option<f64>,
    /// Show the progress, and end when the node is there: exit code 0, or 1 if it is not.
    #[arg(long)]
    pub wait: bool,
}

/// `nims run`.
#[derive(Debug, clap::Args)]
pub struct RunArgs {
    /// Mission file, or the name of one in the missions folder of the system.
    pub mission: PathBuf,
    /// Check the whole mission and print its duration, without moving.
    #[arg(long)]
    pub dry_run: bool,
    /// Fly the rest of an aborted mission.
    #[arg(long = "continue", conflicts_with = "dry_run")]
    pub go_on: bool,
    /// Show the progress, and end with the mission: exit code 0 if it was flown to its end, otherwise 1.
    #[arg(long, conflicts_with = "dry_run")]
    pub wait: bool,
    /// Fly the mission although nothing is being recorded.
    #[arg(long, conflicts_with = "dry_run")]
    pub unrecorded: bool,
    /// System file for a dry run without a running robot.
    #[arg(long, visible_alias = "system", requires = "dry_run")]
    pub config: Option<PathBuf>,
    /// Start of the mission for a dry run, m; default: the position of the node.
    #[arg(long, requires = "dry_run", value_name = "X,Y,Z|X,Z", value_parser = point, allow_hyphen_values = true)]
    pub from: Option<Point>,
}

/// `nims zero`.
///
/// # Errors
/// The position or the lengths are impossible for this robot, or the request is refused or not answered.
fn zero(link: &RobotLink, asked: &ZeroArgs) -> Answer<String> {
    let robot = robot_of(link)?;
    let request = match (&asked.at, &asked.lengths) {
        (Some(at), _) => {
            let position_m = points::position(&robot, at)?;
            standing(&robot, &position_m)?;
            Request::ZeroAt { position_m }
        }
        (None, Some(lengths)) => {
            kinematics::forward_kinematics(robot.anchors(), &lengths.0, None).map_err(Failure::bad)?;
            Request::ZeroLengths { lengths_m: lengths.0.iter().copied().collect() }
        }
        (None, None) => return Err(Failure::BadInput("give --at X,Y,Z or --lengths A,B,..".to_owned())),
    };
    send(link, MOTOR_IO, &request)
}

/// `nims jog`.
///
/// # Errors
/// There is no such cable, or the request is refused or not answered.
fn jog(link: &RobotLink, cable: u8, metres: f64) -> Answer<String> {
    let cables = robot_of(link)?.cable_count();
    if usize::from(cable) > cables {
        return Err(Failure::BadInput(format!("there is no cable {cable}; this robot has cables 1 to {cables}")));
    }
    send(link, MOTOR_IO, &Request::Jog { cable, distance_m: metres })
}

/// `nims speed`.
///
/// # Errors
/// The speed is out of range, or the request is refused or not answered.
fn speed(link: &RobotLink, percent: f64) -> Answer<String> {
    if !(5.0..=100.0).contains(&percent) {
        return Err(Failure::BadInput(format!(
            "the speed is {percent} percent; accepted: 5 to 100 percent of the planned speed"
        )));
    }
    send(link, MOTOR_IO, &Request::Speed { rate: percent / 100.0 })
}

/// `nims goto`.
///
/// # Errors
/// The node cannot hang at the target, the speed is out of range, or the request is refused or not answered.
///
/// Without a recording, a single move is allowed with a warning, because it may bring the node home.
fn goto(link: &RobotLink, asked: &GotoArgs) -> Answer<Output> {
    let path = path_of(asked)?;
    let robot = robot_of(link)?;
    let to = points::position(&robot, &asked.to)?;
    standing(&robot, &to)?;
    if let Some(speed) = asked.speed.filter(|speed| !(*speed > 0.0 && *speed <= robot.speed_limit_m_s())) {
        let limit = robot.speed_limit_m_s();
        return Err(Failure::BadInput(format!(
            "--speed is {speed}; accepted: above 0, at most this robot's {limit} m/s"
        )));
    }
    let follower = asked.wait.then(|| Follower::begin(link)).transpose()?;
    let answer = planned(&link.ask(PLANNER, &Request::Goto { to_m: to, path, speed_m_s: asked.speed })?)?;
    // The planner has accepted and the node moves, so a failure here is only a warning.
    match client::unrecorded(link) {
        Ok(None) => {}
        Ok(Some(why)) => eprintln!("nims: warning: nothing is being recorded ({why})"),
        Err(failure) => eprintln!("nims: warning: cannot find out whether this is being recorded ({failure})"),
    }
    waited(answer, follower)
}

/// Waits for the end of an accepted mission, if that is wanted.
///
/// # Errors
/// The mission ended early.
fn waited(accepted: Output, follower: Option<Follower>) -> Answer<Output> {
    let Some(follower) = follower else { return Ok(accepted) };
    eprintln!("nims: {}", accepted.words);
    follower.wait()?;
    let mut value = accepted.value;
    value["done"] = json!(true);
    Ok(Output::new(value, "done"))
}

/// Returns the path of a move.
fn path_of(asked: &GotoArgs) -> Answer<GotoPath> {
    match (asked.path, asked.mu) {
        (PathKind::Line, None) => Ok(GotoPath::Line),
        (PathKind::Parabola, Some(mu)) if mu > 0.0 && mu <= 10.0 => Ok(GotoPath::Parabola { mu_per_m: Some(mu) }),
        (PathKind::Parabola, Some(mu)) => {
            Err(Failure::BadInput(format!("--mu is {mu}; accepted: above 0, at most 10 per metre")))
        }
        (PathKind::Parabola, None) => Ok(GotoPath::Parabola { mu_per_m: None }),
        (PathKind::Lateral, None) => Ok(GotoPath::Lateral),
        (PathKind::Line | PathKind::Lateral, Some(_)) => {
            Err(Failure::BadInput("--mu is for a parabola; add --path parabola, or omit --mu".to_owned()))
        }
    }
}

/// A mission file, read once: what is checked, shown and flown is the same text.
#[derive(Debug)]
pub struct MissionText {
    /// The mission.
    pub mission: Mission,
    name: String,
    text: String,
}

impl MissionText {
    /// Reads a mission file.
    ///
    /// # Errors
    /// The file, the text line and the key that cannot be used.
    pub fn read(path: &Path) -> Answer<Self> {
        let (mission, text) = Mission::read_with_text(path).map_err(Failure::bad)?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Self { mission, name, text })
    }

    /// Copies the mission into the folder of the run and returns the request to fly that copy.
    ///
    /// # Errors
    /// The run folder cannot be written.
    pub fn request(&self, run: &Path, continues: bool) -> Answer<Request> {
        let hash = config::store_mission(run, &self.text).map_err(Failure::not_now)?;
        Ok(Request::Run { mission: self.name.clone(), hash, continues })
    }
}

/// The planner's answer: its sentence, and the figures of the plan.
fn planned(answer: &OperatorRequest) -> Answer<Output> {
    let sentence = Failure::unless_accepted(answer)?;
    let mut value = json!({ "accepted": true, "answer": sentence });
    if let Some(Reason::Planned { segments, length_m, duration_s, energy_j, .. }) = Reason::from_request(answer) {
        value["segments"] = json!(segments);
        value["length_m"] = json!(length_m);
        value["duration_s"] = json!(duration_s);
        value["energy_j"] = json!(energy_j);
    }
    Ok(Output::new(value, sentence))
}

/// `nims run`: reads the mission, copies it for the planner, and requests it. The planner checks and plans the copy.
///
/// # Errors
/// The mission cannot be read or flown, or the request is refused or not answered.
fn run(link: &RobotLink, asked: &RunArgs) -> Answer<Output> {
    let file = system_of(link)?;
    let path = command::mission_path(&asked.mission, Some(&file.planner.missions))?;
    let text = MissionText::read(&path)?;
    if let Some(why) = client::unrecorded(link)?.filter(|_| !asked.unrecorded) {
        return Err(Failure::NotNow(format!(
            "the mission is not started, because nothing is being recorded ({why}): solve this, or fly with --unrecorded"
        )));
    }
    let follower = asked.wait.then(|| Follower::begin(link)).transpose()?;
    let answer = planned(&link.fly(&text.name, &text.text, asked.go_on)?)?;
    waited(answer, follower)
}

/// `nims run --dry-run`.
///
/// # Errors
/// The configuration or the mission cannot be read, or there is no starting point.
fn dry_run(place: Place<'_>, asked: &RunArgs) -> Answer<Output> {
    let (file, here) = match &asked.config {
        Some(config) => (SystemFile::load(config).map_err(Failure::bad)?, None),
        None => {
            let link = client::link(place)?;
            (system_of(&link)?, present(&link)?)
        }
    };
    let robot = file.robot_file().map_err(Failure::bad)?;
    let from = match (asked.from, here) {
        (Some(from), _) => points::position(&robot.robot().map_err(Failure::bad)?, &from)?,
        (None, Some(from)) => from,
        (None, None) => commissioning::check::virtual_start_m(&file, &robot)?.ok_or_else(|| {
            Failure::BadInput("the start of the mission is unknown; give it with --from X,Y,Z".to_owned())
        })?,
    };
    let path = command::mission_path(&asked.mission, Some(&file.planner.missions))?;
    let mission = Mission::read(&path).map_err(Failure::bad)?;
    Ok(match commissioning::check::fly(&mission, &file, &from) {
        Ok(flight) => {
            let sentence = format!("mission \"{}\" can be flown: {}", mission.name, flight.line());
            let value = json!({ "feasible": true, "segments": flight.segments, "length_m": flight.length_m,
                "duration_s": flight.duration_s, "energy_j": flight.energy_j });
            Output::new(value, sentence)
        }
        Err(why) => Output::new(
            json!({ "feasible": false, "why": why.to_string() }),
            format!("mission \"{}\" cannot be flown: {why}", mission.name),
        ),
    })
}

/// Returns the position of the node, if known.
fn present(link: &RobotLink) -> Answer<Option<[f64; 3]>> {
    let estimate = client::estimate(link, Duration::from_millis(500))?;
    Ok(estimate.filter(|estimate| estimate.valid == 1).map(|estimate| estimate.position_m))
}

/// Checks that the node can hang at rest at this point. The planner checks whether it can get there.
fn standing(robot: &Robot, at: &[f64; 3]) -> Answer {
    cable_robot::motion::check_rest(robot, &Vector3::from(*at)).map(|_| ()).map_err(Failure::bad)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mission_that_was_read_is_the_one_that_is_requested() {
        let folder = tempfile::tempdir().unwrap();
        let (file, run) = (folder.path().join("low.toml"), folder.path().join("run"));
        let low = "name = \"low\"\n[[leg]]\nline = { to_m = [4.9, 3.0, 0.4] }\n";
        std::fs::write(&file, low).unwrap();
        let text = MissionText::read(&file).unwrap();
        // The file changes after it was read, and again after the request was made.
        std::fs::write(&file, low.replace("0.4", "1.4")).unwrap();
        let request = text.request(&run, false).unwrap();
        std::fs::write(&file, "not a mission").unwrap();
        let Request::Run { mission, hash, continues: false } = request else { panic!("{request:?}") };
        assert_eq!((mission.as_str(), config::read_mission(&run, &hash).unwrap().as_str()), ("low", low));
    }

    #[test]
    fn a_parabola_is_requested_with_its_sag() {
        let goto = |path, mu| path_of(&GotoArgs { to: [1.0, 2.0, 3.0].into(), speed: None, path, mu, wait: false });
        assert_eq!(goto(PathKind::Line, None), Ok(GotoPath::Line));
        assert_eq!(goto(PathKind::Parabola, Some(0.1)), Ok(GotoPath::Parabola { mu_per_m: Some(0.1) }));
        assert_eq!(goto(PathKind::Parabola, None), Ok(GotoPath::Parabola { mu_per_m: None }));
        assert_eq!(goto(PathKind::Lateral, None), Ok(GotoPath::Lateral));
        for (path, mu) in
            [(PathKind::Line, Some(0.1)), (PathKind::Lateral, Some(0.1)), (PathKind::Parabola, Some(-0.1))]
        {
            let failure = goto(path, mu).unwrap_err();
            assert!(failure.exit_code() == 2 && failure.to_string().contains("--mu"), "{failure}");
        }
    }
}
