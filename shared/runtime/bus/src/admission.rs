//! Admission of new ports: whether a place of the channel and enough shared memory are left for them.

use std::time::Duration;

use iceoryx2::prelude::PortName;

use crate::memory::{CONNECTION_BYTES, SHORT, need, room};
use crate::places::{Participant, Refused};
use crate::{Bus, BusError};

/// Number of further attempts to create a port: another process may be leaving, or giving back a place in excess.
const ATTEMPTS: usize = 10;
const PAUSE: Duration = Duration::from_millis(20);

impl Bus {
    /// Creates a port if this process's kind has a place left; `taken` returns the names of the existing ports.
    pub(crate) fn take_place<R, E>(
        &self,
        limit: usize,
        taken: impl Fn() -> Vec<PortName>,
        make: impl Fn() -> Result<R, E>,
    ) -> Result<R, Refused<E>> {
        let party = self.party;
        // A process that has died since this one joined may hold a place.
        let is_free = || party.within(&taken(), limit, 1).then_some(()).ok_or(());
        if is_free().or_else(|()| self.after_cleaning(is_free)).is_err() {
            return Err(Refused::NoPlace(party.ceiling(limit)));
        }
        let mut port = make().or_else(|_| self.after_cleaning(&make));
        for _ in 0..if party == Participant::Guest { 0 } else { ATTEMPTS } {
            if port.is_ok() || taken().len() < limit {
                break;
            }
            std::thread::sleep(PAUSE);
            port = make();
        }
        let port = port.map_err(Refused::Error)?;
        // Check again: several processes may have created a port at the same time.
        if party.within(&taken(), limit, 0) { Ok(port) } else { Err(Refused::NoPlace(party.ceiling(limit))) }
    }

    /// Checks that `bytes` of shared memory can be allocated in addition to the reserved margin, before several objects
    /// are created.
    ///
    /// # Errors
    /// [`BusError::NoMemory`] if there is not enough memory.
    pub fn room_for(&self, bytes: usize, what: &str) -> Result<(), BusError> {
        self.need(bytes, what)
    }

    /// Creates a port and checks that all its connections have memory. iceoryx2 also creates a port if a connection has
    /// none, and that connection never delivers a sample.
    pub(crate) fn make_complete<R>(
        &self,
        what: &str,
        make: impl FnOnce() -> Result<R, BusError>,
    ) -> Result<R, BusError> {
        let before = SHORT.get();
        let port = make()?;
        if SHORT.get() == before {
            return Ok(port);
        }
        drop(port);
        let needed = CONNECTION_BYTES as u64 + self.party.margin();
        Err(BusError::NoMemory { what: what.to_owned(), needed, free: room().map_or(0, |(_, free)| free) })
    }

    /// Checks that `bytes` can be allocated, so that neither this object nor one that another process is creating
    /// remains incomplete. The margin that must remain depends on the kind of participant.
    pub(crate) fn need(&self, bytes: usize, what: &str) -> Result<(), BusError> {
        need(bytes, self.party, what)
    }
}
