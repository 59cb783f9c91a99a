//! Admission of new ports: whether a place of the channel and enough shared memory are left for them.

use std::time::Duration;

use iceoryx2::prelude::PortName;

use crate::memory::{CONNECTION_BYTES, SHORT, need, room};
use crate::places::{Party, Refused};
use crate::{Bus, BusError};

/// Another process may just be leaving, or finding out that it has no place: so often it is tried again, after so long.
const ATTEMPTS: usize = 10;
const PAUSE: Duration = Duration::from_millis(20);

impl Bus {
    /// Makes a port if this process's kind has a place left, among those whose names `taken` gives.
    pub(crate) fn take_place<R, E>(
        &self,
        limit: usize,
        taken: impl Fn() -> Vec<PortName>,
        make: impl Fn() -> Result<R, E>,
    ) -> Result<R, Refused<E>> {
        let party = self.party;
        // a place may be held by a process that has died since this one joined
        if !party.within(&taken(), limit, 1) {
            self.clean();
            if !party.within(&taken(), limit, 1) {
                return Err(Refused::NoPlace(party.ceiling(limit)));
            }
        }
        let mut port = make().or_else(|_| self.after_cleaning(&make));
        for _ in 0..if party == Party::Guest { 0 } else { ATTEMPTS } {
            if port.is_ok() || taken().len() < limit {
                break;
            }
            std::thread::sleep(PAUSE);
            port = make();
        }
        let port = port.map_err(Refused::Error)?;
        // several may have come at once
        if party.within(&taken(), limit, 0) { Ok(port) } else { Err(Refused::NoPlace(party.ceiling(limit))) }
    }

    /// Whether there is shared memory for so many bytes more, beyond the margin that is always kept: for who is about to make several things.
    ///
    /// # Errors
    /// [`BusError::NoMemory`] if not.
    pub fn room_for(&self, bytes: usize, what: &str) -> Result<(), BusError> {
        self.need(bytes, what)
    }

    /// Makes a port with all of its memory. iceoryx2 makes one also where a connection of it finds no room, and hears nothing on that connection
    /// for good.
    pub(crate) fn whole<R>(&self, what: &str, make: impl FnOnce() -> Result<R, BusError>) -> Result<R, BusError> {
        let before = SHORT.get();
        let port = make()?;
        if SHORT.get() == before {
            return Ok(port);
        }
        drop(port);
        let needed = CONNECTION_BYTES as u64 + self.party.margin();
        Err(BusError::NoMemory { what: what.to_owned(), needed, free: room().map_or(0, |(_, free)| free) })
    }

    /// Refuses to make something for which there is no room, so that neither this nor anything that is just being made elsewhere gets stuck
    /// half way. The margin that has to remain is larger for who only looks on.
    pub(crate) fn need(&self, bytes: usize, what: &str) -> Result<(), BusError> {
        need(bytes, self.party, what)
    }
}
