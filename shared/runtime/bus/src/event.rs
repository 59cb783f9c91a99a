//! Opening an event that another process may be creating at the same time.

use iceoryx2::prelude::ipc;
use iceoryx2::service::builder::event::{Builder, EventCreateError, EventOpenError};
use iceoryx2::service::port_factory::event::PortFactory;

use crate::clock::{now_ns, sleep_until};
use crate::{BusError, Domain};

/// An open event.
pub(crate) type Event = PortFactory<ipc::Service>;

/// Opens an event with as many places as it has, or creates it: a process that joined with another number of places may
/// have created it. Waits until `give_up` while another process creates it; returns `None` if all its places for
/// processes are taken.
pub(crate) fn open_or_create(
    domain: &Domain,
    name: &str,
    builder: impl Fn() -> Builder<ipc::Service>,
    create: impl Fn(Builder<ipc::Service>) -> Result<Event, EventCreateError>,
    give_up: u64,
) -> Result<Option<Event>, BusError> {
    loop {
        let error = match builder().open() {
            Ok(event) => return Ok(Some(event)),
            Err(EventOpenError::ExceedsMaxNumberOfNodes) => return Ok(None),
            Err(EventOpenError::DoesNotExist) => match create(builder()) {
                Ok(event) => return Ok(Some(event)),
                Err(EventCreateError::AlreadyExists | EventCreateError::IsBeingCreatedByAnotherInstance) => None,
                // What a process that died while it created the event has left.
                Err(error @ EventCreateError::ServiceInCorruptedState) => Some(format!("{error:?}")),
                // Waiting does not help, and looking for what is half made costs the robot.
                Err(error) => return Err(BusError::failed(name, "make its event", &error)),
            },
            Err(error) => Some(format!("{error:?}")),
        };
        if now_ns() > give_up {
            return Err(BusError::unfinished(name, error));
        }
        domain.remove_half_made();
        sleep_until(now_ns() + 2_000_000);
    }
}
