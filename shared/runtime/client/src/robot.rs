//! Finding the robot that runs, and talking to it.

use bus::{Bus, Domain, Party};
use command::{Answer, Failure};
use messages::{
    Message, MotorAuthority, NodeEstimate, OperatorRequest, RecorderStatus, Request, Rule, SLOT_NAMES, blended_estimate,
};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// How long a process may take to answer a request: motor-io looks once per cycle, the planner checks a whole mission first.
pub const ANSWER: Duration = Duration::from_secs(10);
/// Where the supervisor leaves word of what it runs, in the folder of the domain.
pub const RUNNING_FILE: &str = "running.json";

/// What the supervisor of a domain runs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Running {
    /// Its process id.
    pub pid: u32,
    /// System file.
    pub system_file: PathBuf,
    /// Run folder.
    pub run: PathBuf,
}

impl Running {
    /// As the supervisor of this domain wrote it; `None` if there is none.
    #[must_use]
    pub fn of(domain: &Domain) -> Option<Self> {
        let text = std::fs::read_to_string(domain.root().join(RUNNING_FILE)).ok()?;
        serde_json::from_str(&text).ok()
    }
}

/// Whether a folder is there that only somebody else may enter.
fn is_closed(folder: &Path) -> bool {
    std::fs::read_dir(folder).is_err_and(|error| error.kind() == std::io::ErrorKind::PermissionDenied)
}

/// The domain that is meant: the one of that name, or the only one in which something runs.
///
/// # Errors
/// No robot runs, several do, or the name cannot be one.
pub fn domain(name: Option<&str>) -> Answer<Domain> {
    if let Some(name) = name {
        let domain = Domain::existing(name)?;
        return match domain {
            Some(domain) if !domain.alive().is_empty() => Ok(domain),
            _ if is_closed(Path::new(name)) => Err(Failure::NotNow(format!(
                "the domain `{name}` belongs to another user: command its robot as that user (sudo -u USER nims ..), see docs/access.md"
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
            Err(Failure::NotNow(format!("several robots run ({}): say which with --domain NAME", names.join(", "))))
        }
        (None, _) => Err(Failure::NotNow("no robot runs here: start one with `nims up SYSTEM.toml`".to_owned())),
    }
}

/// Joins the domain that is meant, for the time of one command.
///
/// # Errors
/// As [`domain`].
pub fn join(name: Option<&str>) -> Answer<Bus> {
    join_as(name, Party::Command)
}

/// The same for a command that stops the robot, which has all places, or for one that only looks on.
///
/// # Errors
/// As [`domain`].
pub fn join_as(name: Option<&str>, party: Party) -> Answer<Bus> {
    bus::make_private();
    Ok(Bus::join_as(&domain(name)?, "nims-command", party)?)
}

/// Sends a request to a process and waits for its answer.
///
/// # Errors
/// A text that a request cannot hold; the process does not run, or does not answer.
pub fn ask(bus: &Bus, process: &str, request: &Request) -> Answer<OperatorRequest> {
    Ok(bus.client(process)?.ask(&crate::requests::sample(request)?, ANSWER)?)
}

/// How long an emergency stop waits in silence.
const UNEASY: Duration = Duration::from_secs(1);
/// What helps where no program does.
const HARDWARE_STOP: &str = "use the hardware stop";

/// The domain that is meant, as [`domain`] finds it; but where motor-io listens for emergency stops, nothing else is asked for.
fn listening(name: Option<&str>) -> Answer<Domain> {
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

/// Asks for an emergency stop, by a way that needs no place on the bus and no memory: speaks up when there is no answer for a second, goes on
/// trying, and leaves the request behind for a motor-io that stands still.
///
/// # Errors
/// motor-io does not run, or does not answer.
pub fn emergency_stop(name: Option<&str>) -> Answer<String> {
    let helped = |error: bus::BusError| Failure::NotNow(format!("{error}; {HARDWARE_STOP}"));
    let (body, origin) = (Request::Estop.body(), OperatorRequest::ORIGIN_ESTOP);
    let request = OperatorRequest { body, origin, ..OperatorRequest::default() };
    let answer = bus::estop::send(&listening(name)?, &request, ANSWER, UNEASY, || {
        eprintln!("nims: motor-io has not answered for {} s: {HARDWARE_STOP}; still trying", UNEASY.as_secs());
    });
    Failure::of(&answer.map_err(helped)?)
}

/// The newest estimate of those in charge, if there is one within `patience`.
///
/// # Errors
/// A channel cannot be opened.
pub fn estimate(bus: &Bus, patience: Duration) -> Answer<Option<NodeEstimate>> {
    let mut authority = bus.subscriber::<MotorAuthority>("motor/authority")?;
    let [a, b] = SLOT_NAMES.map(|slot| format!("node/estimate/{slot}"));
    let mut estimates = [bus.subscriber::<NodeEstimate>(&a)?, bus.subscriber::<NodeEstimate>(&b)?];
    let (mut newest, mut said) = ([None; 2], None);
    let deadline = bus::clock::now_ns() + patience.as_nanos() as u64;
    let mut waiter = bus.waiter(&[&a, &b])?;
    loop {
        for (newest, estimates) in newest.iter_mut().zip(&mut estimates) {
            *newest = estimates.latest()?.or(*newest);
        }
        said = authority.latest()?.or(said);
        let late = bus::clock::now_ns() >= deadline;
        if late || (said.is_some() && newest.iter().any(Option::is_some)) {
            return Ok(blended_estimate(said.as_ref(), [newest[0].as_ref(), newest[1].as_ref()], Rule::History));
        }
        waiter.wait_until(Some(deadline))?;
    }
}

/// The recorder says every second how it is doing; from one that has said nothing for this long nothing is heard any more, ns.
const RECORDER_NS: u64 = 2_500_000_000;

/// Why nothing of this robot is being recorded; `None` while it is.
///
/// # Errors
/// The channel cannot be opened.
pub fn unrecorded(bus: &Bus) -> Answer<Option<String>> {
    let mut rows = bus.subscriber::<RecorderStatus>("recorder/status")?;
    let deadline = bus::clock::now_ns() + RECORDER_NS;
    let mut waiter = bus.waiter(&["recorder/status"])?;
    loop {
        // What is kept of the past says nothing about a recorder that has hung since.
        let row = rows.latest()?.filter(|row| row.header.stamp_ns + RECORDER_NS > bus::clock::now_ns());
        if let Some(row) = row {
            return Ok(unrecorded_of(&row));
        }
        if bus::clock::now_ns() >= deadline {
            return Ok(Some("the recorder does not run or hangs; see nims status".to_owned()));
        }
        waiter.wait_until(Some(deadline))?;
    }
}

/// Why the recorder that says this records nothing.
#[must_use]
pub fn unrecorded_of(row: &RecorderStatus) -> Option<String> {
    let reason = messages::text_of(&row.reason);
    match row.state {
        RecorderStatus::STATE_RECORDING => None,
        _ if !reason.is_empty() => Some(reason),
        RecorderStatus::STATE_DISK_FULL => Some("the disk is full".to_owned()),
        _ => Some("the recorder cannot write".to_owned()),
    }
}

/// The newest sample of a channel, waiting for it at most as long as said.
///
/// # Errors
/// The channel cannot be opened.
pub fn newest<T: Message>(bus: &Bus, channel: &str, patience: Duration) -> Answer<Option<T>> {
    let mut subscriber = bus.subscriber::<T>(channel)?;
    let deadline = bus::clock::now_ns() + patience.as_nanos() as u64;
    let mut waiter = bus.waiter(&[channel])?;
    loop {
        if let Some(sample) = subscriber.latest()? {
            return Ok(Some(sample));
        }
        if bus::clock::now_ns() >= deadline {
            return Ok(None);
        }
        waiter.wait_until(Some(deadline))?;
    }
}
