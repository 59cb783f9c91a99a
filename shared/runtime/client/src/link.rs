//! The way to a robot: its shared memory for its user, or its gateway for others. Commands are the same on both.

use crate::connection::{Connection, unexpected};
use crate::robot::{ANSWER, MOTOR_IO, PLANNER, Running, UNEASY, running, sample, warn_of_silence};
use bus::{Bus, Memory, NodeInfo, Subscriber, Waiter, clock};
use command::{Answer, Failure};
use config::SystemFile;
use gateway_protocol::{Call, ChannelRow, FileRow, Reply, RobotFacts, RunRow, TokenRow};
use messages::{Message, OperatorRequest, Request};
use std::fs::File;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// Time for which a file that the gateway is too busy to open is asked for again, and time between two attempts, ns.
const OPEN_NS: u64 = 10 * clock::SECOND_NS;
const AGAIN_NS: u64 = 100_000_000;

/// The way to a robot.
#[derive(Debug)]
pub enum RobotLink {
    /// Through its shared memory, as its user.
    Bus(Box<Bus>),
    /// Through its gateway.
    Gateway(Gateway),
}

/// The facts of a channel, without this process among those that have it open.
#[must_use]
pub fn channel_row(channel: bus::ChannelInfo, process: &str) -> ChannelRow {
    ChannelRow {
        name: channel.name,
        type_name: channel.type_name,
        size_bytes: channel.size,
        buffer: channel.buffer,
        history: channel.history,
        has_schema: channel.schema.is_some(),
        processes: channel.holders.into_iter().map(|node| node.name).filter(|name| name != process).collect(),
    }
}

/// A connection to the gateway of a robot.
#[derive(Debug, Clone)]
pub struct Gateway(pub(crate) Rc<Connection>);

impl From<Bus> for RobotLink {
    fn from(bus: Bus) -> Self {
        Self::Bus(Box::new(bus))
    }
}

impl RobotLink {
    /// Sends a request to a process and waits for its answer.
    ///
    /// # Errors
    /// A text that a request cannot hold; the process does not run, or does not answer.
    pub fn ask(&self, process: &str, request: &Request) -> Answer<OperatorRequest> {
        match self {
            Self::Bus(bus) => Ok(bus.client(process)?.ask(&sample(request)?, ANSWER)?),
            Self::Gateway(gateway) => gateway.ask(process, request, &[]),
        }
    }

    /// Requests a mission by its text.
    ///
    /// # Errors
    /// As [`RobotLink::ask`]; the run folder cannot be written.
    pub fn fly(&self, mission: &str, text: &str, continues: bool) -> Answer<OperatorRequest> {
        let hash = match self {
            Self::Bus(bus) => config::store_mission(&running(bus)?.run, text).map_err(Failure::not_now)?,
            Self::Gateway(_) => config::mission_hash(text),
        };
        let request = Request::Run { mission: mission.to_owned(), hash, continues };
        match self {
            Self::Bus(_) => self.ask(PLANNER, &request),
            Self::Gateway(gateway) => gateway.ask(PLANNER, &request, text.as_bytes()),
        }
    }

    /// Name of the robot's domain, or of its gateway's robot.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Bus(bus) => bus.domain().name(),
            Self::Gateway(gateway) => gateway.0.robot(),
        }
    }

    /// Subscribes to a channel.
    ///
    /// # Errors
    /// The channel cannot be opened.
    pub fn subscriber<T: Message>(&self, channel: &str) -> Answer<Samples<T>> {
        Ok(match self {
            Self::Bus(bus) => Samples::Bus(Box::new(bus.subscriber(channel)?)),
            Self::Gateway(gateway) => Samples::Gateway(gateway.subscribe(channel)?, PhantomData),
        })
    }

    /// Creates a waiter for channels, which must also be subscribed to.
    ///
    /// # Errors
    /// The channels cannot be opened.
    pub fn waiter(&self, channels: &[&str]) -> Answer<LinkWaiter> {
        Ok(match self {
            Self::Bus(bus) => LinkWaiter::Bus(Box::new(bus.waiter(channels)?)),
            Self::Gateway(gateway) => LinkWaiter::Gateway(gateway.clone()),
        })
    }

    /// The robot that runs there, if it was started by a supervisor.
    ///
    /// # Errors
    /// The gateway does not answer.
    pub fn running(&self) -> Answer<Option<Running>> {
        Ok(match self {
            Self::Bus(bus) => Running::read(bus.domain()),
            Self::Gateway(gateway) => {
                gateway.facts()?.map(|facts| Running { pid: facts.pid, system_file: facts.system_file, run: facts.run })
            }
        })
    }

    /// The processes in its domain.
    ///
    /// # Errors
    /// The gateway does not answer.
    pub fn alive(&self) -> Answer<Vec<NodeInfo>> {
        let row = |(name, pid)| NodeInfo { name, pid };
        Ok(match self {
            Self::Bus(bus) => bus.domain().alive(),
            Self::Gateway(gateway) => gateway.robot()?.processes.into_iter().map(row).collect(),
        })
    }

    /// The folder of its domain.
    ///
    /// # Errors
    /// The gateway does not answer.
    pub fn domain_folder(&self) -> Answer<PathBuf> {
        Ok(match self {
            Self::Bus(bus) => bus.domain().root().to_owned(),
            Self::Gateway(gateway) => gateway.robot()?.folder,
        })
    }

    /// Its shared memory.
    ///
    /// # Errors
    /// The gateway does not answer.
    pub fn memory(&self) -> Answer<Memory> {
        Ok(match self {
            Self::Bus(bus) => bus.domain().memory(),
            Self::Gateway(gateway) => {
                let memory = gateway.robot()?.memory;
                Memory { total: memory.total, free: memory.free, used: memory.used, unreserved: memory.unreserved }
            }
        })
    }

    /// Its channels by name.
    ///
    /// # Errors
    /// They cannot be listed.
    pub fn channels(&self) -> Answer<Vec<ChannelRow>> {
        let bus = match self {
            Self::Bus(bus) => bus,
            Self::Gateway(gateway) => return gateway.channels(),
        };
        Ok(bus.channels()?.into_iter().map(|channel| channel_row(channel, bus.process())).collect())
    }

    /// The system file that its run uses; `name`: which copy in the run folder.
    pub(crate) fn system_file(&self, name: &str) -> Answer<SystemFile> {
        match self {
            Self::Bus(bus) => {
                let running = running(bus)?;
                let copy = running.run.join(name);
                // The robot can still be landed after its run folder was deleted.
                let path = if copy.is_file() { &copy } else { &running.system_file };
                SystemFile::load(path).map_err(Failure::not_now)
            }
            Self::Gateway(gateway) => {
                let folder = gateway.configuration_folder()?;
                SystemFile::load(&folder.join(name)).map_err(Failure::not_now)
            }
        }
    }
}

/// Writes the files of a robot's configuration into a temporary folder of this user, as they are in the run folder.
///
/// # Errors
/// The folder cannot be written.
pub fn unpack(files: &[FileRow], body: &[u8]) -> Answer<tempfile::TempDir> {
    let folder = command::temporary_folder()?;
    let mut rest = body;
    for file in files {
        let split = usize::try_from(file.bytes).ok().and_then(|bytes| rest.split_at_checked(bytes));
        let Some((bytes, after)) = split else { break };
        // A name of the gateway leads nowhere else either.
        let plain = Path::new(&file.name).file_name().map_or_else(|| Path::new("x"), Path::new);
        std::fs::write(folder.path().join(plain), bytes).map_err(Failure::not_now)?;
        rest = after;
    }
    Ok(folder)
}

impl Gateway {
    /// Connects to a gateway.
    ///
    /// # Errors
    /// No gateway listens there, it is closed to this user, or it refuses the connection.
    pub fn connect(path: &Path) -> Answer<Self> {
        Ok(Self(Rc::new(Connection::open(path)?)))
    }

    fn ask(&self, process: &str, request: &Request, body: &[u8]) -> Answer<OperatorRequest> {
        self.ask_with(process, request, body, ANSWER.as_nanos() as u64, || {})
    }

    fn ask_with(
        &self,
        process: &str,
        request: &Request,
        body: &[u8],
        patience_ns: u64,
        uneasy: impl FnOnce(),
    ) -> Answer<OperatorRequest> {
        let mut asked = sample(request)?;
        // Only a fault names its process: the gateway knows the others.
        let process = matches!(request, Request::Fault { .. }).then(|| process.to_owned());
        let call = Call::Ask {
            id: self.0.next_id(),
            request: request.clone(),
            process,
            held: false,
            at_ns: None,
            pressed_ns: None,
        };
        let (reply, _) = self.0.exchange_with(&call, body, patience_ns, uneasy)?;
        asked.put_answer(&reply.request_answer().ok_or_else(|| unexpected(&reply))?);
        Ok(asked)
    }

    /// Sends an emergency stop. It warns after a second without an answer.
    ///
    /// # Errors
    /// It is refused, or not answered.
    pub fn emergency_stop(&self) -> Answer<OperatorRequest> {
        self.ask_with(MOTOR_IO, &Request::Estop, &[], UNEASY.as_nanos() as u64, warn_of_silence)
    }

    /// Subscribes to a channel, which may not exist yet.
    ///
    /// # Errors
    /// Refused.
    pub fn subscribe(&self, channel: &str) -> Answer<Subscription> {
        Ok(Subscription { gateway: self.clone(), id: self.0.subscribe(channel)?, channel: channel.to_owned() })
    }

    fn facts(&self) -> Answer<Option<RobotFacts>> {
        match self.0.call(&Call::Robot { id: self.0.next_id() }, &[])?.0 {
            Reply::Robot { robot, .. } => Ok(robot),
            other => Err(unexpected(&other)),
        }
    }

    fn robot(&self) -> Answer<RobotFacts> {
        self.facts()?.ok_or_else(|| {
            let reason = robot_state::Reason::NoRobotRuns { robot: robot_state::answers::detail(self.0.robot()) };
            Failure::NotNow(reason.to_string())
        })
    }

    fn channels(&self) -> Answer<Vec<ChannelRow>> {
        match self.0.call(&Call::Channels { id: self.0.next_id() }, &[])?.0 {
            Reply::Channels { channels, .. } => Ok(channels),
            other => Err(unexpected(&other)),
        }
    }

    /// Writes the files of the robot's configuration into a folder of this user, as they are in the run folder. It
    /// exists as long as the connection.
    fn configuration_folder(&self) -> Answer<PathBuf> {
        if let Some(folder) = self.0.kept() {
            return Ok(folder);
        }
        let (files, body) = match self.0.call(&Call::Configuration { id: self.0.next_id() }, &[])? {
            (Reply::Configuration { files, .. }, body) => (files, body),
            (other, _) => return Err(unexpected(&other)),
        };
        let folder = unpack(&files, &body)?;
        let path = folder.path().to_owned();
        self.0.keep(folder);
        Ok(path)
    }

    /// The finished runs.
    ///
    /// # Errors
    /// They cannot be listed.
    pub fn runs(&self) -> Answer<Vec<RunRow>> {
        match self.0.call(&Call::Runs { id: self.0.next_id() }, &[])?.0 {
            Reply::Runs { runs, .. } => Ok(runs),
            other => Err(unexpected(&other)),
        }
    }

    /// The files of a finished run.
    ///
    /// # Errors
    /// There is no such run.
    pub fn files(&self, run: &str) -> Answer<Vec<FileRow>> {
        match self.0.call(&Call::Files { id: self.0.next_id(), run: run.to_owned() }, &[])?.0 {
            Reply::Files { files, .. } => Ok(files),
            other => Err(unexpected(&other)),
        }
    }

    /// Opens a file of a finished run for reading.
    ///
    /// # Errors
    /// There is no such file.
    pub fn open(&self, run: &str, file: &str) -> Answer<File> {
        let busy = [robot_state::Reason::GatewayBusy { most: 0 }, robot_state::Reason::AskedTooOften { per_s: 0.0 }];
        let give_up = clock::now_ns() + OPEN_NS;
        let reply = loop {
            let call = Call::Open { id: self.0.next_id(), run: run.to_owned(), file: file.to_owned() };
            let reply = self.0.exchange(&call, &[])?.0;
            // The gateway opens a bounded number of files per second, and a run may have more.
            let is_busy =
                reply.request_answer().is_some_and(|answer| busy.iter().any(|reason| reason.code() == answer.reason));
            if !is_busy || clock::now_ns() >= give_up {
                break reply;
            }
            clock::sleep_until(clock::now_ns() + AGAIN_NS);
        };
        match reply {
            Reply::Opened { .. } => self.0.descriptor().map(File::from).ok_or_else(|| {
                Failure::NotNow(
                    "the gateway's reply has no descriptor; use the nims of the same installation".to_owned(),
                )
            }),
            other => Err(unexpected(&other)),
        }
    }

    /// Creates a token and returns its secret.
    ///
    /// # Errors
    /// Refused.
    pub fn add_token(&self, name: &str, role: &str) -> Answer<String> {
        let call = Call::TokenAdd { id: self.0.next_id(), name: name.to_owned(), role: role.to_owned() };
        match self.0.call(&call, &[])?.0 {
            Reply::Token { secret, .. } => Ok(secret),
            other => Err(unexpected(&other)),
        }
    }

    /// Creates a code with which one browser gets a token; returns it with the time for which it is valid, s.
    ///
    /// # Errors
    /// Refused.
    pub fn add_code(&self, name: &str, role: &str) -> Answer<(String, f64)> {
        let call = Call::CodeAdd { id: self.0.next_id(), name: name.to_owned(), role: role.to_owned() };
        match self.0.call(&call, &[])?.0 {
            Reply::Code { code, valid_s, .. } => Ok((code, valid_s)),
            other => Err(unexpected(&other)),
        }
    }

    /// The tokens, without their secrets.
    ///
    /// # Errors
    /// Refused.
    pub fn tokens(&self) -> Answer<Vec<TokenRow>> {
        match self.0.call(&Call::TokenList { id: self.0.next_id() }, &[])?.0 {
            Reply::Tokens { tokens, .. } => Ok(tokens),
            other => Err(unexpected(&other)),
        }
    }

    /// Revokes a token.
    ///
    /// # Errors
    /// Refused.
    pub fn revoke_token(&self, name: &str) -> Answer {
        let call = Call::TokenRevoke { id: self.0.next_id(), name: name.to_owned() };
        match self.0.call(&call, &[])?.0 {
            Reply::Done { .. } => Ok(()),
            other => Err(unexpected(&other)),
        }
    }
}

/// A subscription through a gateway, which ends when this value is dropped.
#[derive(Debug)]
pub struct Subscription {
    gateway: Gateway,
    id: u64,
    channel: String,
}

impl Subscription {
    /// Returns the bytes of the oldest sample that was not received yet.
    ///
    /// # Errors
    /// The connection is broken.
    pub fn receive(&self) -> Answer<Option<Vec<u8>>> {
        self.gateway.0.receive(self.id)
    }

    /// Returns the type, the size and the definition of the samples, once the channel exists.
    #[must_use]
    pub fn definition(&self) -> Option<(String, usize, Option<String>)> {
        self.gateway.0.definition(self.id)
    }

    /// Returns the number of samples that did not arrive.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.gateway.0.lost(self.id)
    }

    /// Waits until something arrives or CLOCK_MONOTONIC reaches `deadline_ns`.
    ///
    /// # Errors
    /// The connection is broken.
    pub fn wait_until(&self, deadline_ns: u64) -> Answer {
        self.gateway.0.wait(Some(deadline_ns))
    }

    fn typed<T: Message>(&self) -> Answer<Option<T>> {
        let Some(bytes) = self.receive()? else { return Ok(None) };
        let type_name = self.definition().map(|(type_name, ..)| type_name).unwrap_or_default();
        if type_name != T::type_name() || bytes.len() != size_of::<T>() {
            return Err(Failure::NotNow(format!(
                "the channel {} carries {type_name}, and this program knows {}; use the nims of the same installation",
                self.channel,
                T::type_name()
            )));
        }
        Ok(Some(bytemuck::pod_read_unaligned(&bytes)))
    }
}

impl Drop for Subscription {
    fn drop(&mut self) {
        self.gateway.0.unsubscribe(self.id);
    }
}

/// Receives the samples of a channel.
#[derive(Debug)]
pub enum Samples<T: Message> {
    /// From shared memory.
    Bus(Box<Subscriber<T>>),
    /// From a gateway.
    Gateway(Subscription, PhantomData<T>),
}

impl<T: Message> Samples<T> {
    /// Returns the oldest sample that was not received yet.
    ///
    /// # Errors
    /// Shared memory is damaged, or the connection is broken.
    pub fn receive(&mut self) -> Answer<Option<T>> {
        match self {
            Self::Bus(subscriber) => Ok(subscriber.receive()?),
            Self::Gateway(subscription, _) => subscription.typed(),
        }
    }

    /// Returns the newest sample that was not received yet.
    ///
    /// # Errors
    /// As [`Samples::receive`].
    pub fn latest(&mut self) -> Answer<Option<T>> {
        let mut newest = None;
        while let Some(sample) = self.receive()? {
            newest = Some(sample);
        }
        Ok(newest)
    }
}

/// Waits for samples.
#[derive(Debug)]
pub enum LinkWaiter {
    /// From shared memory.
    Bus(Box<Waiter>),
    /// From a gateway: of any subscription.
    Gateway(Gateway),
}

impl LinkWaiter {
    /// Waits until a sample arrives or CLOCK_MONOTONIC reaches `deadline_ns`.
    ///
    /// # Errors
    /// The wait failed.
    pub fn wait_until(&mut self, deadline_ns: Option<u64>) -> Answer {
        match self {
            Self::Bus(waiter) => Ok(waiter.wait_until(deadline_ns).map(|_| ())?),
            Self::Gateway(gateway) => gateway.0.wait(deadline_ns),
        }
    }
}
