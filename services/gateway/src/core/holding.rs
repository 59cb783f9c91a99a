//! Held motions of clients: when they end, and what ends them.

use super::{Asked, Connection, Core, NO_CLIENT, OBSERVED};
use crate::events::{Action, ClientId, Done, Motion, Ticket};
use crate::held::{Deposited, Held, SILENT_NS, is_of_gateway};
use messages::{OperatorRequest, Request, RequestAnswer};
use robot_state::Reason;
use robot_state::answers::detail;

/// Time for which it counts what motor-io has published, ns.
const SEEN_NS: u64 = 300_000_000;
/// Time after which a dead-man stop is renewed, ns: several times before it is due.
const RENEW_NS: u64 = SILENT_NS / 6;

impl Connection {
    /// The request that ends the held motion, in the name of its client.
    fn end(&self, held: &Held) -> Option<Box<OperatorRequest>> {
        let (holder, mut sample) = (self.holder.as_ref()?, held.end.encode().ok()?);
        holder.sign(&mut sample, &self.peer);
        Some(Box::new(sample))
    }
}

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

    /// Whether a motion is under way, by what motor-io has published lately.
    fn moves(&self) -> bool {
        let seen = self.motion.filter(|motion| motion.stamp_ns.saturating_add(SEEN_NS) > self.now_ns);
        seen.and_then(Motion::under_way).is_some()
    }

    /// Ends the held motion of a client, in its name.
    pub(super) fn release(&mut self, client: ClientId) {
        let Some(connection) = self.connections.get_mut(&client) else { return };
        let Some(held) = connection.held.take() else { return };
        let Some(end) = connection.end(&held) else { return };
        if held.is_asked() {
            // Its request and its end go separate ways, so motor-io may take up the end first: it is told again when
            // the request is answered.
            self.ends.after.insert(held.ticket, end.clone());
            if self.moves() {
                // The motion under way is that of another client, and the planner refuses a second one. Only if it
                // does not, there is something to end.
                return;
            }
        }
        self.end(end);
    }

    /// Ends all held motions: the gateway itself ends.
    pub(super) fn release_all(&mut self) {
        let clients: Vec<ClientId> = self.connections.keys().copied().collect();
        clients.into_iter().for_each(|client| self.release(client));
    }

    fn end(&mut self, request: Box<OperatorRequest>) {
        // The client may be gone, and waits for no answer.
        let ticket = self.ticket_of(Asked { client: NO_CLIENT, id: 0, counts: false, begins: false });
        self.ends.unanswered.insert(ticket);
        self.actions.push(Action::Ask { ticket, process: client::MOTOR_IO.to_owned(), request, mission: None });
    }

    /// Takes the answer to a call. `begins`: a motion may follow from it.
    pub(super) fn end_answered(&mut self, ticket: Ticket, answer: Option<&RequestAnswer>, begins: bool) {
        if self.ends.unanswered.remove(&ticket) {
            // An answer that the gateway made says nothing about motor-io, which may go on with the motion.
            self.ends.lost = self.ends.deposited.is_some() && answer.is_none_or(is_of_gateway);
        }
        if let Some(end) = self.ends.after.remove(&ticket)
            && begins
        {
            self.end(end);
        }
    }

    /// Deposits with motor-io what ends the held motion if this gateway ends or hangs: before the motion begins, and
    /// again and again until it is over. Only one motion can be under way, so one deposit is enough.
    pub(super) fn guard(&mut self) {
        let deposited = self.ends.deposited;
        let is_deposited = |held: &Held| deposited.is_some_and(|one| one.ticket == held.ticket);
        let moves = self.moves();
        // A motion under way that was there before the request is that of another client, and goes on.
        let guards = |held: &&Held| !held.is_asked() || !moves || is_deposited(held);
        let held = self.connections.values().filter_map(|one| Some((one, one.held.as_ref().filter(guards)?)));
        let newest = held.max_by_key(|(_, held)| (held.end == Request::Stop, held.ticket));
        match newest.and_then(|(one, held)| Some((held.ticket, one.end(held)?))) {
            Some((ticket, request)) => self.deposit(ticket, request),
            None => self.let_go(),
        }
    }

    /// Deposits what ends the motion of that call, unless it is there and young.
    fn deposit(&mut self, ticket: Ticket, request: Box<OperatorRequest>) {
        if self.ends.deposited.is_some_and(|one| one.ticket == ticket && self.now_ns < one.renew_ns) {
            return;
        }
        let (renew_ns, due_ns) = (self.now_ns + RENEW_NS, self.now_ns + SILENT_NS);
        self.ends.deposited = Some(Deposited { ticket, renew_ns, due_ns });
        // First, so that it is there before the motion.
        self.actions.insert(0, Action::Deposit { ticket, due_ns, request });
    }

    /// Withdraws the deposit when motor-io has ended its motion. Until then it stays.
    fn let_go(&mut self) {
        let Some(deposited) = self.ends.deposited else { return };
        if let Some(end) = self.ends.after.get(&deposited.ticket) {
            // The motion may still begin, and only this gateway would end it again.
            let end = end.clone();
            return self.deposit(deposited.ticket, end);
        }
        if !self.ends.unanswered.is_empty() || !self.ends.after.is_empty() {
            return;
        }
        if !self.ends.lost {
            self.actions.push(Action::Withdraw);
        } else if self.now_ns < deposited.due_ns {
            return;
        }
        (self.ends.deposited, self.ends.lost) = (None, false);
    }

    /// Answers a call whose motion was not requested, because its dead-man stop could not be deposited.
    pub(super) fn undeposited(&mut self, ticket: Ticket) {
        // Nothing of it is held, so nothing of it is ended.
        for one in self.connections.values_mut() {
            one.held.take_if(|held| held.ticket == ticket);
        }
        if self.ends.deposited.take_if(|one| one.ticket == ticket).is_some() {
            // One that was there before is still there, and falls due.
            self.ends.lost = false;
        }
        let why =
            detail("motor-io does not take the stop for the case that the gateway dies; nothing was sent, try again");
        self.answered(ticket, Done::Answer(Box::new(Reason::RobotUnreached { why }.answer())));
    }

    /// Whether a held motion may have to be ended soon.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.connections.values().any(|one| one.held.is_some())
    }

    /// Whether the end of a held motion has no answer.
    #[must_use]
    pub fn is_ending(&self) -> bool {
        !self.ends.unanswered.is_empty() || !self.ends.after.is_empty()
    }
}
