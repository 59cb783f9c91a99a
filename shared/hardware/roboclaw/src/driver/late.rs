//! Answers that were not there when the call ended that asked for them: a bus that runs inline waits for them in later
//! calls.

use serial::Transport;

use super::Bus;
use super::step::{Late, Step};
use crate::codec::{Command, Read};
use crate::packet::MAX_PACKET;
use drives::Error;

impl<T: Transport> Bus<T> {
    /// Leaves an answer to a later call. `likely_ns`: the time that it was likely to need.
    pub(super) fn leave(&mut self, late: Late, likely_ns: u64) -> Error {
        if late.command == Command::Read(Read::Version) {
            // The end of a text is not known before it is read.
            self.too_late(late.unit);
        } else {
            self.step = Step::Late(late);
        }
        match self.call_ends_ns < late.sent_ns + likely_ns {
            true => Error::Busy { port: self.port() },
            false => self.unanswered(),
        }
    }

    /// Waits on for an answer that an earlier call left. The cycle of its question is over, so it is of no use any
    /// more; but after it no older answer can follow.
    pub(super) fn await_late(&mut self, late: Late, deadline_ns: u64) -> Result<(), Error> {
        let left = late.wanted - late.got;
        let mut room = [0; MAX_PACKET + 1];
        // A byte more than is missing shows that the port is not empty.
        let until_ns = late.until_ns.min(deadline_ns);
        // A call that begins after the wait has ended is no sign that the machine stood still.
        let got = match self.transport.now_ns() < until_ns {
            true => self.fill_awake(&mut room[..=left], left, until_ns)?,
            false => self.fill(&mut room[..=left], left, until_ns)?,
        };
        let late = late.with(room.get(..got.min(left)).unwrap_or_default());
        let now_ns = self.transport.now_ns();
        if got < left && now_ns < late.until_ns {
            self.step = Step::Late(late);
            return Err(self.unanswered());
        }
        if got < left {
            self.too_late(late.unit);
        } else if got > left || !late.answers(self.address(late.unit)) {
            self.counters.garbled += 1;
            self.out_of_step(late.unit);
        } else {
            self.step = Step::Settled;
        }
        Ok(())
    }

    /// The error of a call that ended before an answer. A simulated unit that has no processor is not to blame.
    fn unanswered(&self) -> Error {
        let starved = self.transport.clock().is_some_and(|clock| clock.device_wants_to_run());
        let port = self.port();
        if starved { Error::Busy { port } } else { Error::Unanswered { port } }
    }
}
