//! Finding the robot that runs, and talking to it.

use crate::failure::{Answer, Failure};
use bus::{Bus, Domain};
use messages::{Message, MotorAuthority, NodeEstimate, OperatorRequest, SLOT_NAMES};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// How long a process may take to answer a request: motor-io looks once per cycle, the planner checks a whole mission first.
const ANSWER: Duration = Duration::from_secs(10);
/// Where the supervisor leaves word of what it runs, in the folder of the domain.
pub const RUNNING_FILE: &str = "running.json";

/// What the supervisor of a domain runs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Running {
    /// Its process id.
    pub pid: u32,
    /// Box file.
    pub box_file: PathBuf,
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
            _ => {
                Err(Failure::NotNow(format!("no robot runs in the domain `{name}`: start it with `nims up BOX.toml`")))
            }
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
        (None, _) => Err(Failure::NotNow("no robot runs here: start one with `nims up BOX.toml`".to_owned())),
    }
}

/// Joins the domain that is meant, for the time of one command.
///
/// # Errors
/// As [`domain`].
pub fn join(name: Option<&str>) -> Answer<Bus> {
    bus::make_private();
    Ok(Bus::join(&domain(name)?, "nims-command")?)
}

/// Asks a process and waits for its answer.
///
/// # Errors
/// The process does not run, or does not answer.
pub fn ask(bus: &Bus, process: &str, request: &OperatorRequest) -> Answer<OperatorRequest> {
    Ok(bus.client(process)?.ask(request, ANSWER)?)
}

/// How long an emergency stop waits in silence.
const UNEASY: Duration = Duration::from_secs(1);
/// What helps where no program does.
const HARDWARE_STOP: &str = "use the hardware stop";

/// Asks for an emergency stop: speaks up when there is no answer for a second, goes on trying, and leaves the request behind for a
/// motor-io that stands still.
///
/// # Errors
/// motor-io does not run, or does not answer.
pub fn ask_for_emergency_stop(bus: &Bus, request: &OperatorRequest) -> Answer<OperatorRequest> {
    let helped = |error: bus::BusError| Failure::NotNow(format!("{error}; {HARDWARE_STOP}"));
    let mut client = bus.client("motor-io").map_err(helped)?;
    let answer = client.ask_aloud(request, ANSWER, UNEASY, || {
        eprintln!("nims: motor-io has not answered for {} s: {HARDWARE_STOP}; still trying", UNEASY.as_secs());
    });
    if answer.is_err() {
        client.leave_behind();
    }
    answer.map_err(helped)
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
            return Ok(messages::blended_estimate(said.as_ref(), [newest[0].as_ref(), newest[1].as_ref()]));
        }
        waiter.wait_until(Some(deadline))?;
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
