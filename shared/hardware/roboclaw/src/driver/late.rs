//! Answers that were not there when the call ended that asked for them: a bus that runs inline waits for them in later
//! calls.

use serial::Transport;

use super::step::{Late, Step};
use super::{Bus, Phase};
use crate::codec::{Command, Read};
use crate::packet::MAX_PACKET;
use drives::Error;

/// A question that was sent in the last part of a call, of so many of a usual one, was sent too late for that call: the
/// answer of a drive that is in order takes up to a quarter of a cycle with a slow adapter. A call that began late is
/// shorter, and the drive needs as long.
const PARTS: u64 = 3;
/// Calls in which the length of a usual one adapts to shorter ones: a busy computer makes some of them short.
const ADAPTING_CALLS: u64 = 64;

impl<T: Transport> Bus<T> {
    /// Leaves an answer to a later call. It is the drive that is late, where the question was sent in time: how long
    /// its answers have lately taken is no excuse.
    pub(super) fn leave(&mut self, late: Late) -> Error {
        if late.command == Command::Read(Read::Version) {
            // The end of a text is not known before it is read.
            self.too_late(late.unit);
        } else {
            self.step = Step::Late(late);
        }
        match late.sent_ns + self.usual_call_ns / PARTS > self.call_ends_ns {
            true => Error::Busy { port: self.port() },
            false => self.unanswered(),
        }
    }

    /// Learns how long the calls of a cycle usually are from the present one. One that is far longer is unusual: taken
    /// for the usual one, it would excuse a drive that is lost for hundreds of calls.
    pub(super) fn learn_call(&mut self, deadline_ns: u64) {
        let adapted_ns = self.usual_call_ns - self.usual_call_ns / ADAPTING_CALLS;
        let present_ns = deadline_ns.saturating_sub(self.call_began_ns);
        let most_ns = if self.usual_call_ns == 0 { present_ns } else { 2 * self.usual_call_ns };
        self.usual_call_ns = adapted_ns.max(present_ns.min(most_ns));
    }

    /// Waits on for an answer that an earlier call left. The cycle of its question is over, so an acknowledgement
    /// or a count is of no use any more; but after it no older answer can follow.
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
            self.use_late(late);
        }
        Ok(())
    }

    /// A value that changes slowly is of use in a later cycle too: it has the time of its question.
    fn use_late(&mut self, late: Late) {
        let ready = self.units.get(late.unit).is_some_and(|unit| unit.phase == Phase::Ready);
        if let Command::Read(read) = late.command
            && ready
            && read != Read::Encoders
            && let Some(reply) = late.reply(read, self.address(late.unit))
        {
            self.use_slow(late.unit, reply, late.stamp_ns);
        }
    }

    /// The error of a call that ended before an answer. A simulated unit that has no processor is not to blame.
    fn unanswered(&self) -> Error {
        let starved = self.transport.clock().is_some_and(|clock| clock.device_wants_to_run());
        let port = self.port();
        if starved { Error::Busy { port } } else { Error::Unanswered { port } }
    }
}
