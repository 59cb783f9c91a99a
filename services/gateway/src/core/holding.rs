//! Held motions of clients: when they end, and what ends them.

use super::{Asked, Core, NO_CLIENT, OBSERVED};
use crate::events::{Action, ClientId};
use crate::held::Held;
use messages::OperatorRequest;

/// Time for which it counts what motor-io has published, ns.
const SEEN_NS: u64 = 300_000_000;

impl Core {
    /// Stores the held motion of a client.
    pub(super) fn hold(&mut self, client: ClientId, held: Held) {
        if let Some(connection) = self.connections.get_mut(&client) {
            (connection.held, connection.holds) = (Some(held), true);
        }
    }

    /// Observes what motor-io does while a client is there that has held a motion, and always where a motion without an
    /// operator is held.
    pub(super) fn observe(&mut self) {
        let needed = self.roles.hold_without_operator_ns().is_some() || self.connections.values().any(|one| one.holds);
        if needed == self.observed {
            return;
        }
        self.observed = needed;
        let (client, id) = (NO_CLIENT, 0);
        self.actions.push(if needed {
            Action::Subscribe { client, id, channel: OBSERVED.to_owned(), rate_hz: None }
        } else {
            self.motion = None;
            Action::Unsubscribe { client, id }
        });
    }

    /// Ends the held motion of a client, in its name.
    pub(super) fn release(&mut self, client: ClientId) {
        let Some(connection) = self.connections.get_mut(&client) else { return };
        let (Some(held), Some(holder)) = (connection.held.take(), connection.holder.clone()) else { return };
        let (peer, Ok(mut sample)) = (&connection.peer, held.end.encode()) else { return };
        holder.sign(&mut sample, peer);
        let seen = self.motion.filter(|motion| motion.stamp_ns.saturating_add(SEEN_NS) > self.now_ns);
        if held.is_asked() && seen.is_some_and(|motion| motion.under_way().is_some()) {
            // The motion under way is that of another client, and the planner refuses a second one. Only if it does
            // not, there is something to end.
            self.ends.insert(held.ticket, Box::new(sample));
            return;
        }
        self.end(Box::new(sample));
    }

    pub(super) fn end(&mut self, request: Box<OperatorRequest>) {
        // The client may be gone, and waits for no answer.
        let ticket = self.ticket_of(Asked { client: NO_CLIENT, id: 0, counts: false, begins: false });
        self.actions.push(Action::Ask { ticket, process: client::MOTOR_IO.to_owned(), request, mission: None });
    }

    /// Whether a held motion may have to be ended soon.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.connections.values().any(|one| one.held.is_some())
    }
}
