//! Motions that go on only while their client says that their control is held.

use crate::events::{Motion, Ticket};
use messages::{MotorAuthority, OperatorRequest, Request, RequestAnswer};
use robot_state::Reason;
use std::collections::{BTreeMap, BTreeSet};

/// Time without a sign of the client after which a held motion ends, and age from which a sign counts as none, ns.
pub(crate) const SILENT_NS: u64 = 300_000_000;

/// Numbers of the reasons that the gateway gives, as `robot_state::Reason` lists them.
const OF_GATEWAY: std::ops::Range<u16> = 450..500;

/// How far a held motion has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Its request has no answer.
    Asked,
    /// It was accepted at that instant, ns; or its answer did not come, so that it may begin or have begun.
    Begun(u64),
    /// motor-io follows it: the number of the motion, 0 for a jog.
    Moving(u32),
}

/// A held motion.
#[derive(Debug)]
pub(crate) struct Held {
    /// The call that requested it.
    pub(crate) ticket: Ticket,
    /// The request that ends it.
    pub(crate) end: Request,
    beat_ns: u64,
    phase: Phase,
}

/// The ends of held motions that are under way, also for the case that this gateway does not come to them.
#[derive(Debug, Default)]
pub(crate) struct Ends {
    /// What ends a motion that was released before its request was answered, by the call that requested it: also a
    /// second time, because motor-io may take up the motion after its end.
    pub(crate) after: BTreeMap<Ticket, Box<OperatorRequest>>,
    /// What was sent to end a motion and has no answer.
    pub(crate) unanswered: BTreeSet<Ticket>,
    /// An end did not reach motor-io, so what is deposited is left to fall due.
    pub(crate) lost: bool,
    pub(crate) deposited: Option<Deposited>,
}

/// The dead-man stop that is deposited with motor-io.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Deposited {
    /// The call that requested its motion.
    pub(crate) ticket: Ticket,
    /// When it is renewed, ns.
    pub(crate) renew_ns: u64,
    /// When motor-io carries it out, ns.
    pub(crate) due_ns: u64,
}

impl Held {
    /// A motion that was requested just now.
    pub(crate) fn new(ticket: Ticket, end: Request, beat_ns: u64) -> Self {
        Self { ticket, end, beat_ns, phase: Phase::Asked }
    }

    /// Takes a sign of the client that was made at that instant.
    pub(crate) fn beat(&mut self, now_ns: u64, made_ns: u64) {
        if !is_old(now_ns, made_ns) {
            self.beat_ns = self.beat_ns.max(made_ns.min(now_ns));
        }
    }

    /// Whether the client has been silent for too long.
    pub(crate) fn is_over(&self, now_ns: u64) -> bool {
        is_old(now_ns, self.beat_ns)
    }

    /// Whether its request has no answer.
    pub(crate) fn is_asked(&self) -> bool {
        self.phase == Phase::Asked
    }

    /// Takes the answer to its request. Returns whether a motion may follow from it.
    pub(crate) fn answered(&mut self, now_ns: u64, answer: &RequestAnswer) -> bool {
        self.phase = Phase::Begun(now_ns);
        may_begin(answer)
    }

    /// Follows what motor-io does. Returns whether the motion has ended.
    pub(crate) fn has_ended(&mut self, seen: Motion) -> bool {
        match self.phase {
            // What motor-io did before says nothing about this motion.
            Phase::Begun(since_ns) if seen.stamp_ns > since_ns => {
                self.phase = seen.under_way().map_or(self.phase, Phase::Moving);
                false
            }
            Phase::Asked | Phase::Begun(_) => false,
            Phase::Moving(number) => seen.under_way() != Some(number),
        }
    }
}

/// Whether a sign that was made at that instant is too old to count.
pub(crate) fn is_old(now_ns: u64, made_ns: u64) -> bool {
    now_ns >= made_ns.saturating_add(SILENT_NS)
}

/// Whether a motion may follow from a request with this answer: it was accepted, or what became of it is not known.
pub(crate) fn may_begin(answer: &RequestAnswer) -> bool {
    let unknown = Reason::RobotUnreached { why: robot_state::answers::detail("") }.code();
    answer.accepted == OperatorRequest::ACCEPTED || answer.reason == unknown
}

/// Whether the gateway itself has made an answer to a request: the request may not have reached its process.
pub(crate) fn is_of_gateway(answer: &RequestAnswer) -> bool {
    OF_GATEWAY.contains(&answer.reason)
}

impl Motion {
    /// The number of the motion that motor-io has, also a paused one; 0: a jog. `None`: none.
    pub(crate) fn under_way(self) -> Option<u32> {
        match self.mode {
            MotorAuthority::MODE_JOGGING => Some(0),
            _ => Some(self.number).filter(|number| *number != 0),
        }
    }
}

/// Returns the request that ends a held motion; `None` if the request may not be held. A hold keeps the motion of a
/// mission, and a jog is over with it; a move is dropped.
pub(crate) fn end_of(request: &Request) -> Option<Request> {
    match request {
        Request::Jog { .. } => Some(Request::Hold),
        Request::Goto { .. } => Some(Request::Stop),
        _ => None,
    }
}

/// Whether a request begins a motion, so that no other one is under way once it is accepted.
pub(crate) fn begins(request: &Request) -> bool {
    matches!(request, Request::Jog { .. } | Request::Goto { .. } | Request::Run { .. })
}

#[cfg(test)]
mod tests {
    use super::*;
    use robot_state::answers::detail;

    #[test]
    fn the_reasons_of_the_gateway_are_told_from_those_of_motor_io() {
        let why = || detail("");
        let own = [Reason::RobotUnreached { why: why() }, Reason::NotAsked { why: why() }, Reason::RequesterGone];
        assert!(own.iter().all(|reason| is_of_gateway(&reason.answer())));
        let others = [Reason::Stopping, Reason::JogEnds, Reason::RobotJogging, Reason::EndedByDisarm];
        assert!(!others.iter().any(|reason| is_of_gateway(&reason.answer())));
        assert!(!is_of_gateway(&RequestAnswer::default()));
    }
}
