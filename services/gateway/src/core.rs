//! The decisions of the gateway: bytes, peers and answers in, actions out. No clock, no I/O.

mod holding;
mod looks;
mod publishing;
mod seats;
mod token_calls;

use crate::budget::Budget;
use crate::codes::Codes;
pub use crate::events::{Action, ClientId, Done, Event, Motion, OwnMessage, Question, Ticket, TokenChange};
use crate::held::{Ends, Held, begins, end_of, is_old, may_begin};
use crate::plugin::Verb;
use crate::roles::{Peer, Role, Roles, deed, needed, requester};
use crate::seat::Seat;
use crate::sensors::Sensors;
use crate::tokens::Tokens;
use config::PluginSection;
use gateway_protocol::{CALL_LIMITS, Call, Decoder, Frame, Origin, Reply, VERSION};
use messages::{OperatorRequest, Request, put_text};
use robot_state::Reason;
use robot_state::answers::detail;
use std::collections::BTreeMap;
use std::net::IpAddr;

/// Largest number of connections.
pub const CONNECTIONS: usize = 160;
/// Largest number of connections of one user. A further one takes the place of the user's longest idle one, so that a
/// stop always finds a place.
pub const CONNECTIONS_OF_A_USER: usize = 64;
/// Largest number of unanswered calls of a connection; stops are not counted.
pub const UNANSWERED: usize = 8;
/// Largest number of subscriptions of a connection.
pub const SUBSCRIPTIONS: usize = 64;
/// Calls of a connection per second, and in a burst; stops pass beyond them.
const CALLS_PER_S: f64 = 100.0;
const BURST: f64 = 200.0;
/// Marks per second, and in a burst, of all connections that may not fly.
const MARKS_PER_S: f64 = 1.0;
const MARKS: f64 = 5.0;
/// Files that a connection may open per second, and in a burst.
const OPENS_PER_S: f64 = 10.0;
/// Stands for the gateway itself among the clients, which count from 1.
pub const NO_CLIENT: ClientId = 0;
/// What the gateway itself observes while a client holds a motion.
pub const OBSERVED: &str = "motor/authority";
/// Time in which a connection has to send `hello`, ns.
const HELLO_NS: u64 = 10_000_000_000;

/// Who acts through a connection.
#[derive(Debug, Clone)]
struct Holder {
    user: String,
    role: Role,
    origin: Origin,
    by_token: bool,
    /// Where the browser is for which a page acts.
    from: Option<IpAddr>,
}

impl Holder {
    /// Fills in who makes a request, as the run records it.
    fn sign(&self, request: &mut OperatorRequest, peer: &Peer) {
        (request.pid, request.uid) = (peer.pid, peer.uid);
        (request.role, request.origin) = (self.role.number(), self.origin.number());
        let named = requester(&self.user, self.from, request.requester.len());
        put_text(&mut request.requester, &named);
    }
}

#[derive(Debug)]
struct Connection {
    peer: Peer,
    decoder: Decoder,
    /// `None` before `hello`.
    holder: Option<Holder>,
    /// Numbers and channels.
    subscriptions: Vec<(u64, String)>,
    /// Unanswered calls.
    unanswered: usize,
    budget: Budget,
    opens: Budget,
    /// The list of runs or of files that is being made.
    listing: Option<Ticket>,
    /// What `nims` does for it.
    working: Option<Ticket>,
    /// A motion that ends with its signs, or with the connection.
    held: Option<Held>,
    /// It has held a motion.
    holds: bool,
    since_ns: u64,
    used_ns: u64,
    /// Nothing is read from it any more.
    closed: bool,
}

/// A call that is being carried out.
#[derive(Debug, Clone, Copy)]
struct Asked {
    client: ClientId,
    id: u64,
    /// It counts as unanswered.
    counts: bool,
    /// It begins a motion.
    begins: bool,
}

/// The state of the gateway.
#[derive(Debug)]
pub struct Core {
    robot: String,
    /// The robot's name in the units of its plug-ins.
    instance: String,
    roles: Roles,
    tokens: Tokens,
    sensors: Sensors,
    connections: BTreeMap<ClientId, Connection>,
    /// The calls that are being carried out.
    tickets: BTreeMap<Ticket, Asked>,
    ends: Ends,
    /// What motor-io did last.
    motion: Option<Motion>,
    /// It is observed.
    observed: bool,
    now_ns: u64,
    /// Since when a motion has run without a person who may fly, ns.
    alone_ns: Option<u64>,
    seat: Seat,
    marks: Budget,
    codes: Codes,
    last_ticket: Ticket,
    /// When a client stopped the robot last, ns.
    stopped_ns: u64,
    /// A change of the tokens is being stored.
    changing: bool,
    actions: Vec<Action>,
}

impl Core {
    /// Creates the gateway of the robot of that name.
    #[must_use]
    pub fn new(robot: String, roles: Roles, tokens: Tokens) -> Self {
        Self {
            instance: robot.clone(),
            robot,
            roles,
            tokens,
            sensors: Sensors::default(),
            connections: BTreeMap::new(),
            tickets: BTreeMap::new(),
            ends: Ends::default(),
            motion: None,
            observed: false,
            now_ns: 0,
            alone_ns: None,
            seat: Seat::default(),
            marks: Budget::new(MARKS_PER_S, MARKS, 0),
            codes: Codes::default(),
            last_ticket: 0,
            stopped_ns: 0,
            changing: false,
            actions: Vec::new(),
        }
    }

    /// Adds the sensors that the system file declares. `instance`: the robot's name in the units of its plug-ins.
    #[must_use]
    pub fn with_plugins(self, instance: &str, declared: &[PluginSection]) -> Self {
        Self { sensors: Sensors::new(declared), instance: instance.to_owned(), ..self }
    }

    /// Evaluates an event; returns what has to be done, in this order.
    pub fn step(&mut self, now_ns: u64, event: Event<'_>) -> Vec<Action> {
        self.now_ns = now_ns;
        let seat = self.seat.clone();
        match event {
            Event::Connected { client, peer } => self.connect(now_ns, client, peer),
            Event::Received { client, bytes } => self.receive(now_ns, client, bytes),
            Event::Gone { client } => {
                // What still waits of its calls is not carried out any more.
                self.tickets.retain(|_, asked| asked.client != client);
                self.release(client);
                let user = self.connections.remove(&client).and_then(|one| one.holder).map(|holder| holder.user);
                self.sensors.free(client);
                if let Some(user) = user {
                    self.left(&user);
                }
            }
            Event::Moved(motion) => {
                self.motion = Some(motion);
                for one in self.connections.values_mut() {
                    one.held.take_if(|held| held.has_ended(motion));
                }
            }
            Event::Answered { ticket, reply } => self.answered(ticket, reply),
            Event::Undeposited { ticket } => self.undeposited(ticket),
            Event::Stored { change, stored } => self.stored(*change, stored),
            Event::Ending => self.release_all(),
            Event::Tick => {
                let late = |one: &Connection| one.holder.is_none() && now_ns >= one.since_ns + HELLO_NS;
                let late: Vec<_> =
                    self.connections.iter().filter(|(_, one)| late(one)).map(|(client, _)| *client).collect();
                late.into_iter().for_each(|client| self.close(client));
                let over = |one: &Connection| one.held.as_ref().is_some_and(|held| held.is_over(now_ns));
                let over: Vec<_> =
                    self.connections.iter().filter(|(_, one)| over(one)).map(|(client, _)| *client).collect();
                over.into_iter().for_each(|client| self.release(client));
                self.seat.tick(now_ns);
                self.hold_without_operator();
            }
        }
        self.tell_seat(&seat);
        self.guard();
        self.observe();
        std::mem::take(&mut self.actions)
    }

    fn connect(&mut self, now_ns: u64, client: ClientId, peer: Peer) {
        let uid = peer.uid;
        let connection = Connection {
            peer,
            decoder: Decoder::new(CALL_LIMITS),
            holder: None,
            subscriptions: Vec::new(),
            unanswered: 0,
            budget: Budget::new(CALLS_PER_S, BURST, now_ns),
            opens: Budget::new(OPENS_PER_S, OPENS_PER_S, now_ns),
            listing: None,
            working: None,
            held: None,
            holds: false,
            since_ns: now_ns,
            used_ns: now_ns,
            closed: false,
        };
        let of_user = self.connections.values().filter(|one| one.peer.uid == uid && !one.closed).count();
        self.connections.insert(client, connection);
        if of_user >= CONNECTIONS_OF_A_USER {
            let idle = self
                .connections
                .iter()
                .filter(|(id, one)| **id != client && one.peer.uid == uid && one.unanswered == 0 && !one.closed);
            let longest = idle.min_by_key(|(id, one)| (one.holder.is_some(), one.used_ns, **id)).map(|(id, _)| *id);
            self.refuse_and_close(longest.unwrap_or(client), Reason::ConnectionsFull { most: CONNECTIONS_OF_A_USER });
        } else if self.connections.values().filter(|one| !one.closed).count() > CONNECTIONS {
            self.refuse_and_close(client, Reason::ConnectionsFull { most: CONNECTIONS });
        }
    }

    fn receive(&mut self, now_ns: u64, client: ClientId, bytes: &[u8]) {
        let Some(connection) = self.connections.get_mut(&client).filter(|one| !one.closed) else { return };
        connection.used_ns = now_ns;
        connection.decoder.push(bytes);
        loop {
            let Some(connection) = self.connections.get_mut(&client).filter(|one| !one.closed) else { return };
            match connection.decoder.next_frame() {
                Ok(None) => return,
                Ok(Some(frame)) => self.frame(now_ns, client, frame),
                Err(error) => self.refuse_and_close(client, Reason::NotACall { why: detail(error) }),
            }
        }
    }

    fn frame(&mut self, now_ns: u64, client: ClientId, frame: Frame) {
        let call = match Call::read(&frame.header) {
            Ok(call) => call,
            Err(why) => return self.refuse_and_close(client, Reason::NotACall { why: detail(why) }),
        };
        let stopped_ns = self.stopped_ns;
        let Some(connection) = self.connections.get_mut(&client) else { return };
        let Some(holder) = connection.holder.clone() else { return self.hello(client, call) };
        let id = call.id();
        let (within, unanswered) = (connection.budget.spend(now_ns), connection.unanswered);
        if is_overtaken(&call, stopped_ns) {
            return self.refuse(client, id, Reason::OvertakenByStop);
        }
        match call {
            Call::Ask { request, process, held, at_ns, .. } => {
                let urgent = request.is_stop();
                if !urgent && (!within || unanswered >= UNANSWERED) {
                    return self.refuse(client, id, Reason::GatewayBusy { most: UNANSWERED });
                }
                if !held {
                    return self.ask(client, id, &holder, (request, process), frame.body);
                }
                let Some(end) = end_of(&request) else {
                    let why = detail("only a jog and a move can be held; leave `held` out");
                    return self.refuse(client, id, Reason::NotAsked { why });
                };
                let made_ns = at_ns.unwrap_or(now_ns).min(now_ns);
                if is_old(now_ns, made_ns) {
                    let age_s = (now_ns - made_ns) as f64 * 1e-9;
                    return self.refuse(client, id, Reason::HeldTooOld { age_s });
                }
                self.release(client);
                let before = self.last_ticket;
                self.ask(client, id, &holder, (request, process), frame.body);
                if self.last_ticket > before {
                    self.hold(client, Held::new(self.last_ticket, end, made_ns));
                }
            }
            Call::Beat { at_ns } => {
                if let Some(held) = &mut connection.held {
                    held.beat(now_ns, at_ns.unwrap_or(now_ns));
                }
            }
            Call::Release { .. } => {
                self.release(client);
                self.send(client, Reply::Done { id });
            }
            _ if !within || unanswered >= UNANSWERED => {
                self.refuse(client, id, Reason::GatewayBusy { most: UNANSWERED });
            }
            Call::Hello { .. } => {
                self.refuse_and_close(client, Reason::NotACall { why: detail("`hello` was sent twice") });
            }
            other => self.other_call(now_ns, client, &holder, other, frame.body),
        }
    }

    fn hello(&mut self, client: ClientId, call: Call) {
        let Call::Hello { version, origin, token, from } = call else {
            return self.refuse_and_close(client, Reason::NotACall { why: detail("the first call is not `hello`") });
        };
        if version != VERSION {
            return self.refuse_and_close(client, Reason::OtherProtocol { given: version.into(), spoken: VERSION });
        }
        let Some(connection) = self.connections.get_mut(&client) else { return };
        let by_token = token.is_some();
        let (user, role) = match token.map(|secret| self.tokens.of(&secret)) {
            None => (connection.peer.user.clone(), self.roles.without_token(&connection.peer, origin)),
            Some(Some((name, role))) => (name, role),
            Some(None) => return self.refuse_and_close(client, Reason::TokenInvalid),
        };
        let from = from.filter(|_| origin == Origin::Page);
        connection.holder = Some(Holder { user: user.clone(), role, origin, by_token, from });
        let (robot, role) = (self.robot.clone(), role.name().to_owned());
        self.send(client, Reply::Welcome { version: VERSION, robot, user, role });
        if origin == Origin::Page && self.seat != Seat::default() {
            let seat = self.seat_now();
            self.send(client, seat);
        }
    }

    fn ask(&mut self, client: ClientId, id: u64, holder: &Holder, asked: (Request, Option<String>), body: Vec<u8>) {
        let (request, process) = asked;
        let needs = needed(&request);
        if holder.role < needs {
            let (verb, user) = (detail(deed(&request)), detail(&holder.user));
            let (needs_word, has) = (detail(needs.name()), detail(holder.role.name()));
            return self.refuse(
                client,
                id,
                match needs {
                    Role::Owner => Reason::OwnerOnly { verb, user },
                    _ => Reason::NotPermitted { verb, needs: needs_word, user, has },
                },
            );
        }
        // Everyone who opens a page may mark the run, but not fill it, nor the queue of the supervisor.
        if matches!(request, Request::Mark { .. }) && holder.role <= Role::Stop && !self.marks.spend(self.now_ns) {
            return self.refuse(client, id, Reason::AskedTooOften { per_s: MARKS_PER_S });
        }
        if needs >= Role::Fly
            && holder.origin == Origin::Page
            && let Err(reason) = self.seat.request(&holder.user)
        {
            return self.refuse(client, id, reason);
        }
        if let Some((verb, name)) = of_plugin(&request).filter(|(_, name)| self.sensors.declares(name)) {
            let name = name.to_owned();
            if let Some(connection) = self.connections.get_mut(&client) {
                connection.unanswered += 1;
            }
            let ticket = self.ticket(client, id);
            return self.actions.push(Action::Plugin { ticket, verb, name });
        }
        let Some(process) = process_of(&request, process.as_deref()) else {
            let why = detail("no process has this name and takes this request; leave the process out");
            return self.refuse(client, id, Reason::NotAsked { why });
        };
        let mission = match &request {
            Request::Run { hash, .. } => match String::from_utf8(body) {
                Ok(text) if config::mission_hash(&text) == *hash => Some(text),
                _ => return self.refuse(client, id, Reason::MissionMissing),
            },
            _ => None,
        };
        let Some(connection) = self.connections.get_mut(&client) else { return };
        let peer = &connection.peer;
        let mut sample = match request.encode() {
            Ok(sample) => sample,
            Err(error) => return self.refuse(client, id, Reason::NotAsked { why: detail(error) }),
        };
        holder.sign(&mut sample, peer);
        let counts = !sample.body.is_stop();
        connection.unanswered += usize::from(counts);
        let ticket = self.ticket_of(Asked { client, id, counts, begins: begins(&request) });
        if !counts {
            self.stopped_ns = self.now_ns;
        }
        let request = Box::new(sample);
        self.actions.push(match sample.body.verb {
            messages::RequestBody::VERB_ESTOP => Action::Estop { ticket, request },
            _ => Action::Ask { ticket, process, request, mission },
        });
    }

    fn other_call(&mut self, now_ns: u64, client: ClientId, holder: &Holder, call: Call, body: Vec<u8>) {
        let id = call.id();
        let what = match call {
            Call::Robot { .. } => Question::Robot,
            Call::Configuration { .. } => Question::Configuration,
            Call::Channels { .. } => Question::Channels,
            Call::Runs { .. } => Question::Runs,
            Call::Files { run, .. } => Question::Files(run),
            Call::Open { run, file, .. } => Question::Open(run, file),
            Call::Make { run, what, .. } => Question::Make(run, what),
            Call::Remove { run, .. } => Question::Remove(run),
            Call::Doctor { .. } => Question::Doctor,
            Call::RobotFile { calibration_bytes, made_from, .. } => {
                return self.robot_file(now_ns, (client, id), holder, (body, calibration_bytes), made_from);
            }
            Call::Subscribe { channel, rate_hz, .. } => return self.subscribe(client, id, channel, rate_hz),
            Call::Publish { .. } | Call::Declare { .. } | Call::Sample { .. } => {
                return self.publish_call(now_ns, client, call, body);
            }
            Call::Unsubscribe { subscription, .. } => {
                let Some(connection) = self.connections.get_mut(&client) else { return };
                connection.subscriptions.retain(|(one, _)| *one != subscription);
                self.actions.push(Action::Unsubscribe { client, id: subscription });
                return self.send(client, Reply::Done { id });
            }
            Call::Seat { what, .. } => return self.seat_call(client, id, holder, what),
            Call::CodeUse { code, .. } => return self.code_use(client, id, holder, &code),
            Call::CodeAdd { .. } | Call::TokenAdd { .. } | Call::TokenList { .. } | Call::TokenRevoke { .. } => {
                return self.token_call(client, holder, call);
            }
            // They were carried out before.
            Call::Hello { .. } | Call::Ask { .. } | Call::Beat { .. } | Call::Release { .. } => return,
        };
        self.look(now_ns, client, id, holder, what);
    }

    fn subscribe(&mut self, client: ClientId, id: u64, channel: String, rate_hz: Option<f64>) {
        let Some(connection) = self.connections.get_mut(&client) else { return };
        if connection.subscriptions.len() >= SUBSCRIPTIONS {
            return self.refuse(client, id, Reason::TooManySubscriptions { most: SUBSCRIPTIONS });
        }
        if rate_hz.is_some_and(|rate_hz| !(rate_hz.is_finite() && rate_hz > 0.0)) {
            let why = detail("rate_hz is not above 0; leave it out, or give samples per second");
            return self.refuse(client, id, Reason::NotAsked { why });
        }
        if !bus::is_channel_name(&channel) {
            let why = detail(format_args!("`{channel}` is no name of a channel; `channels` lists them"));
            return self.refuse(client, id, Reason::NotAsked { why });
        }
        if connection.subscriptions.iter().any(|(one, _)| *one == id) {
            let why = detail(format_args!("a subscription has the number {id} already; give another one"));
            return self.refuse(client, id, Reason::NotAsked { why });
        }
        // A second one would send every sample twice through the same socket.
        if let Some((one, _)) = connection.subscriptions.iter().find(|(_, of)| *of == channel) {
            let why = format_args!(
                "subscription {one} has the channel `{channel}` already; use its samples, or end it first"
            );
            let why = detail(why);
            return self.refuse(client, id, Reason::NotAsked { why });
        }
        connection.subscriptions.push((id, channel.clone()));
        // First, so that no sample comes before it.
        self.send(client, Reply::Done { id });
        self.actions.push(Action::Subscribe { client, id, channel, rate_hz });
    }

    fn answered(&mut self, ticket: Ticket, done: Done) {
        let answer = match &done {
            Done::Answer(answer) => Some(&**answer),
            Done::Reply(..) => None,
        };
        self.end_answered(ticket, answer, answer.is_some_and(may_begin));
        let Some(Asked { client, id, counts, begins }) = self.tickets.remove(&ticket) else { return };
        if begins && answer.is_some_and(|answer| answer.accepted == OperatorRequest::ACCEPTED) {
            // What was held and accepted before it has ended.
            for one in self.connections.values_mut() {
                one.held.take_if(|held| held.ticket < ticket && !held.is_asked());
            }
        }
        let Some(connection) = self.connections.get_mut(&client) else { return };
        connection.listing = connection.listing.filter(|listing| *listing != ticket);
        connection.working = connection.working.filter(|working| *working != ticket);
        if let Some(answer) = answer {
            // A motion that was refused is not ended: that of another client may be under way.
            let now_ns = self.now_ns;
            connection.held.take_if(|held| held.ticket == ticket && !held.answered(now_ns, answer));
        }
        connection.unanswered -= usize::from(counts && connection.unanswered > 0);
        let (reply, body, descriptor) = match done {
            Done::Answer(answer) => (Reply::answer(id, &answer), Vec::new(), None),
            Done::Reply(reply, body, descriptor) => (reply.with_id(id), body, descriptor),
        };
        self.actions.push(Action::Send { client, reply, body, descriptor });
    }

    fn ticket(&mut self, client: ClientId, id: u64) -> Ticket {
        self.ticket_of(Asked { client, id, counts: true, begins: false })
    }

    fn ticket_of(&mut self, asked: Asked) -> Ticket {
        self.last_ticket += 1;
        self.tickets.insert(self.last_ticket, asked);
        self.last_ticket
    }

    fn send(&mut self, client: ClientId, reply: Reply) {
        self.actions.push(Action::Send { client, reply, body: Vec::new(), descriptor: None });
    }

    fn refuse(&mut self, client: ClientId, id: u64, reason: Reason) {
        self.send(client, Reply::answer(id, &reason.answer()));
    }

    fn refuse_and_close(&mut self, client: ClientId, reason: Reason) {
        self.refuse(client, 0, reason);
        self.close(client);
    }

    fn close(&mut self, client: ClientId) {
        self.release(client);
        if let Some(connection) = self.connections.get_mut(&client) {
            connection.closed = true;
        }
        self.actions.push(Action::Close { client });
    }

    /// Returns whether the client of a call still waits for its reply.
    #[must_use]
    pub fn is_wanted(&self, ticket: Ticket) -> bool {
        self.tickets.contains_key(&ticket)
    }

    /// Returns the client of a call.
    #[must_use]
    pub fn client_of(&self, ticket: Ticket) -> Option<ClientId> {
        self.tickets.get(&ticket).map(|asked| asked.client)
    }

    /// Returns the user and the role of a client, for the log.
    #[must_use]
    pub fn described(&self, ticket: Ticket) -> Option<(&str, Role)> {
        let client = self.tickets.get(&ticket)?.client;
        let holder = self.connections.get(&client)?.holder.as_ref()?;
        Some((&holder.user, holder.role))
    }
}

/// Whether a motion was pressed for before a client has stopped the robot.
fn is_overtaken(call: &Call, stopped_ns: u64) -> bool {
    let Call::Ask { request, pressed_ns: Some(pressed_ns), .. } = call else { return false };
    *pressed_ns < stopped_ns && (begins(request) || *request == Request::Resume)
}

/// What a request asks of a process that may be a plug-in, with its name.
fn of_plugin(request: &Request) -> Option<(Verb, &str)> {
    match request {
        Request::StartProcess { name, .. } => Some((Verb::Start, name)),
        Request::StopProcess { name } => Some((Verb::Stop, name)),
        Request::RestartProcess { name } => Some((Verb::Restart, name)),
        _ => None,
    }
}

/// Returns the process that carries a request out; `None` if the client names another one.
fn process_of(request: &Request, named: Option<&str>) -> Option<String> {
    const OUTPUTS: [&str; 4] = ["controller", "controller-b", "estimator", "estimator-b"];
    let of = match request {
        Request::Goto { .. } | Request::Run { .. } => client::PLANNER,
        Request::StartProcess { .. }
        | Request::StopProcess { .. }
        | Request::RestartProcess { .. }
        | Request::Plug { .. }
        | Request::Unplug { .. }
        | Request::Mark { .. }
        | Request::Set { .. } => client::SUPERVISOR,
        Request::Fault { .. } => match named {
            Some(named) if OUTPUTS.contains(&named) || named == client::SUPERVISOR => return Some(named.to_owned()),
            _ => client::VIRTUAL_BOX,
        },
        _ => client::MOTOR_IO,
    };
    named.is_none_or(|named| named == of).then(|| of.to_owned())
}
