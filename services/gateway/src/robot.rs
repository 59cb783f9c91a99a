//! The robot, while one runs: its place on the bus, requests to its processes, and its subscriptions.

use crate::events::{OwnMessage, Ticket};
use crate::hub::{Delivery, Hub};
use crate::lane::{Lane, Waiting, failed, stops};
use crate::own_channels::OwnChannels;
use bus::estop::Attempt;
use bus::{Bus, BusError, Domain, Participant, Publisher};
use client::{ANSWER, MOTOR_IO, PLANNER, Running, SUPERVISOR};
use gateway_protocol::{ChannelRow, MemoryFigures, RobotFacts};
use messages::{Header, OperatorRequest, Reading, RequestAnswer, put_sentence};
use robot_state::Reason;
use robot_state::answers::detail;
use rustix::process::{Pid, test_kill_process};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Name under which the gateway joins the domain.
const NAME: &str = "gateway";
/// Time between two looks for the robot, ns.
const LOOK_NS: u64 = 250_000_000;
/// Time after an attempt to join that has failed, ns: the attempt itself takes a second.
const REJOIN_NS: u64 = 5_000_000_000;
/// Time between two attempts to create the channel of a sensor, ns.
const AGAIN_NS: u64 = 1_000_000_000;
/// Largest number of emergency stops under way: further ones are answered with the last of them.
const STOPS: usize = 64;

/// The gateway's places on the bus of a running robot.
struct Joined {
    /// Process id of its supervisor; another one is another life of the robot.
    supervisor: Option<u32>,
    /// Channels of plug-ins.
    sensors: BTreeMap<String, SensorChannel>,
    /// Channels of sensors with their own messages.
    declared: OwnChannels,
    /// Created first and dropped last of the two: the places reserved for a stop.
    lanes: BTreeMap<String, Lane>,
    members: Bus,
    guests: Bus,
}

/// The channel of a plug-in; or until when it is not tried to create it again, ns, with the reason.
type SensorChannel = Result<Publisher<Reading>, (u64, Box<RequestAnswer>)>;

/// The robot of a domain, whether it runs or not.
pub(crate) struct Robot {
    name: String,
    domain: String,
    /// The gateway's own socket.
    socket: PathBuf,
    joined: Option<Joined>,
    hub: Hub,
    stops: Vec<(Vec<Ticket>, Attempt)>,
    /// The last call that stops the robot.
    stopped: Ticket,
    /// The last stop, to be repeated when motor-io has answered what was sent to it before.
    again: Option<Waiting>,
    /// Requests whose robot has ended before it answered.
    orphans: Vec<Ticket>,
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
            hub,
            stops,
            stopped: 0,
            again: None,
            orphans,
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
        let domain = Domain::existing(&self.domain).ok().flatten();
        let alive = domain.as_ref().map(Alive::in_domain).unwrap_or_default();
        let stays = self.joined.as_ref().is_some_and(|joined| alive.is_the_robot_of(joined.supervisor));
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
        let Some(joined) = self.joined.take() else { return };
        self.again = None;
        for lane in joined.lanes.values() {
            self.orphans.extend(lane.unanswered());
        }
        self.hub.detach();
        drop(joined);
        // The objects of a robot that has ended would otherwise remain until its next start.
        if let Ok(Some(domain)) = Domain::existing(&self.domain)
            && Alive::in_domain(&domain) == Alive::default()
            && domain.alive().is_empty()
            && let Ok(claim) = domain.claim()
        {
            domain.release(claim);
        }
    }

    /// Returns whether something is under way that needs a look every few milliseconds.
    pub(crate) fn is_busy(&self) -> bool {
        let asked = |joined: &Joined| joined.lanes.values().any(Lane::is_busy);
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

    /// Returns the channels.
    ///
    /// # Errors
    /// No robot runs, or shared memory cannot be read.
    pub(crate) fn channels(&self) -> Result<Vec<ChannelRow>, Box<RequestAnswer>> {
        let joined = self.joined.as_ref().ok_or_else(|| self.absent())?;
        let channels = joined.guests.channels().map_err(|error| failed(&error))?;
        Ok(channels.into_iter().map(|channel| client::channel_row(channel, NAME)).collect())
    }

    /// The answer while no robot runs.
    pub(crate) fn absent(&self) -> Box<RequestAnswer> {
        Box::new(Reason::NoRobotRuns { robot: detail(&self.name) }.answer())
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
        let stops = stops(&request);
        if stops {
            self.overtake(ticket);
        }
        let absent = self.absent();
        let joined = self.joined.as_mut().ok_or(absent)?;
        let name = if stops { STOP_LANE } else { process };
        if !joined.lanes.contains_key(name) {
            let client = joined.members.client(process).map_err(|error| failed(&error))?;
            joined.lanes.insert(name.to_owned(), Lane::new(client));
        }
        // motor-io may take up what was sent to it before on another lane after the stop: then it is told again.
        if stops && joined.lanes.get(MOTOR_IO).is_some_and(Lane::has_sent) {
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

    /// Publishes a reading of a plug-in. Its channel is created with the first one, and stays as long as the robot:
    /// connections that come and go make no further channels.
    ///
    /// # Errors
    /// No robot runs, or the channel cannot be created: the answer.
    pub(crate) fn publish(
        &mut self,
        sensor: &str,
        mut reading: Reading,
        now_ns: u64,
    ) -> Result<(), Box<RequestAnswer>> {
        let absent = self.absent();
        let joined = self.joined.as_mut().ok_or(absent)?;
        let created = joined.sensors.get(sensor);
        if created.is_none_or(|created| created.as_ref().is_err_and(|(again_ns, _)| now_ns >= *again_ns)) {
            // As a guest: it leaves the places and the memory that the robot's own processes need.
            let publisher = joined.guests.publisher::<Reading>(&format!("sensor/{sensor}"));
            let publisher = publisher.map_err(|error| (now_ns + AGAIN_NS, failed(&error)));
            joined.sensors.insert(sensor.to_owned(), publisher);
        }
        match joined.sensors.get_mut(sensor) {
            Some(Ok(publisher)) => publisher.send(&mut reading).map(|_| ()).map_err(|error| failed(&error)),
            Some(Err((_, answer))) => Err(answer.clone()),
            None => Ok(()),
        }
    }

    /// Opens the channel of a sensor with its own message. It stays as long as the robot.
    ///
    /// # Errors
    /// No robot runs, or as [`OwnChannels::open`]: the answer.
    pub(crate) fn declare(&mut self, sensor: &OwnMessage, now_ns: u64) -> Result<(), Box<RequestAnswer>> {
        let absent = self.absent();
        let joined = self.joined.as_mut().ok_or(absent)?;
        joined.declared.open(&joined.guests, sensor, now_ns).map(|_| ())
    }

    /// Publishes a sample of a sensor with its own message.
    ///
    /// # Errors
    /// As [`Robot::declare`].
    pub(crate) fn publish_sample(
        &mut self,
        sensor: &OwnMessage,
        header: Header,
        sample: &[u8],
        now_ns: u64,
    ) -> Result<(), Box<RequestAnswer>> {
        let absent = self.absent();
        let joined = self.joined.as_mut().ok_or(absent)?;
        let publisher = joined.declared.open(&joined.guests, sensor, now_ns)?;
        publisher.send(header, sample).map_err(|error| failed(&error))
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
        let guests = Bus::join_as(domain, NAME, Participant::Guest)?;
        Ok(Self { supervisor, sensors: BTreeMap::new(), declared: OwnChannels::default(), lanes, members, guests })
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

/// The answer to an emergency stop, which comes without its sentence.
fn stopped(answered: &OperatorRequest) -> Box<RequestAnswer> {
    let mut answer = answered.recorded_answer().unwrap_or_default();
    let sentence = client::sentence_of_stop(answered);
    put_sentence(&mut answer.text, &sentence);
    Box::new(answer)
}
