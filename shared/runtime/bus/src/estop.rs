//! Emergency stops without shared memory.
//!
//! A request needs a node, places on a service and an event, and shared memory; if one of these is exhausted, it cannot
//! be sent. So an emergency stop uses none of them: it is a datagram to a socket in the domain's folder, which motor-io
//! reads at the start of each cycle without waiting. Only its user can access the folder and the socket. The answer is
//! a datagram too.
//!
//! A datagram consists of a magic number, a number that the answer repeats, and the bytes of the request. The request
//! is for the log only: a request of another build, or none, stops the robot too. The answer has a magic number of its
//! own, the same number, whether the stop was accepted, and the number of the reason with its parameters; its reader
//! makes the sentence.

use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::path::PathBuf;
use std::time::Duration;

use arrayvec::ArrayVec;
use messages::{DETAIL_BYTES, OperatorRequest, Request, RequestAnswer};

use crate::clock::{now_ns, sleep_until};
use crate::domain::ESTOP_SOCKET;
use crate::requester::sign_from_memory;
use crate::{BusError, Domain};

const MAGIC: [u8; 16] = *b"nims emergency 1";
/// Of an answer. Another one than that of a stop, so that a change of the answer never makes a stop unknown.
const ANSWER_MAGIC: [u8; 16] = *b"nims emergency 2";
const BODY: usize = 24;
/// Size of a datagram with a request, bytes.
const LONGEST: usize = BODY + size_of::<OperatorRequest>();
/// Size of an answer, bytes: `accepted`, the reason, its numbers, its values and its texts.
const ANSWER: usize = BODY + 1 + 2 + 6 * 8 + 6 * 8 + DETAIL_BYTES;
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
    pub fn receive(&mut self) -> ArrayVec<Stop, AT_ONCE> {
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

    /// Sends the answer, without its sentence. It is no error if the sender has ended.
    pub fn answer(&self, stop: &Stop, answer: &RequestAnswer) {
        let Some(to) = &stop.from else { return };
        let _ = self.socket.send_to_addr(&datagram_of(&stop.number, answer), to);
    }
}

/// Returns the datagram of an answer; nothing is allocated.
fn datagram_of(number: &[u8; 8], answer: &RequestAnswer) -> ArrayVec<u8, ANSWER> {
    let mut bytes = ArrayVec::new();
    bytes.extend(ANSWER_MAGIC);
    bytes.extend(*number);
    bytes.push(answer.accepted);
    bytes.extend(answer.reason.to_le_bytes());
    bytes.extend(answer.number.iter().flat_map(|number| number.to_le_bytes()));
    bytes.extend(answer.value.iter().flat_map(|value| value.to_le_bytes()));
    bytes.extend(answer.detail);
    bytes
}

/// Returns the answer in a datagram, if it is one to the stop of that number.
fn answer_in(bytes: &[u8], number: &[u8; 8]) -> Option<RequestAnswer> {
    let rest = bytes.strip_prefix(&ANSWER_MAGIC)?.strip_prefix(number)?;
    let (accepted, rest) = rest.split_first()?;
    let (reason, rest) = rest.split_first_chunk()?;
    let (numbers, rest) = rest.split_at_checked(6 * 8)?;
    let (values, rest) = rest.split_at_checked(6 * 8)?;
    let mut answer = RequestAnswer {
        accepted: *accepted,
        reason: u16::from_le_bytes(*reason),
        detail: *rest.first_chunk()?,
        ..RequestAnswer::default()
    };
    let of = |bytes: &[u8], i: usize| bytes[8 * i..].first_chunk().copied().unwrap_or_default();
    answer.number = std::array::from_fn(|i| u64::from_le_bytes(of(numbers, i)));
    answer.value = std::array::from_fn(|i| f64::from_le_bytes(of(values, i)));
    Some(answer)
}

/// Returns whether a motor-io has created its socket in this domain; it may have been killed since.
#[must_use]
pub fn is_heard(domain: &Domain) -> bool {
    domain.root().join(ESTOP_SOCKET).exists()
}

/// Sends an emergency stop and waits for its answer: the request with its answer, but without the sentence.
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
    let mut attempt = Attempt::begin(domain, request, timeout)?;
    let uneasy_at = attempt.after(patience);
    let mut uneasy = Some(uneasy);
    loop {
        if let Some(answer) = attempt.poll()? {
            return Ok(answer);
        }
        let now = now_ns();
        if now >= uneasy_at
            && let Some(say) = uneasy.take()
        {
            say();
        }
        sleep_until(now + POLL_NS);
    }
}

/// An emergency stop that is being sent, for a program that must not wait: [`Attempt::poll`] repeats it and returns its
/// answer.
#[derive(Debug)]
pub struct Attempt {
    socket: UnixDatagram,
    path: PathBuf,
    domain: String,
    sent: OperatorRequest,
    datagram: Vec<u8>,
    number: [u8; 8],
    timeout: Duration,
    again_ns: u64,
    got_through: bool,
}

impl Attempt {
    /// Creates the socket of an attempt; the first [`Attempt::poll`] sends the stop.
    ///
    /// # Errors
    /// [`BusError::Failed`] if this process cannot create a socket.
    pub fn begin(domain: &Domain, request: &OperatorRequest, timeout: Duration) -> Result<Self, BusError> {
        let failed = |error: io::Error| BusError::Failed {
            channel: ESTOP_SOCKET.to_owned(),
            what: "be sent",
            why: error.to_string(),
        };
        let mut sent = *request;
        sign_from_memory(&mut sent);
        // An abstract name needs no space in a file system.
        let name = format!("nims-estop-{}-{:x}", std::process::id(), sent.id);
        let own = SocketAddr::from_abstract_name(name).map_err(failed)?;
        let socket = UnixDatagram::bind_addr(&own).map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        let mut datagram = Vec::with_capacity(LONGEST);
        datagram.extend_from_slice(&MAGIC);
        // Another user cannot guess this number, so it cannot forge an answer of motor-io.
        let number = secret().unwrap_or(sent.id.to_ne_bytes());
        datagram.extend_from_slice(&number);
        datagram.extend_from_slice(bytemuck::bytes_of(&sent));
        let (path, domain) = (domain.root().join(ESTOP_SOCKET), domain.name().to_owned());
        Ok(Self { socket, path, domain, sent, datagram, number, timeout, again_ns: 0, got_through: false })
    }

    fn after(&self, time: Duration) -> u64 {
        self.sent.header.stamp_ns + time.as_nanos().min(u128::from(u64::MAX / 4)) as u64
    }

    /// Sends the stop where that is due, and returns the answer if it has arrived; never waits.
    ///
    /// # Errors
    /// As [`send`].
    pub fn poll(&mut self) -> Result<Option<OperatorRequest>, BusError> {
        let now = now_ns();
        if now >= self.again_ns {
            match self.socket.send_to(&self.datagram, &self.path) {
                Ok(_) => (self.got_through, self.again_ns) = (true, now + AGAIN_NS),
                // The queue is full of other stops; try again, because this one needs an answer too.
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(_) if self.got_through => self.again_ns = now + AGAIN_NS,
                Err(_) => {
                    let (process, domain) = ("motor-io".to_owned(), self.domain.clone());
                    return Err(BusError::NoServer { process, domain });
                }
            }
        }
        let mut bytes = [0_u8; ANSWER];
        while let Ok(length) = self.socket.recv(&mut bytes) {
            if let Some(answer) = answer_in(&bytes[..length], &self.number) {
                let mut answered = self.sent;
                answered.put_answer(&answer);
                return Ok(Some(answered));
            }
        }
        if now >= self.after(self.timeout) {
            let why = "is busy or has died";
            let seconds = self.timeout.as_secs_f64();
            return Err(BusError::NoAnswer { process: "motor-io".to_owned(), seconds, why });
        }
        Ok(None)
    }
}

fn secret() -> Option<[u8; 8]> {
    use std::io::Read;
    let mut bytes = [0; 8];
    std::fs::File::open("/dev/urandom").and_then(|mut file| file.read_exact(&mut bytes)).ok()?;
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_travels_with_its_parameters_and_only_to_its_stop() {
        let mut answer = RequestAnswer { accepted: 1, reason: 0x1234, ..RequestAnswer::default() };
        answer.number = [1, u64::MAX, 3, 4, 5, 6];
        answer.value = [0.25, -1.0, f64::NAN, f64::INFINITY, 1e-300, 6.0];
        answer.detail = std::array::from_fn(|i| i as u8);
        let bytes = datagram_of(&[7; 8], &answer);
        assert_eq!(bytes.len(), ANSWER);
        assert_eq!(answer_in(&bytes, &[7; 8]), Some(answer));
        assert_eq!(answer_in(&bytes, &[8; 8]), None);
        for length in 0..bytes.len() {
            assert_eq!(answer_in(&bytes[..length], &[7; 8]), None, "{length}");
        }
    }
}
