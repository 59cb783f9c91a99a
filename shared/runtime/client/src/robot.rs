//! Finding a running robot, and reading its samples.

use bus::{Bus, Domain, Participant};
use command::{Answer, Failure};
use messages::{OperatorRequest, Request, put_sentence};
use robot_state::Reason;
use robot_state::answers::{Detail, detail};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Process that moves the robot.
pub const MOTOR_IO: &str = "motor-io";
/// Process that plans missions and single moves.
pub const PLANNER: &str = "planner";
/// Virtual motor box, which makes faults on request.
pub const VIRTUAL_BOX: &str = "motor-box";
/// Process that starts and ends the others; the name under which the supervisor joins the domain.
pub const SUPERVISOR: &str = "nims";

/// Longest wait for an answer: motor-io answers once per cycle, the planner checks a whole mission first.
pub const ANSWER: Duration = Duration::from_secs(10);
/// File in the folder of the domain in which the supervisor records its run.
pub const RUNNING_FILE: &str = "running.json";

/// Run of the supervisor of a domain.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Running {
    /// Process id of the supervisor.
    pub pid: u32,
    /// System file.
    pub system_file: PathBuf,
    /// Run folder.
    pub run: PathBuf,
}

impl Running {
    /// Reads the record of a domain; `None` without a run.
    #[must_use]
    pub fn read(domain: &Domain) -> Option<Self> {
        let text = std::fs::read_to_string(domain.root().join(RUNNING_FILE)).ok()?;
        serde_json::from_str(&text).ok()
    }
}

/// Returns whether a folder exists that only another user may enter.
fn is_closed(folder: &Path) -> bool {
    std::fs::read_dir(folder).is_err_and(|error| error.kind() == std::io::ErrorKind::PermissionDenied)
}

/// Returns the domain of that name, or the only one with running processes.
///
/// # Errors
/// No robot runs, several run, or the name is invalid.
pub fn domain(name: Option<&str>) -> Answer<Domain> {
    if let Some(name) = name {
        let domain = Domain::existing(name)?;
        return match domain {
            Some(domain) if !domain.alive().is_empty() => Ok(domain),
            _ if is_closed(Path::new(name)) => Err(Failure::NotNow(format!(
                "the domain `{name}` belongs to another user: use its gateway, see docs/access.md"
            ))),
            _ => Err(Failure::NotNow(format!(
                "no robot runs in the domain `{name}`: start it with `nims up SYSTEM.toml`"
            ))),
        };
    }
    let mut running: Vec<Domain> = Domain::all().into_iter().filter(|domain| !domain.alive().is_empty()).collect();
    match (running.pop(), running.len()) {
        (Some(only), 0) => Ok(only),
        (Some(last), _) => {
            running.push(last);
            let names: Vec<&str> = running.iter().map(Domain::name).collect();
            Err(Failure::NotNow(format!("several robots run ({}): choose one with --domain NAME", names.join(", "))))
        }
        (None, _) => Err(Failure::NotNow("no robot runs here: start one with `nims up SYSTEM.toml`".to_owned())),
    }
}

/// Returns whether a robot of this user runs: in the domain of that name, or in any. If so, a failure to reach it is no
/// reason to look for another way.
pub(crate) fn runs(name: Option<&str>) -> bool {
    match name {
        // An invalid name is no robot of another user either.
        Some(name) => Domain::existing(name).map_or(true, |found| found.is_some_and(|found| !found.alive().is_empty())),
        None => Domain::all().iter().any(|domain| !domain.alive().is_empty()),
    }
}

/// Joins the domain for the duration of one command.
///
/// # Errors
/// As [`domain`].
pub fn join(name: Option<&str>) -> Answer<Bus> {
    join_as(name, Participant::Command)
}

/// [`join`] as another party: a command that stops the robot may take every place, an observer leaves places free.
///
/// # Errors
/// As [`domain`].
pub fn join_as(name: Option<&str>, party: Participant) -> Answer<Bus> {
    bus::make_private();
    Ok(Bus::join_as(&domain(name)?, "nims-command", party)?)
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

/// An emergency stop without an answer warns after this time.
pub(crate) const UNEASY: Duration = Duration::from_secs(1);
/// Advice where no program can stop the robot.
const HARDWARE_STOP: &str = "use the hardware stop";

/// Returns the domain as [`domain`] does, but prefers one in which motor-io receives emergency stops.
pub(crate) fn listening(name: Option<&str>) -> Answer<Domain> {
    let found = match name {
        Some(name) => Domain::existing(name)?.into_iter().collect(),
        None => Domain::all(),
    };
    let mut heard: Vec<Domain> = found.into_iter().filter(bus::estop::is_heard).collect();
    match (heard.pop(), heard.is_empty()) {
        (Some(only), true) => Ok(only),
        _ => domain(name),
    }
}

/// Adds the advice to the failure of an emergency stop.
pub(crate) fn helped<T>(stopped: Answer<T>) -> Answer<T> {
    stopped.map_err(|failure| {
        let add = |why: String| if why.contains(HARDWARE_STOP) { why } else { format!("{why}; {HARDWARE_STOP}") };
        match failure {
            Failure::BadInput(why) => Failure::BadInput(add(why)),
            Failure::NotNow(why) => Failure::NotNow(add(why)),
            Failure::Refused { verdict, reason, sentence } => {
                Failure::Refused { verdict, reason, sentence: add(sentence) }
            }
        }
    })
}

/// Says that an emergency stop has no answer yet.
pub(crate) fn warn_of_silence() {
    eprintln!("nims: motor-io has not answered for {} s: {HARDWARE_STOP}; still trying", UNEASY.as_secs());
}

/// Sends an emergency stop, without a place on the bus and without shared memory. It warns after a second without an
/// answer, keeps trying, and leaves the request for a suspended motor-io.
///
/// # Errors
/// motor-io does not run, or does not answer.
pub(crate) fn emergency_stop(domain: &Domain) -> Answer<String> {
    let (body, origin) = (Request::Estop.body(), OperatorRequest::ORIGIN_ESTOP);
    let request = OperatorRequest { body, origin, ..OperatorRequest::default() };
    let answer = bus::estop::send(domain, &request, ANSWER, UNEASY, warn_of_silence);
    let mut answer = helped(answer.map_err(Failure::from))?;
    let sentence = sentence_of_stop(&answer);
    put_sentence(&mut answer.answer, &sentence);
    Failure::unless_accepted(&answer)
}

/// Returns the sentence of an answer to an emergency stop, which comes without it.
#[must_use]
pub fn sentence_of_stop(answer: &OperatorRequest) -> Detail {
    let sentence = Reason::from_request(answer).map(|reason| reason.sentence());
    sentence.unwrap_or_else(|| {
        detail(format_args!(
            "motor-io answered with number {}, which this program does not know; look whether the robot stands",
            answer.reason
        ))
    })
}

/// The sample that carries a request of a command.
///
/// # Errors
/// A text that a request cannot hold.
pub fn sample(request: &Request) -> Answer<OperatorRequest> {
    Ok(OperatorRequest { origin: OperatorRequest::ORIGIN_COMMAND, ..request.encode()? })
}
