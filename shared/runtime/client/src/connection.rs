//! A connection to a gateway: calls and their replies, and the samples of subscriptions in between.

use bus::clock;
use command::{Answer, Failure};
use gateway_protocol::{Call, Decoder, Frame, Origin, REPLY_LIMITS, Reply, VERSION};
use messages::RequestAnswer;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use rustix::net::sockopt::socket_peercred;
use rustix::net::{RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, recvmsg};
use rustix::time::Timespec;
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, VecDeque};
use std::io::{IoSliceMut, Write};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};

/// Environment variable with the secret of a token, for a program that acts for its holder.
pub const TOKEN_VARIABLE: &str = "NIMS_TOKEN";
/// Longest wait for a reply, ns: the gateway itself waits 10 s for the answer of a process.
const REPLY_NS: u64 = 15 * clock::SECOND_NS;
/// Bytes that are read at once.
const PIECE: usize = 256 << 10;
/// Largest number of samples of a subscription that wait to be received, as a shallow subscriber of the bus has.
const WAITING: usize = messages::Quality::SHALLOW;

/// A subscription: what has arrived and was not received yet.
#[derive(Debug, Default)]
struct Queue {
    definition: Option<(String, usize, Option<String>)>,
    samples: VecDeque<Vec<u8>>,
    /// Samples that were left out on the way, or here because they were not received in time.
    lost: u64,
    dropped: u64,
    missed: u64,
}

/// A connection to a gateway.
#[derive(Debug)]
pub(crate) struct Connection {
    path: PathBuf,
    stream: UnixStream,
    decoder: RefCell<Decoder>,
    queues: RefCell<BTreeMap<u64, Queue>>,
    /// The reply to the call under way.
    reply: RefCell<Option<(Reply, Vec<u8>)>>,
    descriptors: RefCell<VecDeque<OwnedFd>>,
    last_id: Cell<u64>,
    /// Number of samples and definitions so far, by which a wait ends.
    arrived: Cell<u64>,
    robot: String,
    /// The files of the robot's configuration, while this connection exists: a system file names others.
    folder: RefCell<Option<tempfile::TempDir>>,
}

impl Connection {
    /// Connects to a gateway.
    ///
    /// # Errors
    /// No gateway listens there, it is closed to this user, or it refuses the connection.
    pub(crate) fn open(path: &Path) -> Answer<Self> {
        let stream = connect(path)?;
        let mut connection = Self {
            path: path.to_owned(),
            stream,
            decoder: RefCell::new(Decoder::new(REPLY_LIMITS)),
            queues: RefCell::default(),
            reply: RefCell::default(),
            descriptors: RefCell::default(),
            last_id: Cell::new(0),
            arrived: Cell::new(0),
            robot: String::new(),
            folder: RefCell::default(),
        };
        let token = std::env::var(TOKEN_VARIABLE).ok().filter(|token| !token.is_empty());
        let hello = Call::Hello { version: VERSION, origin: Origin::Command, token, from: None };
        match connection.exchange(&hello, &[])?.0 {
            Reply::Welcome { robot, .. } => connection.robot = robot,
            other => return Err(unexpected(&other)),
        }
        Ok(connection)
    }

    /// Name of the gateway's robot.
    pub(crate) fn robot(&self) -> &str {
        &self.robot
    }

    /// Keeps the files of the robot's configuration until this connection ends.
    pub(crate) fn keep(&self, folder: tempfile::TempDir) {
        *self.folder.borrow_mut() = Some(folder);
    }

    /// The folder with the files of the robot's configuration, if they were asked for.
    pub(crate) fn kept(&self) -> Option<PathBuf> {
        self.folder.borrow().as_ref().map(|folder| folder.path().to_owned())
    }

    /// A number for the next call.
    pub(crate) fn next_id(&self) -> u64 {
        self.last_id.set(self.last_id.get() + 1);
        self.last_id.get()
    }

    /// Sends a call and waits for its reply.
    ///
    /// # Errors
    /// The connection is broken, or the gateway does not reply.
    pub(crate) fn exchange(&self, call: &Call, body: &[u8]) -> Answer<(Reply, Vec<u8>)> {
        self.exchange_with(call, body, REPLY_NS, || {})
    }

    /// As [`Connection::exchange`]; calls `uneasy` once if there is no reply after `patience_ns`.
    ///
    /// # Errors
    /// As that.
    pub(crate) fn exchange_with(
        &self,
        call: &Call,
        body: &[u8],
        patience_ns: u64,
        uneasy: impl FnOnce(),
    ) -> Answer<(Reply, Vec<u8>)> {
        self.send(call, body)?;
        let now = clock::now_ns();
        let (give_up, uneasy_ns, mut uneasy) = (now + REPLY_NS, now + patience_ns, Some(uneasy));
        loop {
            let matching = |(reply, _): &(Reply, Vec<u8>)| reply.id() == call.id() || reply.id() == 0;
            if let Some(reply) = self.reply.borrow_mut().take().filter(matching) {
                return Ok(reply);
            }
            if clock::now_ns() >= give_up {
                let seconds = REPLY_NS / clock::SECOND_NS;
                return Err(self.broken(&format!("it has not replied for {seconds} s")));
            }
            if clock::now_ns() >= uneasy_ns
                && let Some(say) = uneasy.take()
            {
                say();
            }
            self.pump(Some(if uneasy.is_some() { give_up.min(uneasy_ns) } else { give_up }))?;
        }
    }

    /// As [`Connection::exchange`], for a call whose refusal is a failure.
    ///
    /// # Errors
    /// As that, or refused.
    pub(crate) fn call(&self, call: &Call, body: &[u8]) -> Answer<(Reply, Vec<u8>)> {
        let (reply, body) = self.exchange(call, body)?;
        match reply.request_answer() {
            Some(answer) => Err(failure_of(&answer)),
            None => Ok((reply, body)),
        }
    }

    fn send(&self, call: &Call, body: &[u8]) -> Answer {
        let header = call.header().map_err(Failure::BadInput)?;
        let bytes = gateway_protocol::encode(&header, body);
        (&self.stream).write_all(&bytes).map_err(|error| self.broken(&error.to_string()))
    }

    /// The descriptor that came with the last reply.
    pub(crate) fn descriptor(&self) -> Option<OwnedFd> {
        self.descriptors.borrow_mut().pop_front()
    }

    /// Subscribes to a channel; returns the number of the subscription.
    ///
    /// # Errors
    /// Refused.
    pub(crate) fn subscribe(&self, channel: &str) -> Answer<u64> {
        let id = self.next_id();
        self.queues.borrow_mut().insert(id, Queue::default());
        self.call(&Call::Subscribe { id, channel: channel.to_owned(), rate_hz: None }, &[])?;
        Ok(id)
    }

    /// Ends a subscription, without waiting.
    pub(crate) fn unsubscribe(&self, subscription: u64) {
        self.queues.borrow_mut().remove(&subscription);
        // Its reply belongs to no call under way, and is left out.
        let _ = self.send(&Call::Unsubscribe { id: self.next_id(), subscription }, &[]);
    }

    /// Returns the oldest sample of a subscription that was not received yet.
    ///
    /// # Errors
    /// The connection is broken.
    pub(crate) fn receive(&self, subscription: u64) -> Answer<Option<Vec<u8>>> {
        self.pump(None)?;
        let mut queues = self.queues.borrow_mut();
        Ok(queues.get_mut(&subscription).and_then(|queue| queue.samples.pop_front()))
    }

    /// Returns the type, the size and the definition of a subscription's samples, once they are known.
    pub(crate) fn definition(&self, subscription: u64) -> Option<(String, usize, Option<String>)> {
        self.queues.borrow().get(&subscription).and_then(|queue| queue.definition.clone())
    }

    /// Returns the number of samples of a subscription that did not arrive.
    pub(crate) fn lost(&self, subscription: u64) -> u64 {
        self.queues.borrow().get(&subscription).map_or(0, |queue| queue.lost)
    }

    /// Waits until a sample arrives or the deadline is reached.
    ///
    /// # Errors
    /// The connection is broken.
    pub(crate) fn wait(&self, deadline_ns: Option<u64>) -> Answer {
        let before = self.arrived.get();
        loop {
            self.pump(Some(deadline_ns.unwrap_or(u64::MAX)))?;
            if self.arrived.get() != before || deadline_ns.is_some_and(|deadline_ns| clock::now_ns() >= deadline_ns) {
                return Ok(());
            }
        }
    }

    /// Reads what has arrived; waits for it until the deadline, if there is one.
    fn pump(&self, deadline_ns: Option<u64>) -> Answer {
        let rest =
            deadline_ns.map_or(0, |deadline_ns| deadline_ns.saturating_sub(clock::now_ns())).min(clock::SECOND_NS);
        let timeout = Timespec { tv_sec: (rest / clock::SECOND_NS) as i64, tv_nsec: (rest % clock::SECOND_NS) as i64 };
        let mut entries = [PollFd::new(&self.stream, PollFlags::IN)];
        match poll(&mut entries, Some(&timeout)) {
            Ok(0) | Err(Errno::INTR) => return Ok(()),
            Ok(_) => {}
            Err(error) => return Err(self.broken(&error.to_string())),
        }
        let mut bytes = vec![0; PIECE];
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(4))];
        let mut attached = RecvAncillaryBuffer::new(&mut space);
        let read = recvmsg(
            &self.stream,
            &mut [IoSliceMut::new(&mut bytes)],
            &mut attached,
            RecvFlags::DONTWAIT | RecvFlags::CMSG_CLOEXEC,
        );
        let length = match read {
            Ok(message) if message.bytes == 0 => return Err(self.broken("it has closed the connection")),
            Ok(message) => message.bytes,
            Err(Errno::AGAIN | Errno::INTR) => return Ok(()),
            Err(error) => return Err(self.broken(&error.to_string())),
        };
        for message in attached.drain() {
            if let RecvAncillaryMessage::ScmRights(descriptors) = message {
                self.descriptors.borrow_mut().extend(descriptors);
            }
        }
        self.decoder.borrow_mut().push(&bytes[..length]);
        loop {
            let frame = self.decoder.borrow_mut().next_frame();
            match frame.map_err(|error| self.broken(&error.to_string()))? {
                Some(frame) => self.sort(frame)?,
                None => return Ok(()),
            }
        }
    }

    fn sort(&self, frame: Frame) -> Answer {
        let reply = Reply::read(&frame.header).map_err(|why| self.broken(&why))?;
        match reply {
            Reply::Definition { id, type_name, size_bytes, schema } => {
                if let Some(queue) = self.queues.borrow_mut().get_mut(&id) {
                    queue.definition = Some((type_name, size_bytes, schema));
                    self.arrived.set(self.arrived.get() + 1);
                }
            }
            Reply::Sample { id, dropped, missed } => {
                if let Some(queue) = self.queues.borrow_mut().get_mut(&id) {
                    queue.lost += dropped.saturating_sub(queue.dropped) + missed.saturating_sub(queue.missed);
                    (queue.dropped, queue.missed) = (dropped, missed);
                    if queue.samples.len() >= WAITING {
                        queue.samples.pop_front();
                        queue.lost += 1;
                    }
                    queue.samples.push_back(frame.body);
                    self.arrived.set(self.arrived.get() + 1);
                }
            }
            other => *self.reply.borrow_mut() = Some((other, frame.body)),
        }
        Ok(())
    }

    fn broken(&self, why: &str) -> Failure {
        Failure::NotNow(format!("the gateway {} cannot be used: {why}; try again", self.path.display()))
    }
}

/// The failure of a refused call.
pub(crate) fn failure_of(answer: &RequestAnswer) -> Failure {
    let sentence = messages::text_of(&answer.text);
    match answer.accepted {
        messages::OperatorRequest::BAD_INPUT => Failure::BadInput(sentence),
        _ => Failure::NotNow(sentence),
    }
}

/// The failure for a reply of another kind.
pub(crate) fn unexpected(reply: &Reply) -> Failure {
    match reply.request_answer() {
        Some(answer) => failure_of(&answer),
        None => {
            Failure::NotNow("the gateway's reply is of another kind; use the nims of the same installation".to_owned())
        }
    }
}

fn connect(path: &Path) -> Answer<UnixStream> {
    let stream = UnixStream::connect(path).map_err(|error| not_connected(path, &error))?;
    trusted(path, &stream)?;
    Ok(stream)
}

/// Checks that a connection leads to a gateway that may be trusted. It gets missions and secrets, so it has to be
/// root's, this user's, or that of the user whose folder its socket is in: another user may have created a socket in a
/// folder that all users may write to.
///
/// # Errors
/// Another user runs it.
pub fn trusted(path: &Path, stream: &impl AsFd) -> Answer {
    let unknown = |why: String| {
        Failure::NotNow(format!("the user of the gateway {} cannot be found out: {why}; try again", path.display()))
    };
    let peer = socket_peercred(stream).map_err(|error| unknown(error.to_string()))?.uid.as_raw();
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or_else(|| Path::new("."));
    let owner = std::fs::metadata(folder).map_err(|error| unknown(error.to_string()))?.uid();
    if [0, rustix::process::geteuid().as_raw(), owner].contains(&peer) {
        return Ok(());
    }
    Err(Failure::NotNow(format!(
        "the gateway {} is run by the user {peer}, who is not the owner of its folder; name another one with --gateway",
        path.display()
    )))
}

/// The failure where the socket of a gateway cannot be connected to.
#[must_use]
pub fn not_connected(path: &Path, error: &std::io::Error) -> Failure {
    let path = path.display();
    Failure::NotNow(match error.kind() {
        std::io::ErrorKind::PermissionDenied => format!(
            "the gateway {path} is closed to this user; become a member of its group (sudo usermod -aG nims-operators USER) and log in again, see docs/access.md"
        ),
        std::io::ErrorKind::NotFound => {
            format!("there is no gateway {path}; start it with its service, see docs/access.md")
        }
        _ => format!("the gateway {path} does not answer ({error}); start it again with its service"),
    })
}
