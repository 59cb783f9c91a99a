//! The seat of the one who flies from a page, and what is done when no person who may fly is there.

use super::{Asked, Connection, Core, Holder, NO_CLIENT};
use crate::events::{Action, ClientId};
use crate::roles::Role;
use crate::seat::Seat;
use gateway_protocol::{Origin, Reply, SeatCall};
use messages::{MotorAuthority, OperatorRequest, Request, put_text};
use robot_state::Reason;
use robot_state::answers::detail;

impl Connection {
    /// Whether it is a page, of anyone or of this user.
    fn is_page(&self, user: Option<&str>) -> bool {
        let is = |holder: &Holder| holder.origin == Origin::Page && user.is_none_or(|user| holder.user == user);
        !self.closed && self.holder.as_ref().is_some_and(is)
    }
}

impl Core {
    pub(super) fn seat_call(&mut self, client: ClientId, id: u64, holder: &Holder, what: SeatCall) {
        if holder.role < Role::Fly || holder.origin != Origin::Page {
            let (verb, user) = (detail("fly from a page"), detail(&holder.user));
            let (needs, has) = (detail(Role::Fly.name()), detail(holder.role.name()));
            return self.refuse(client, id, Reason::NotPermitted { verb, needs, user, has });
        }
        let done = match what {
            SeatCall::Ask => self.seat.ask(self.now_ns, &holder.user),
            SeatCall::Give => {
                self.seat.give(&holder.user);
                Ok(())
            }
            SeatCall::Keep => {
                self.seat.keep(&holder.user);
                Ok(())
            }
        };
        match done {
            Ok(()) => self.send(client, Reply::Done { id }),
            Err(reason) => self.refuse(client, id, reason),
        }
    }

    /// A connection has ended: a person without a page does not fly from one.
    pub(super) fn left(&mut self, user: &str) {
        if !self.connections.values().any(|one| one.is_page(Some(user))) {
            self.seat.gone(user);
        }
    }

    /// Tells all pages who flies, if that has changed, and ends what the one before has held.
    pub(super) fn tell_seat(&mut self, before: &Seat) {
        if self.seat == *before {
            return;
        }
        let pages = |core: &Self, user: Option<&str>| -> Vec<ClientId> {
            core.connections.iter().filter(|(_, one)| one.is_page(user)).map(|(client, _)| *client).collect()
        };
        if let Some(user) = before.flyer().filter(|user| self.seat.flyer() != Some(user)) {
            pages(self, Some(user)).into_iter().for_each(|client| self.release(client));
        }
        let reply = self.seat_now();
        pages(self, None).into_iter().for_each(|client| self.send(client, reply.clone()));
    }

    pub(super) fn seat_now(&self) -> Reply {
        let (asks, within_s) = match self.seat.asks(self.now_ns) {
            Some((user, within_s)) => (Some(user.to_owned()), within_s),
            None => (None, 0.0),
        };
        Reply::Seat { id: 0, flyer: self.seat.flyer().map(str::to_owned), asks, within_s }
    }

    /// Holds a motion when no person who may fly has been connected for the configured time.
    pub(super) fn hold_without_operator(&mut self) {
        let Some(after_ns) = self.roles.hold_without_operator_ns() else { return };
        let flies = |one: &Connection| !one.closed && one.holder.as_ref().is_some_and(|one| one.role >= Role::Fly);
        // In soft mode a person leads the node by hand, and is there.
        let moving = [MotorAuthority::MODE_FOLLOWING, MotorAuthority::MODE_JOGGING];
        let moves = self.motion.is_some_and(|motion| moving.contains(&motion.mode));
        if !moves || self.connections.values().any(flies) {
            self.alone_ns = None;
            return;
        }
        let since_ns = *self.alone_ns.get_or_insert(self.now_ns);
        if self.now_ns < since_ns.saturating_add(after_ns) {
            return;
        }
        // It is told again after that time if it still moves.
        self.alone_ns = Some(self.now_ns);
        let Ok(mut request) = Request::Hold.encode() else { return };
        request.pid = std::process::id();
        request.role = OperatorRequest::ROLE_OBSERVER;
        put_text(&mut request.requester, "gateway");
        let ticket = self.ticket_of(Asked { client: NO_CLIENT, id: 0, counts: false, begins: false });
        let process = client::MOTOR_IO.to_owned();
        self.actions.push(Action::Ask { ticket, process, request: Box::new(request), mission: None });
    }
}
