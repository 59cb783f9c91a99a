//! The channels that belong to the name of a process. Each has room for one publisher, so the process that publishes on
//! them owns the name.

use bus::clock::now_ns;
use bus::{Bus, BusError, PlaceKind, Publisher};
use messages::{Heartbeat, Message, SystemConfig};

use crate::bad_input::BadInput;

/// Longest time to wait for the places of a dead process, ns: another process removes its objects within milliseconds,
/// but may be delayed.
const CLEANUP_NS: u64 = 2_000_000_000;
/// Time between two attempts to open the channels of a dead process, ns.
const RETRY_NS: u64 = 20_000_000;

/// Publishers of the heartbeat and of the configuration.
type Ports = (Publisher<Heartbeat>, Publisher<SystemConfig>);

fn heartbeats(bus: &Bus) -> String {
    format!("system/heartbeat/{}", bus.process())
}

fn configuration(bus: &Bus) -> String {
    format!("system/config/{}", bus.process())
}

/// Opens the channels of the name, for a process without a predecessor.
pub(crate) fn open(bus: &Bus) -> anyhow::Result<Ports> {
    Ok((lease(bus, &heartbeats(bus))?, lease(bus, &configuration(bus))?))
}

/// Opens the channels of the name when the predecessor has closed them; returns `None` until then.
pub(crate) fn take_over(bus: &Bus) -> Result<Option<Ports>, BusError> {
    let heartbeat = match bus.publisher(&heartbeats(bus)) {
        Err(error) if is_taken(&error) => return Ok(None),
        other => other?,
    };
    match bus.publisher(&configuration(bus)) {
        Err(error) if is_taken(&error) => Ok(None),
        other => Ok(Some((heartbeat, other?))),
    }
}

/// Opens a channel. Waits while another process removes the objects of a killed process of the same name.
fn lease<T: Message>(bus: &Bus, channel: &str) -> anyhow::Result<Publisher<T>> {
    let give_up = now_ns() + CLEANUP_NS;
    let name = bus.process();
    loop {
        match bus.publisher(channel) {
            Ok(port) => return Ok(port),
            Err(error) if !is_taken(&error) => return Err(error.into()),
            Err(_) if now_ns() < give_up && !lives(bus, name) => {
                bus::clock::sleep_until(now_ns() + RETRY_NS);
                bus.clean();
            }
            Err(_) => return Err(BadInput(already_runs(bus, name)).into()),
        }
    }
}

/// Returns whether the place of the publisher is taken. Any other limit that is reached stays so.
fn is_taken(error: &BusError) -> bool {
    matches!(error, BusError::Full { what: PlaceKind::Publishers, .. })
}

/// Returns whether another process of that name runs in the domain.
fn lives(bus: &Bus, name: &str) -> bool {
    bus.domain().alive().iter().any(|node| node.name == name && node.pid != std::process::id())
}

fn already_runs(bus: &Bus, name: &str) -> String {
    let domain = bus.domain();
    let other = domain.alive().into_iter().find(|node| node.name == name && node.pid != std::process::id());
    match other {
        Some(node) => format!(
            "a process named `{name}` already runs in the domain `{}` (process {}): stop it first, or give this process another --name",
            domain.name(),
            node.pid
        ),
        None => format!(
            "a process named `{name}` was killed in the domain `{}`, and its objects cannot be removed: end every process there and start again",
            domain.name()
        ),
    }
}
