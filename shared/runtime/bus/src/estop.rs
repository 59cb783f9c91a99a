//! Emergency stops without shared memory.
//!
//! A request needs a node, places on a service and an event, and shared memory; if one of these is exhausted, it cannot
//! be sent. So an emergency stop uses none of them: it is a datagram to a socket in the domain's folder, which motor-io
//! reads at the start of each cycle without waiting. Only its user can access the folder and the socket. The answer is
//! a datagram too.
//!
//! A datagram consists of a magic number, a number that the answer repeats, and the bytes of the request. The request
//! is for the log only: a request of another build, or none, stops the robot too.

use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::Duration;

use arrayvec::ArrayVec;
use messages::{OperatorRequest, Request, RequestAnswer, put_sentence};

use crate::clock::{now_ns, sleep_until};
use crate::domain::ESTOP_SOCKET;
use crate::requester::sign_from_memory;
use crate::{BusError, Domain};

const MAGIC: [u8; 16] = *b"nims emergency 1";
const NUMBER: std::ops::Range<usize> = 16..24;
const BODY: usize = 24;
/// Size of a datagram with a request, bytes.
const LONGEST: usize = BODY + size_of::<OperatorRequest>();
/// Size of the longest answer, bytes: `accepted` and a sentence.
const ANSWER: usize = BODY + 1 + 512;
/// Largest number of stops that are answered in one cycle; further ones are answered in the next cycle.
pub const AT_ONCE: usize = 8;
/// Time between two polls for the answer, and between attempts while the receiver's queue of about ten is full, ns.
const POLL_NS: u64 = 1_000_000;
/// Time after which a stop is sent again, ns: motor-io may just be starting.
const AGAIN_NS: u64 = 100_000_000;

/// The receiving socket of emergency stops.
#[derive(Debug)]
pub struct Receiver {
    socket: UnixDatagram,
}

/// An emergency stop that has arrived.
#[derive(Debug)]
pub struct Stop {
    /// The sender's request; always a [`messages::Request::Estop`].
    pub request: OperatorRequest,
    number: [u8; 8],
    from: Option<SocketAddr>,
}

impl Receiver {
    /// Creates the socket and replaces that of a predecessor. Only the process that has opened the drives may call it.
    ///
    /// # Errors
    /// [`BusError::DomainFolder`] if the socket cannot be created.
    pub fn open(domain: &Domain) -> Result<Self, BusError> {
        let path = domain.root().join(ESTOP_SOCKET);
        let unusable = |error: io::Error| BusError::DomainFolder { path: path.clone(), why: error.into() };
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(unusable(error)),
            _ => {}
        }
        let socket = UnixDatagram::bind(&path).map_err(unusable)?;
        socket.set_nonblocking(true).map_err(unusable)?;
        Ok(Self { socket })
    }

    /// Receives up to [`AT_ONCE`] stops; never waits and never allocates.
    pub fn take(&mut self) -> ArrayVec<Stop, AT_ONCE> {
        let mut stops = ArrayVec::new();
        let mut bytes = [0_u8; LONGEST];
        // Skip other datagrams, but only a bounded number of them.
        for _ in 0..2 * AT_ONCE {
            if stops.is_full() {
                break;
            }
            let Ok((length, from)) = self.socket.recv_from(&mut bytes) else { break };
            let Some((magic, rest)) = bytes[..length].split_at_checked(MAGIC.len()) else { continue };
            if magic != MAGIC {
                continue;
            }
            let mut number = [0; 8];
            let given = rest.len().min(number.len());
            number[..given].copy_from_slice(&rest[..given]);
            let mut request = match bytes.get(BODY..length) {
                Some(body) if body.len() == size_of::<OperatorRequest>() => bytemuck::pod_read_unaligned(body),
                _ => OperatorRequest::default(),
            };
            request.body = Request::Estop.body();
            if request.id == 0 {
                request.id = u64::from_ne_bytes(number).max(1);
            }
            stops.push(Stop { request, number, from: Some(from) });
        }
        stops
    }

    /// Sends the answer, without the parameters of its reason. It is no error if the sender has ended.
    pub fn answer(&self, stop: &Stop, answer: &RequestAnswer) {
        let Some(to) = &stop.from else { return };
        let mut bytes = [0_u8; ANSWER];
        bytes[..MAGIC.len()].copy_from_slice(&MAGIC);
        bytes[NUMBER].copy_from_slice(&stop.number);
        bytes[BODY] = answer.accepted;
        let length = answer.text.iter().position(|byte| *byte == 0).unwrap_or(answer.text.len());
        bytes[BODY + 1..][..length].copy_from_slice(&answer.text[..length]);
        let _ = self.socket.send_to_addr(&bytes[..BODY + 1 + length], to);
    }
}

/// Returns whether a motor-io has created its socket in this domain; it may have been killed since.
#[must_use]
pub fn is_heard(domain: &Domain) -> bool {
    domain.root().join(ESTOP_SOCKET).exists()
}

/// Sends an emergency stop and waits for its answer: the request with `answered`, `accepted` and `answer` filled in.
/// Repeats the stop until then, and calls `uneasy` once if there is no answer after `patience`. A stop remains in the
/// queue of a suspended motor-io even if this process ends.
///
/// # Errors
/// [`BusError::NoServer`] if no process has the socket open, [`BusError::NoAnswer`] after `timeout`,
/// [`BusError::Failed`] if this process cannot create a socket.
pub fn send(
    domain: &Domain,
    request: &OperatorRequest,
    timeout: Duration,
    patience: Duration,
    uneasy: impl FnOnce(),
) -> Result<OperatorRequest, BusError> {
    let failed = |error: io::Error| BusError::Failed {
        channel: ESTOP_SOCKET.to_owned(),
        what: "be sent",
        why: error.to_string(),
    };
    let absent = || BusError::NoServer { process: "motor-io".to_owned(), domain: domain.name().to_owned() };
    let mut sent = *request;
    sign_from_memory(&mut sent);
    let begun = sent.header.stamp_ns;
    // An abstract name needs no space in a file system.
    let own = SocketAddr::from_abstract_name(format!("nims-estop-{}-{:x}", sent.pid, sent.id)).map_err(failed)?;
    let socket = UnixDatagram::bind_addr(&own).map_err(failed)?;
    socket.set_nonblocking(true).map_err(failed)?;
    let mut datagram = Vec::with_capacity(LONGEST);
    datagram.extend_from_slice(&MAGIC);
    // Another user cannot guess this number, so it cannot forge an answer of motor-io.
    let number = secret().unwrap_or(sent.id.to_ne_bytes());
    datagram.extend_from_slice(&number);
    datagram.extend_from_slice(bytemuck::bytes_of(&sent));

    let path = domain.root().join(ESTOP_SOCKET);
    let after = |time: Duration| begun + time.as_nanos().min(u128::from(u64::MAX / 4)) as u64;
    let (deadline, uneasy_at, mut again_ns) = (after(timeout), after(patience), 0);
    let (mut uneasy, mut got_through) = (Some(uneasy), false);
    let mut bytes = [0_u8; ANSWER];
    loop {
        let now = now_ns();
        if now >= again_ns {
            match socket.send_to(&datagram, &path) {
                Ok(_) => (got_through, again_ns) = (true, now + AGAIN_NS),
                // The queue is full of other stops; try again, because this one needs an answer too.
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(_) if got_through => again_ns = now + AGAIN_NS,
                Err(_) => return Err(absent()),
            }
        }
        while let Ok(length) = socket.recv(&mut bytes) {
            if length > BODY && bytes[..MAGIC.len()] == MAGIC && bytes[NUMBER] == number {
                let mut answer = sent;
                (answer.answered, answer.accepted) = (1, bytes[BODY]);
                put_sentence(&mut answer.answer, &String::from_utf8_lossy(&bytes[BODY + 1..length]));
                return Ok(answer);
            }
        }
        if now >= deadline {
            let why = "is busy or has died";
            return Err(BusError::NoAnswer { process: "motor-io".to_owned(), seconds: timeout.as_secs_f64(), why });
        }
        if now >= uneasy_at
            && let Some(say) = uneasy.take()
        {
            say();
        }
        sleep_until(now + POLL_NS);
    }
}

fn secret() -> Option<[u8; 8]> {
    use std::io::Read;
    let mut bytes = [0; 8];
    std::fs::File::open("/dev/urandom").and_then(|mut file| file.read_exact(&mut bytes)).ok()?;
    Some(bytes)
}
