//! The robot, while one runs: its place on the bus, requests to its processes, and its subscriptions.

use crate::core::UNANSWERED;
use crate::events::Ticket;
use crate::hub::{Delivery, Hub};
use crate::lane::{Lane, Waiting, failed};
use crate::outlet::{Delivered, Outlet, Published};
use bus::estop::Attempt;
use bus::{Bus, BusError, Domain, Participant, deadman};
use client::{ANSWER, MOTOR_IO, PLANNER, Running, SUPERVISOR};
use gateway_protocol::{ChannelRow, MemoryFigures, RobotFacts};
use messages::{OperatorRequest, RequestAnswer, RequestBody, put_sentence};
use robot_state::Reason;
use robot_state::answers::detail;
use rustix::process::{Pid, test_kill_process};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::thread::JoinHandle;
use std::time::Duration;

/// Name under which the gateway joins the domain.
const NAME: &str = "gateway";
/// Time between two looks for the robot, ns.
const LOOK_NS: u64 = 250_000_000;
/// Time after an attempt to join that has failed, ns: the attempt itself takes a second.
const REJOIN_NS: u64 = 5_000_000_000;
/// Largest number of emergency stops under way: further ones are answered with the last of them.
const STOPS: usize = 64;

/// The gateway's places on the bus of a running robot.
struct Joined {
    /// Process id of its supervisor; another one is another life of the robot.
    supervisor: Option<u32>,
    /// What sensors publish, from the first of it on.
    outlet: Option<Outlet>,
    /// Created first and dropped last of the two: the places reserved for a stop.
    lanes: BTreeMap<String, Lane>,
    members: Bus,
    guests: Bus,
}

/// The robot of a domain, whether it runs or not.
pub(crate) struct Robot {
    name: String,
    domain: String,
    /// The gateway's own socket.
    socket: PathBuf,
    joined: Option<Joined>,
    /// The same one in each life of the robot: motor-io may survive its supervisor, and then has what was deposited.
    deadman: Option<deadman::Sender>,
    hub: Hub,
    stops: Vec<(Vec<Ticket>, Attempt)>,
    /// The last call that stops the robot.
    stopped: Ticket,
    /// The last stop, to be repeated when motor-io has answered what was sent to it before.
    again: Option<Waiting>,
    /// Requests whose robot has ended before it answered.
    orphans: Vec<Ticket>,
    /// Threads that are leaving a robot.
    leaving: Vec<JoinHandle<()>>,
    look_ns: u64,
    /// Why the robot could not be joined, to be reported once.
    unjoined: Option<String>,
}

/// Name of the lane of requests that stop the robot.
const STOP_LANE: &str = "stop";

impl Robot {
    /// The robot of that name in that domain.
    pub(crate) fn new(name: String, domain: String, socket: PathBuf) -> Self {
        let (hub, stops, orphans) = (Hub::default(), Vec::new(), Vec::new());
        Self {
            name,
            domain,
            socket,
            joined: None,
            deadman: None,
            hub,
            stops,
            stopped: 0,
            again: None,
            orphans,
            leaving: Vec::new(),
            look_ns: 0,
            unjoined: None,
        }
    }

    /// The subscriptions.
    pub(crate) fn hub(&mut self) -> &mut Hub {
        &mut self.hub
    }

    /// Looks whether the robot runs, and joins or leaves it. Returns a sentence for the log if that has changed.
    pub(crate) fn look(&mut self, now_ns: u64) -> Option<String> {
        if now_ns < self.look_ns {
            return None;
        }
        self.look_ns = now_ns + LOOK_NS;
        if !self.leaving.is_empty() {
            self.remove_remains();
        }
        let domain = Domain::existing(&self.domain).ok().flatten();
        let alive = domain.as_ref().map(Alive::in_domain).unwrap_or_default();
        let stays = self.joined.as_ref().is_some_and(|joined| alive.is_the_robot_of(joined.supervisor));
        if !alive.motor_io {
            self.unjoined = None;
        }
        if stays || self.joined.is_none() && !alive.motor_io {
            return None;
        }
        let left = self.joined.is_some();
        self.leave();
        let Some(domain) = domain.filter(|_| alive.motor_io) else {
            return left.then(|| format!("{} has ended; waiting for its next start", self.name));
        };
        match Joined::new(&domain, alive.supervisor) {
            Ok(joined) => {
                if let Err(error) = domain.set_gateway(&self.socket) {
                    eprintln!("gateway: sensors that `nims plug` starts have to be told the socket: {error}");
                }
                (self.joined, self.unjoined) = (Some(joined), None);
                Some(format!("{} runs", self.name))
            }
            Err(error) => {
                self.look_ns = now_ns + REJOIN_NS;
                let why = format!("{} runs, but cannot be joined: {error}", self.name);
                (self.unjoined.replace(why.clone()).as_ref() != Some(&why)).then_some(why)
            }
        }
    }

    /// Leaves the robot. The last one to leave a domain removes its objects.
    pub(crate) fn leave(&mut self) {
        let Some(mut joined) = self.joined.take() else { return };
        self.again = None;
        for lane in joined.lanes.values() {
            self.orphans.extend(lane.unanswered());
        }
        self.hub.detach();
        if let Some((thread, waiting)) = joined.outlet.take().map(Outlet::leave) {
            self.orphans.extend(waiting);
            self.leaving.push(thread);
        }
        drop(joined);
        self.remove_remains();
    }

    /// Removes what a robot that has ended would otherwise leave until its next start, when no thread uses it any more.
    fn remove_remains(&mut self) {
        self.leaving.retain(|thread| !thread.is_finished());
        if self.leaving.is_empty()
            && let Ok(Some(domain)) = Domain::existing(&self.domain)
            && Alive::in_domain(&domain) == Alive::default()
            && domain.alive().is_empty()
            && let Ok(claim) = domain.claim()
        {
            domain.release(claim);
        }
    }

    /// Returns whether something is under way that needs a look every few milliseconds.
    pub(crate) fn is_busy(&self) -> bool {
        let asked = |joined: &Joined| {
            joined.lanes.values().any(Lane::is_busy) || joined.outlet.as_ref().is_some_and(Outlet::is_busy)
        };
        !self.stops.is_empty() || !self.orphans.is_empty() || self.joined.as_ref().is_some_and(asked)
    }

    /// Returns what runs.
    pub(crate) fn facts(&self) -> Option<RobotFacts> {
        let domain = self.joined.as_ref()?.guests.domain();
        let running = Running::read(domain)?;
        let memory = domain.memory();
        Some(RobotFacts {
            domain: domain.name().to_owned(),
            folder: domain.root().to_owned(),
            pid: running.pid,
            system_file: running.system_file,
            run: running.run,
            processes: domain.alive().into_iter().map(|node| (node.name, node.pid)).collect(),
            memory: MemoryFigures {
                total: memory.total,
                free: memory.free,
                used: memory.used,
                unreserved: memory.unreserved,
            },
        })
    }

    /// Returns the run folder of the robot that runs.
    pub(crate) fn run(&self) -> Option<std::path::PathBuf> {
        Running::read(self.joined.as_ref()?.guests.domain()).map(|running| running.run)
    }

    /// Returns the supervisor of the robot that runs.
    pub(crate) fn supervisor(&self) -> Option<u32> {
        Running::read(self.joined.as_ref()?.guests.domain()).map(|running| running.pid)
    }

    /// Returns the channels.
    ///
    /// # Errors
    /// No robot runs, or shared memory cannot be read.
    pub(crate) fn channels(&self) -> Result<Vec<ChannelRow>, Box<RequestAnswer>> {
        let joined = self.joined.as_ref().ok_or_else(|| self.absent())?;
        let channels = joined.guests.channels().map_err(|error| failed(&error))?;
        Ok(channels.into_iter().map(|channel| client::channel_row(channel, NAME)).collect())
    }

    /// The answer while no robot runs, or none that can be joined.
    pub(crate) fn absent(&self) -> Box<RequestAnswer> {
        Box::new(match &self.unjoined {
            Some(why) => Reason::RobotUnreached { why: detail(why) }.answer(),
            None => Reason::NoRobotRuns { robot: detail(&self.name) }.answer(),
        })
    }

    /// Sends a stop to a robot that runs and is not joined, perhaps because shared memory is full: a dead-man stop that
    /// is due at once needs no place there, and has no answer. It has a sender of its own, so no later one replaces it.
    fn stop_unjoined(&self, request: &OperatorRequest) -> Option<Box<RequestAnswer>> {
        if self.joined.is_some() {
            return None;
        }
        let domain = Domain::existing(&self.domain).ok().flatten()?;
        let sent = deadman::Sender::new().ok()?.deposit(&domain, request, 0);
        let why = self.unjoined.clone().unwrap_or_else(|| format!("{} cannot be reached", self.name));
        let why = format!("{why}; the stop was sent, but this robot cannot answer: look at it");
        sent.then(|| Box::new(Reason::RobotUnreached { why: detail(why) }.answer()))
    }

    /// Sends a request.
    ///
    /// # Errors
    /// It cannot be sent: the answer.
    pub(crate) fn ask(
        &mut self,
        ticket: Ticket,
        process: &str,
        request: Box<OperatorRequest>,
        asked_ns: u64,
    ) -> Result<(), Box<RequestAnswer>> {
        let stops = request.body.is_stop();
        if stops {
            self.overtake(ticket);
            if let Some(answer) = self.stop_unjoined(&request) {
                return Err(answer);
            }
        }
        let absent = self.absent();
        let joined = self.joined.as_mut().ok_or(absent)?;
        let name = if stops { STOP_LANE } else { process };
        if !joined.lanes.contains_key(name) {
            let client = joined.members.client(process).map_err(|error| failed(&error))?;
            joined.lanes.insert(name.to_owned(), Lane::new(client));
        }
        // motor-io may take up what was sent to it before on another lane after the stop: then it is told again. What
        // ends the motion is told again also if a request that only suspends it has followed.
        let ends = |again: &Waiting| again.request.body.verb == RequestBody::VERB_STOP;
        if stops && joined.lanes.get(MOTOR_IO).is_some_and(Lane::has_sent) && !self.again.as_ref().is_some_and(ends) {
            self.again = Some(Waiting { tickets: Vec::new(), request: request.clone(), asked_ns });
        }
        let Some(lane) = joined.lanes.get_mut(name) else { return Ok(()) };
        lane.add(Waiting { tickets: vec![ticket], request, asked_ns })
    }

    /// Lets a stop overtake every motion that was requested before it.
    fn overtake(&mut self, stop: Ticket) {
        self.stopped = self.stopped.max(stop);
        // The planner takes back a motion whose requester no longer waits. One that it has answered already belongs to
        // an epoch that the stop ends.
        if let Some(lane) = self.joined.as_mut().and_then(|joined| joined.lanes.get_mut(PLANNER)) {
            lane.withdraw();
        }
    }

    /// Begins to publish what a sensor has called for; the result comes with [`Robot::published`].
    ///
    /// # Errors
    /// No robot runs, or too much waits: the answer.
    pub(crate) fn publish(&mut self, ticket: Ticket, delivered: Delivered) -> Published {
        let absent = self.absent();
        let joined = self.joined.as_mut().ok_or(absent)?;
        let outlet = match &mut joined.outlet {
            Some(outlet) => outlet,
            none => {
                let started = Outlet::start(joined.guests.domain(), NAME);
                let unstarted = |error| Reason::RobotUnreached { why: detail(format_args!("no thread: {error}")) };
                none.insert(started.map_err(|error| Box::new(unstarted(error).answer()))?)
            }
        };
        if outlet.begin(ticket, delivered) {
            return Ok(());
        }
        Err(Box::new(Reason::GatewayBusy { most: UNANSWERED }.answer()))
    }

    /// Returns the next result of what sensors have called for, if there is one.
    pub(crate) fn published(&mut self) -> Option<(Ticket, Published)> {
        self.joined.as_mut()?.outlet.as_mut()?.poll()
    }

    /// Sends an emergency stop. It needs no place on the bus, so it is sent even if the robot could not be joined.
    ///
    /// # Errors
    /// It cannot be sent: the answer.
    pub(crate) fn emergency_stop(
        &mut self,
        ticket: Ticket,
        request: &OperatorRequest,
    ) -> Result<(), Box<RequestAnswer>> {
        self.overtake(ticket);
        let domain = Domain::existing(&self.domain).map_err(|error| failed(&error))?;
        let Some(domain) = domain.filter(bus::estop::is_heard) else { return Err(self.absent()) };
        if self.stops.len() >= STOPS
            && let Some((tickets, _)) = self.stops.last_mut()
        {
            tickets.push(ticket);
            return Ok(());
        }
        let attempt = Attempt::begin(&domain, request, ANSWER).map_err(|error| failed(&error))?;
        self.stops.push((vec![ticket], attempt));
        Ok(())
    }

    /// Deposits with motor-io what it does at that instant unless this is called again before. Returns false if it
    /// could not be sent, perhaps because the queue of motor-io is full. Without a robot nothing moves.
    pub(crate) fn deposit(&mut self, due_ns: u64, request: &OperatorRequest) -> bool {
        let Some(joined) = &self.joined else { return true };
        sender(&mut self.deadman).is_some_and(|sender| sender.deposit(joined.guests.domain(), request, due_ns))
    }

    /// Withdraws what is deposited.
    pub(crate) fn withdraw(&self) {
        if let (Some(joined), Some(sender)) = (&self.joined, &self.deadman) {
            sender.withdraw(joined.guests.domain());
        }
    }

    /// Whether a stop has to be repeated, or has no answer.
    pub(crate) fn is_stopping(&self) -> bool {
        let stops = self.joined.as_ref().and_then(|joined| joined.lanes.get(STOP_LANE));
        self.again.is_some() || stops.is_some_and(Lane::is_busy)
    }

    /// Returns the answers that have arrived.
    pub(crate) fn answers(
        &mut self,
        now_ns: u64,
        is_wanted: impl Fn(Ticket) -> bool,
    ) -> Vec<(Ticket, Box<RequestAnswer>)> {
        let absent = self.absent();
        let mut answers: Vec<_> = self.orphans.drain(..).map(|ticket| (ticket, absent.clone())).collect();
        self.stops.retain_mut(|(tickets, attempt)| {
            let answer = match attempt.poll() {
                Ok(None) => return true,
                Ok(Some(answered)) => stopped(&answered),
                Err(error) => failed(&error),
            };
            answers.extend(tickets.iter().map(|ticket| (*ticket, answer.clone())));
            false
        });
        if let Some(joined) = &mut self.joined
            && !joined.lanes.get(MOTOR_IO).is_some_and(Lane::has_sent)
            && let Some((again, lane)) = self.again.take().zip(joined.lanes.get_mut(STOP_LANE))
        {
            // A stop is always taken.
            let _ = lane.add(again);
        }
        let stopped = self.stopped;
        for lane in self.joined.iter_mut().flat_map(|joined| joined.lanes.values_mut()) {
            lane.poll(|waiting| waiting.refusal(now_ns, stopped, &is_wanted), now_ns, &mut answers);
        }
        answers
    }

    /// Returns the samples that have arrived.
    pub(crate) fn samples(&mut self, now_ns: u64) -> Vec<Delivery> {
        let Some(joined) = &self.joined else { return Vec::new() };
        match self.hub.poll(&joined.guests, now_ns) {
            Ok(deliveries) => deliveries,
            Err(error) => {
                // Shared memory is damaged: joined again.
                eprintln!("gateway: {error}");
                self.leave();
                Vec::new()
            }
        }
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        self.leave();
        for thread in std::mem::take(&mut self.leaving) {
            let _ = thread.join();
        }
        self.remove_remains();
    }
}

impl Joined {
    /// Joins a robot, and takes the places for stops at once.
    fn new(domain: &Domain, supervisor: Option<u32>) -> Result<Self, BusError> {
        let members = Bus::join_as(domain, NAME, Participant::Member)?;
        let mut lanes = BTreeMap::new();
        for (name, process) in
            [(STOP_LANE, MOTOR_IO), (MOTOR_IO, MOTOR_IO), (PLANNER, PLANNER), (SUPERVISOR, SUPERVISOR)]
        {
            lanes.insert(name.to_owned(), Lane::new(members.client(process)?));
        }
        // Lanes to other processes are made when they are asked for, while stops may come.
        members.set_patience(Duration::ZERO);
        let guests = Bus::join_as(domain, NAME, Participant::Guest)?;
        Ok(Self { supervisor, outlet: None, lanes, members, guests })
    }
}

/// Which of the two processes that keep a robot alive are running.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Alive {
    supervisor: Option<u32>,
    motor_io: bool,
}

impl Alive {
    fn in_domain(domain: &Domain) -> Self {
        let lives = |pid: u32| {
            let pid = i32::try_from(pid).ok().and_then(Pid::from_raw);
            pid.is_some_and(|pid| test_kill_process(pid).is_ok())
        };
        let supervisor = Running::read(domain).map(|running| running.pid).filter(|pid| lives(*pid));
        let motor_io = domain.alive().iter().any(|node| node.name == MOTOR_IO && lives(node.pid));
        Self { supervisor, motor_io }
    }

    /// Returns whether the robot that was joined with this supervisor still runs: while one of the two does, and no
    /// other supervisor has begun.
    fn is_the_robot_of(&self, supervisor: Option<u32>) -> bool {
        match self.supervisor {
            Some(pid) => supervisor == Some(pid),
            None => self.motor_io,
        }
    }
}

/// The sender of dead-man stops, made when it is needed first.
fn sender(kept: &mut Option<deadman::Sender>) -> Option<&deadman::Sender> {
    if kept.is_none() {
        *kept = deadman::Sender::new().ok();
    }
    kept.as_ref()
}

/// The answer to an emergency stop, which comes without its sentence.
fn stopped(answered: &OperatorRequest) -> Box<RequestAnswer> {
    let mut answer = answered.recorded_answer().unwrap_or_default();
    let sentence = client::sentence_of_stop(answered);
    put_sentence(&mut answer.text, &sentence);
    Box::new(answer)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bus::clock::now_ns;
    use messages::Request;

    #[test]
    fn what_ends_the_motion_is_told_again_also_after_a_request_that_suspends_it() {
        for (stops, repeated) in [
            ([Request::Stop, Request::Hold], RequestBody::VERB_STOP),
            ([Request::Hold, Request::Stop], RequestBody::VERB_STOP),
            ([Request::Pause, Request::Hold], RequestBody::VERB_HOLD),
        ] {
            let domain = Domain::for_test();
            let motor_io = Bus::join(&domain, MOTOR_IO).unwrap();
            let _server = motor_io.server(MOTOR_IO).unwrap();
            let mut robot = Robot::new("demo".to_owned(), "demo".to_owned(), PathBuf::from("unused"));
            robot.joined = Some(Joined::new(&domain, None).unwrap());
            let ask = |robot: &mut Robot, ticket, request: Request| {
                robot.ask(ticket, MOTOR_IO, Box::new(request.encode().unwrap()), now_ns()).unwrap();
            };
            ask(&mut robot, 1, Request::Resume);
            // It is sent, and has no answer yet.
            assert!(robot.answers(now_ns(), |_| true).is_empty());
            for (ticket, stop) in (2..).zip(stops) {
                ask(&mut robot, ticket, stop);
            }
            assert_eq!(robot.again.as_ref().map(|again| again.request.body.verb), Some(repeated));
        }
    }

    #[test]
    fn a_robot_that_runs_and_cannot_be_joined_is_stopped_all_the_same() {
        let domain = Domain::for_test();
        let mut robot = Robot::new("demo".to_owned(), domain.name().to_owned(), PathBuf::from("unused"));
        let refused = |robot: &mut Robot, ticket, request: Request| {
            robot.ask(ticket, MOTOR_IO, Box::new(request.encode().unwrap()), now_ns()).unwrap_err().reason
        };
        let none_runs = Reason::NoRobotRuns { robot: detail("demo") }.code();
        assert_eq!(refused(&mut robot, 1, Request::Stop), none_runs);
        let mut motor_io = deadman::Receiver::open(&domain).unwrap();
        let unreached = Reason::RobotUnreached { why: detail("") }.code();
        for why in [None, Some("demo runs, but cannot be joined: shared memory is full".to_owned())] {
            robot.unjoined = why;
            // Both arrive before motor-io reads: the second one does not replace the first.
            assert_eq!([Request::Stop, Request::Hold].map(|request| refused(&mut robot, 2, request)), [unreached; 2]);
            let stopped: Vec<_> = (0..3).map(|_| motor_io.overdue().map(|request| request.body.verb)).collect();
            assert_eq!(stopped, [Some(RequestBody::VERB_STOP), Some(RequestBody::VERB_HOLD), None]);
            refused(&mut robot, 3, Request::Resume);
            assert!(motor_io.overdue().is_none());
        }
    }
}
