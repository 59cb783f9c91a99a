//! The channels that belong to the name of a process. They have room for one publisher, which is the process of that name.

use bus::clock::now_ns;
use bus::{Bus, BusError, Publisher};
use messages::{Heartbeat, Message, SystemConfig};

use crate::bad_input::BadInput;

/// What a dead process has left is removed within milliseconds; the process that removes it may be delayed for so long, ns.
const LEAVING_NS: u64 = 2_000_000_000;
/// Between two attempts to take the place of a dead process, ns.
const RETRY_NS: u64 = 20_000_000;

/// The heartbeats of the process, and what it works with.
type Ports = (Publisher<Heartbeat>, Publisher<SystemConfig>);

fn heartbeats(bus: &Bus) -> String {
    format!("system/heartbeat/{}", bus.process())
}

fn configuration(bus: &Bus) -> String {
    format!("system/config/{}", bus.process())
}

/// Takes them, for a process that has no predecessor.
pub(crate) fn take(bus: &Bus) -> anyhow::Result<Ports> {
    Ok((lease(bus, &heartbeats(bus))?, lease(bus, &configuration(bus))?))
}

/// Takes them once the predecessor has let go of them; `None` until then.
pub(crate) fn take_over(bus: &Bus) -> Result<Option<Ports>, BusError> {
    let heartbeat = match bus.publisher(&heartbeats(bus)) {
        Err(BusError::Full { .. }) => return Ok(None),
        other => other?,
    };
    match bus.publisher(&configuration(bus)) {
        Err(BusError::Full { .. }) => Ok(None),
        other => Ok(Some((heartbeat, other?))),
    }
}

/// What a killed process of the same name has left may just be in the hands of another process that cleans up: that takes a moment.
fn lease<T: Message>(bus: &Bus, channel: &str) -> anyhow::Result<Publisher<T>> {
    let give_up = now_ns() + LEAVING_NS;
    let name = bus.process();
    loop {
        match bus.publisher(channel) {
            Ok(port) => return Ok(port),
            Err(BusError::Full { .. }) if now_ns() < give_up && !lives(bus, name) => {
                bus::clock::sleep_until(now_ns() + RETRY_NS);
                bus.clean();
            }
            Err(BusError::Full { .. }) => return Err(BadInput(already_runs(bus, name)).into()),
            Err(other) => return Err(other.into()),
        }
    }
}

/// Whether another process of that name lives in the domain.
fn lives(bus: &Bus, name: &str) -> bool {
    bus.domain().alive().iter().any(|node| node.name == name && node.pid != std::process::id())
}

fn already_runs(bus: &Bus, name: &str) -> String {
    let domain = bus.domain();
    let other = domain.alive().into_iter().find(|node| node.name == name && node.pid != std::process::id());
    match other {
        Some(node) => format!(
            "a process named `{name}` already runs in the domain `{}` (process {}): stop it first, or give this one another --name",
            domain.name(),
            node.pid
        ),
        None => format!(
            "a process named `{name}` was killed in the domain `{}`, and what it left cannot be removed: end every process there and start again",
            domain.name()
        ),
    }
}
