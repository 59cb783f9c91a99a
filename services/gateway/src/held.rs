//! Motions that go on only while their client says that their control is held.

use crate::events::Ticket;
use messages::Request;

/// Time without a sign of the client after which a held motion ends, ns.
pub(crate) const SILENT_NS: u64 = 300_000_000;

/// A held motion.
#[derive(Debug)]
pub(crate) struct Held {
    /// The call that requested it.
    pub(crate) ticket: Ticket,
    /// When the client last said that the control is held.
    pub(crate) beat_ns: u64,
    /// The request that ends it.
    pub(crate) end: Request,
}

impl Held {
    /// Whether the client has been silent for too long.
    pub(crate) fn is_over(&self, now_ns: u64) -> bool {
        now_ns >= self.beat_ns.saturating_add(SILENT_NS)
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
