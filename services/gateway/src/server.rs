//! The process around the core: sockets, the robot, the disk.

use crate::core::{Action, ClientId, Core, Done, Event, Motion, NO_CLIENT, Question, Ticket, TokenChange};
use crate::disk::{Disk, Job, Outcome};
use crate::hub::{Delivery, count};
use crate::outbox::{DESCRIPTORS, Outbox, is_large};
use crate::outlet::Delivered;
use crate::plugin::Verb;
use crate::robot::Robot;
use crate::roles::Roles;
use crate::settings::Settings;
use crate::tokens::Tokens;
use crate::{socket, users};
use bus::clock::{now_ns, sleep_until};
use command::{Answer, Failure, StopFlag};
use gateway_protocol::{ChannelRow, Reply, RobotFacts, encode};
use messages::{Message, MotorAuthority, OperatorRequest, RequestAnswer, text_of};
use robot_state::Reason;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use rustix::time::Timespec;
use std::collections::BTreeMap;
use std::os::fd::{AsFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;

/// Longest wait: while the robot is looked for, while samples are passed on, and while an answer is awaited, ns.
const IDLE_NS: u64 = 250_000_000;
const SAMPLES_NS: u64 = 20_000_000;
const BUSY_NS: u64 = 2_000_000;
/// Time for which what was found out about the robot is told again, ns.
const FOUND_NS: u64 = 250_000_000;
/// Bytes that are read from a client in one pass, so that every client has its turn.
const PIECE: usize = 64 << 10;
/// Time for which a closed connection may take what was sent to it, ns.
const FAREWELL_NS: u64 = 1_000_000_000;

/// The connection of a client.
struct Client {
    socket: OwnedFd,
    outbox: Outbox,
    /// Closed at this instant at the latest, earlier when everything was sent.
    closes_ns: Option<u64>,
    broken: bool,
}

/// The gateway.
pub struct Server {
    listener: OwnedFd,
    path: PathBuf,
    core: Core,
    robot: Robot,
    disk: Disk,
    /// Missions and tokens have a disk of their own, so that no list delays a motion or a pairing.
    inbox: Disk,
    /// What the service manager is asked for: it can take seconds.
    units: Disk,
    /// What changes the folder of the runs: it can take minutes.
    makers: Disk,
    /// Plug-ins that are started with the gateway.
    started: Vec<String>,
    /// The units of the plug-ins by name.
    unit_of: BTreeMap<String, String>,
    spare: socket::Spare,
    /// Device and inode of the socket.
    bound: Option<(u64, u64)>,
    /// What runs and its channels as they were found last, with the time: to find them reads many files.
    facts: Option<(u64, Option<RobotFacts>)>,
    rows: Option<(u64, Vec<ChannelRow>)>,
    clients: BTreeMap<ClientId, Client>,
    last_client: ClientId,
    /// Requests whose mission is being stored.
    missions: BTreeMap<Ticket, (String, Box<OperatorRequest>, u64)>,
    tokens: PathBuf,
    /// The system file, and the domain of its robot.
    system: PathBuf,
    domain: String,
    /// The gateway's own subscription has the expected type.
    reads_motions: bool,
}

impl Server {
    /// Opens the socket.
    ///
    /// # Errors
    /// Another gateway has it, or it cannot be created; the tokens cannot be read.
    pub fn open(settings: &Settings) -> Answer<Self> {
        let tokens = Tokens::read(&settings.tokens).map_err(Failure::NotNow)?;
        let roles = Roles::new(rustix::process::geteuid().as_raw(), settings.section.clone());
        let listener = socket::listen(&settings.socket)?;
        Ok(Self {
            listener,
            bound: socket::identity(&settings.socket),
            spare: socket::Spare::new(),
            path: settings.socket.clone(),
            core: Core::new(settings.name.clone(), roles, tokens).with_plugins(&settings.instance, &settings.plugins),
            robot: Robot::new(settings.name.clone(), settings.domain.clone(), absolute(&settings.socket)),
            disk: Disk::start(settings.runs.clone()).map_err(Failure::not_now)?,
            inbox: Disk::start(settings.runs.clone()).map_err(Failure::not_now)?,
            units: Disk::start(settings.runs.clone()).map_err(Failure::not_now)?,
            makers: Disk::start(settings.runs.clone()).map_err(Failure::not_now)?,
            started: settings.started(),
            unit_of: settings.units(),
            facts: None,
            rows: None,
            clients: BTreeMap::new(),
            last_client: 0,
            missions: BTreeMap::new(),
            tokens: settings.tokens.clone(),
            system: settings.system.clone(),
            domain: settings.domain.clone(),
            reads_motions: false,
        })
    }

    /// Serves until the flag is set.
    ///
    /// # Errors
    /// The sockets cannot be waited for.
    pub fn run(&mut self, stop: &StopFlag) -> Answer {
        eprintln!("gateway: listening on {}", self.path.display());
        self.begin(0, Job::Sweep);
        for name in std::mem::take(&mut self.started) {
            self.plugin(0, name, Verb::Start);
        }
        let served = self.serve(stop);
        self.end_held();
        // Another gateway may have put its own socket there.
        if self.bound.is_some() && socket::identity(&self.path) == self.bound {
            let _ = std::fs::remove_file(&self.path);
        }
        served
    }

    fn serve(&mut self, stop: &StopFlag) -> Answer {
        while !stop.load(Ordering::Relaxed) {
            self.wait()?;
            if let Some(sentence) = self.robot.look(now_ns()) {
                eprintln!("gateway: {sentence}");
                (self.facts, self.rows) = (None, None);
            }
            self.robot_answers();
            self.published();
            self.disk_outcomes();
            self.samples();
            let actions = self.core.step(now_ns(), Event::Tick);
            self.carry_out(actions);
            self.send_and_close();
        }
        Ok(())
    }

    /// Ends the motions that clients hold, and waits until motor-io has answered. What it does not answer in time, and
    /// what a gateway leaves that is killed, motor-io ends by itself.
    fn end_held(&mut self) {
        let give_up_ns = now_ns() + FAREWELL_NS;
        let actions = self.core.step(now_ns(), Event::Ending);
        self.carry_out(actions);
        while (self.core.is_ending() || self.robot.is_stopping()) && now_ns() < give_up_ns {
            self.robot_answers();
            // What is deposited is renewed.
            let actions = self.core.step(now_ns(), Event::Tick);
            self.carry_out(actions);
            sleep_until(now_ns() + BUSY_NS);
        }
    }

    /// Waits for a client or for the next look at the robot; accepts and reads.
    fn wait(&mut self) -> Answer {
        let wait_ns = match () {
            () if self.robot.is_busy() || self.disk.is_busy() || self.inbox.is_busy() || self.units.is_busy() => {
                BUSY_NS
            }
            () if self.robot.hub().is_used() || self.core.is_held() => SAMPLES_NS,
            () => IDLE_NS,
        };
        let ids: Vec<ClientId> = self.clients.keys().copied().collect();
        let (accepts, readable) = {
            let mut entries = vec![PollFd::new(&self.listener, PollFlags::IN)];
            for client in self.clients.values() {
                let mut flags = PollFlags::empty();
                // A client that does not take its replies is not asked for more calls.
                flags.set(PollFlags::IN, client.closes_ns.is_none() && !client.outbox.is_paused());
                flags.set(PollFlags::OUT, client.outbox.waiting() > 0);
                entries.push(PollFd::new(&client.socket, flags));
            }
            let timeout = Timespec { tv_sec: 0, tv_nsec: wait_ns as i64 };
            match poll(&mut entries, Some(&timeout)) {
                Ok(_) | Err(Errno::INTR) => {}
                Err(error) => return Err(Failure::NotNow(format!("the sockets cannot be waited for: {error}"))),
            }
            let ready =
                |entry: &PollFd<'_>| entry.revents().intersects(PollFlags::IN | PollFlags::HUP | PollFlags::ERR);
            let readable: Vec<ClientId> =
                ids.into_iter().zip(&entries[1..]).filter(|(_, entry)| ready(entry)).map(|(id, _)| id).collect();
            (ready(&entries[0]), readable)
        };
        if accepts {
            self.accept();
        }
        let actions: Vec<Action> = readable.into_iter().flat_map(|client| self.read(client)).collect();
        // What stops the robot comes before everything else of this pass.
        let (stops, rest): (Vec<_>, Vec<_>) = actions.into_iter().partition(|action| match action {
            Action::Estop { .. } => true,
            Action::Ask { request, .. } => request.body.is_stop(),
            _ => false,
        });
        if !stops.is_empty() {
            self.carry_out(stops);
            self.robot_answers();
        }
        self.carry_out(rest);
        Ok(())
    }

    fn accept(&mut self) {
        // A bounded number, so that those who connect do not delay those who are connected.
        for (accepted, credentials) in self.spare.accept(&self.listener, crate::core::CONNECTIONS) {
            self.last_client += 1;
            let client = self.last_client;
            let peer = match users::peer_of(credentials.uid, credentials.gid, credentials.pid) {
                Ok(peer) => peer,
                Err(error) => {
                    eprintln!("gateway: a connection is refused, because /etc/passwd or /etc/group has {error}");
                    continue;
                }
            };
            let entry = Client { socket: accepted, outbox: Outbox::default(), closes_ns: None, broken: false };
            self.clients.insert(client, entry);
            let actions = self.core.step(now_ns(), Event::Connected { client, peer });
            self.carry_out(actions);
        }
    }

    fn read(&mut self, client: ClientId) -> Vec<Action> {
        let Some(entry) = self.clients.get_mut(&client) else { return Vec::new() };
        let mut bytes = vec![0; PIECE];
        match rustix::io::read(&entry.socket, bytes.as_mut_slice()) {
            Ok(0) => entry.broken = true,
            Ok(length) => return self.core.step(now_ns(), Event::Received { client, bytes: &bytes[..length] }),
            Err(Errno::AGAIN | Errno::INTR) => {}
            Err(_) => entry.broken = true,
        }
        Vec::new()
    }

    fn carry_out(&mut self, actions: Vec<Action>) {
        let mut undeposited = None;
        for action in actions {
            match action {
                Action::Send { client, reply, body, descriptor } => self.post(client, &reply, &body, descriptor),
                Action::Close { client } => {
                    if let Some(entry) = self.clients.get_mut(&client) {
                        entry.closes_ns.get_or_insert(now_ns() + FAREWELL_NS);
                    }
                    self.robot.hub().remove(client);
                }
                Action::Ask { ticket, .. } if undeposited == Some(ticket) => {
                    let actions = self.core.step(now_ns(), Event::Undeposited { ticket });
                    self.carry_out(actions);
                }
                Action::Ask { ticket, process, request, mission: None } => {
                    self.ask(ticket, &process, request, now_ns());
                }
                Action::Ask { ticket, process, request, mission: Some(text) } => {
                    self.ask_with_mission(ticket, process, request, text);
                }
                Action::Estop { ticket, request } => {
                    if let Err(answer) = self.robot.emergency_stop(ticket, &request) {
                        self.answer(ticket, answer);
                    }
                }
                Action::Deposit { ticket, due_ns, request } => {
                    if !self.robot.deposit(due_ns, &request) {
                        undeposited = Some(ticket);
                    }
                }
                Action::Withdraw => self.robot.withdraw(),
                Action::Plugin { ticket, verb, name } => self.plugin(ticket, name, verb),
                Action::Publish { ticket, sensor, reading } => {
                    self.publish(ticket, Delivered::Reading(sensor, reading));
                }
                Action::Declare { ticket, sensor } => self.publish(ticket, Delivered::Declaration(sensor)),
                Action::PublishSample { ticket, sensor, header, sample } => {
                    self.publish(ticket, Delivered::Sample(sensor, header, sample));
                }
                Action::Look { ticket, what } => self.look(ticket, what),
                Action::Subscribe { client, id, channel, rate_hz } => {
                    self.robot.hub().subscribe(client, id, channel, rate_hz);
                }
                Action::Unsubscribe { client, id } => self.robot.hub().unsubscribe(client, id),
                // No call has this ticket: the core knows of one change at a time.
                Action::StoreTokens(change) => self.begin(Ticket::MAX, Job::Tokens(self.tokens.clone(), change)),
            }
        }
    }

    fn publish(&mut self, ticket: Ticket, delivered: Delivered) {
        if let Err(answer) = self.robot.publish(ticket, delivered) {
            self.answer(ticket, answer);
        }
    }

    fn published(&mut self) {
        while let Some((ticket, published)) = self.robot.published() {
            let done = match published {
                Ok(()) => Done::Reply(Box::new(Reply::Done { id: 0 }), Vec::new(), None),
                Err(answer) => Done::Answer(answer),
            };
            self.done(ticket, done);
        }
    }

    fn plugin(&mut self, ticket: Ticket, plugin: String, verb: Verb) {
        let unit = self.unit_of.get(&plugin).cloned().unwrap_or_default();
        self.begin(ticket, Job::Plugin { unit, plugin, verb });
    }

    fn ask(&mut self, ticket: Ticket, process: &str, request: Box<OperatorRequest>, asked_ns: u64) {
        if let Err(answer) = self.robot.ask(ticket, process, request, asked_ns) {
            self.answer(ticket, answer);
        }
    }

    fn ask_with_mission(&mut self, ticket: Ticket, process: String, request: Box<OperatorRequest>, text: String) {
        let Some(run) = self.robot.run() else { return self.answer(ticket, self.robot.absent()) };
        self.missions.insert(ticket, (process, request, now_ns()));
        self.begin(ticket, Job::Mission(run, text));
    }

    fn look(&mut self, ticket: Ticket, what: Question) {
        let reply = |reply| Done::Reply(Box::new(reply), Vec::new(), None);
        let present = self.robot.run();
        match what {
            Question::Robot => {
                let robot = self.facts();
                self.done(ticket, reply(Reply::Robot { id: 0, robot }));
            }
            Question::Channels => {
                let channels = self.channels();
                self.done(
                    ticket,
                    match channels {
                        Ok(channels) => reply(Reply::Channels { id: 0, channels }),
                        Err(answer) => Done::Answer(answer),
                    },
                );
            }
            Question::Configuration => match present {
                Some(run) => self.begin(ticket, Job::Configuration(run)),
                None => self.answer(ticket, self.robot.absent()),
            },
            Question::Runs => self.begin(ticket, Job::Runs(present)),
            Question::Files(run) => self.begin(ticket, Job::Files(present, run)),
            Question::Open(..) if !self.takes_a_descriptor(ticket) => {
                self.answer(ticket, Box::new(Reason::GatewayBusy { most: DESCRIPTORS }.answer()));
            }
            Question::Open(run, file) => self.begin(ticket, Job::Open(present, run, file)),
            Question::Doctor => self.begin(ticket, Job::Doctor(self.system.clone(), self.robot.supervisor())),
            Question::RobotFile(texts) => {
                if let Some((user, role)) = self.core.described(ticket) {
                    eprintln!("gateway: {user} ({}): store a robot file", role.name());
                }
                let (system, domain) = (self.system.clone(), self.domain.clone());
                self.begin(ticket, Job::RobotFile { system, domain, texts, asked: Instant::now() });
            }
            Question::Make(run, what) => self.begin(ticket, Job::Make(present, run, what)),
            Question::Remove(run) => {
                // No channel of the robot records it, because a run that is over has none.
                if let Some((user, role)) = self.core.described(ticket) {
                    eprintln!("gateway: {user} ({}): delete the run {run}", role.name());
                }
                self.begin(ticket, Job::Remove(present, run));
            }
        }
    }

    fn facts(&mut self) -> Option<RobotFacts> {
        let now = now_ns();
        match &self.facts {
            Some((found_ns, facts)) if now < found_ns + FOUND_NS => facts.clone(),
            _ => self.facts.insert((now, self.robot.facts())).1.clone(),
        }
    }

    fn channels(&mut self) -> Result<Vec<ChannelRow>, Box<RequestAnswer>> {
        let now = now_ns();
        match &self.rows {
            Some((found_ns, rows)) if now < found_ns + FOUND_NS => Ok(rows.clone()),
            _ => Ok(self.rows.insert((now, self.robot.channels()?)).1.clone()),
        }
    }

    fn takes_a_descriptor(&self, ticket: Ticket) -> bool {
        let client = self.core.client_of(ticket).and_then(|client| self.clients.get(&client));
        client.is_some_and(|client| client.outbox.has_room_for_a_descriptor())
    }

    fn begin(&mut self, ticket: Ticket, job: Job) {
        let disk = match job {
            Job::Mission(..) | Job::Tokens(..) => &mut self.inbox,
            Job::Plugin { .. } => &mut self.units,
            Job::Make(..) | Job::Remove(..) | Job::Sweep | Job::Doctor(..) | Job::RobotFile { .. } => &mut self.makers,
            _ => &mut self.disk,
        };
        match disk.begin(ticket, job) {
            Ok(()) => {}
            Err(Job::Tokens(_, change)) => self.stored(change, Err("too much waits for the disk".to_owned())),
            Err(_) => {
                self.missions.remove(&ticket);
                let reason = Reason::GatewayBusy { most: crate::core::UNANSWERED };
                self.answer(ticket, Box::new(reason.answer()));
            }
        }
    }

    fn stored(&mut self, change: Box<TokenChange>, stored: Result<(), String>) {
        let actions = self.core.step(now_ns(), Event::Stored { change, stored });
        self.carry_out(actions);
    }

    fn robot_answers(&mut self) {
        let answers = self.robot.answers(now_ns(), |ticket| self.core.is_wanted(ticket));
        for (ticket, answer) in answers {
            self.log(ticket, &answer);
            self.answer(ticket, answer);
        }
    }

    fn disk_outcomes(&mut self) {
        while let Some(outcome) = self.units.poll() {
            if let Outcome::Done(ticket, Done::Answer(answer)) = &outcome {
                // The gateway itself starts the plug-ins of the system file.
                if !self.log(*ticket, answer) {
                    eprintln!("gateway: {}", text_of(&answer.text));
                }
            }
            self.disk_outcome(outcome);
        }
        while let Some(outcome) = self.inbox.poll().or_else(|| self.disk.poll()).or_else(|| self.makers.poll()) {
            self.disk_outcome(outcome);
        }
    }

    /// Writes an answer and who asked to the log; false if no client asked.
    fn log(&self, ticket: Ticket, answer: &RequestAnswer) -> bool {
        let Some((user, role)) = self.core.described(ticket) else { return false };
        eprintln!("gateway: {user} ({}): {}", role.name(), text_of(&answer.text));
        true
    }

    fn disk_outcome(&mut self, outcome: Outcome) {
        match outcome {
            // Several may have been opened at once.
            Outcome::Done(ticket, Done::Reply(_, _, Some(_))) if !self.takes_a_descriptor(ticket) => {
                self.answer(ticket, Box::new(Reason::GatewayBusy { most: DESCRIPTORS }.answer()));
            }
            Outcome::Done(ticket, done) => {
                self.missions.remove(&ticket);
                self.done(ticket, done);
            }
            Outcome::Tokens(change, stored) => self.stored(change, stored),
            Outcome::Stored(ticket) => {
                if let Some((process, request, asked_ns)) = self.missions.remove(&ticket) {
                    self.ask(ticket, &process, request, asked_ns);
                }
            }
        }
    }

    fn samples(&mut self) {
        for delivery in self.robot.samples(now_ns()) {
            match delivery {
                // The gateway's own subscription.
                Delivery::Definition(NO_CLIENT, reply) => self.reads_motions = is_authority(&reply),
                Delivery::Sample(NO_CLIENT, _, bytes, ..) => {
                    if let Some(seen) = motion(&bytes).filter(|_| self.reads_motions) {
                        let actions = self.core.step(now_ns(), Event::Moved(seen));
                        self.carry_out(actions);
                    }
                }
                Delivery::Definition(client, reply) => self.post(client, &reply, &[], None),
                Delivery::Sample(client, id, bytes, missed, dropped) => {
                    let of_all = || self.clients.values().map(|client| client.outbox.large()).sum();
                    let large: usize = if is_large(bytes.len()) { of_all() } else { 0 };
                    let Some(entry) = self.clients.get_mut(&client) else { continue };
                    if entry.closes_ns.is_some() || !entry.outbox.has_room(bytes.len(), large) {
                        count(&dropped);
                        continue;
                    }
                    let reply = Reply::Sample { id, dropped: dropped.get(), missed };
                    entry.outbox.push_sample(encode(&reply.header(), &bytes));
                }
            }
        }
    }

    fn answer(&mut self, ticket: Ticket, answer: Box<RequestAnswer>) {
        self.done(ticket, Done::Answer(answer));
    }

    fn done(&mut self, ticket: Ticket, reply: Done) {
        let actions = self.core.step(now_ns(), Event::Answered { ticket, reply });
        self.carry_out(actions);
    }

    fn post(&mut self, client: ClientId, reply: &Reply, body: &[u8], descriptor: Option<OwnedFd>) {
        if let Some(entry) = self.clients.get_mut(&client).filter(|entry| entry.closes_ns.is_none()) {
            entry.outbox.push(encode(&reply.header(), body), descriptor);
        }
    }

    fn send_and_close(&mut self) {
        let now = now_ns();
        for entry in self.clients.values_mut() {
            entry.broken |= entry.outbox.send(entry.socket.as_fd()).is_err();
            let done = |closes_ns| now >= closes_ns || entry.outbox.waiting() == 0;
            entry.broken |= entry.closes_ns.is_some_and(done);
        }
        let gone: Vec<ClientId> =
            self.clients.iter().filter(|(_, entry)| entry.broken).map(|(client, _)| *client).collect();
        for client in gone {
            self.clients.remove(&client);
            self.robot.hub().remove(client);
            let actions = self.core.step(now, Event::Gone { client });
            self.carry_out(actions);
        }
    }
}

/// The path of the socket for processes in other folders.
fn absolute(socket: &Path) -> PathBuf {
    std::path::absolute(socket).unwrap_or_else(|_| socket.to_owned())
}

fn is_authority(definition: &Reply) -> bool {
    let size = size_of::<MotorAuthority>();
    matches!(definition, Reply::Definition { type_name, size_bytes, .. }
        if *type_name == MotorAuthority::type_name() && *size_bytes == size)
}

fn motion(sample: &[u8]) -> Option<Motion> {
    let seen: MotorAuthority = bytemuck::try_pod_read_unaligned(sample).ok()?;
    Some(Motion { stamp_ns: seen.header.stamp_ns, mode: seen.mode, number: seen.motion })
}
