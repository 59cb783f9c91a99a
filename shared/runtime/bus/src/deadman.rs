//! Dead-man stops: stops that motor-io carries out by itself when their sender falls silent.
//!
//! A motion that a person holds by hand has to end when the process ends or hangs that observes the hand. Before the
//! motion begins, this process deposits with motor-io the request that ends it. It renews the deposit while the motion
//! goes on, and withdraws it afterwards. motor-io carries out a deposit that was not renewed in time.
//!
//! Like an emergency stop ([`crate::estop`]) a deposit is a datagram to a socket in the domain's folder, so it needs no
//! place and no shared memory, and only the domain's user can make one. It has a socket of its own, so that no
//! emergency stop ever waits behind it. A datagram consists of a magic number, the number of its sender, the instant at
//! which the deposit is due, and the bytes of the request. A sender has one deposit; a further one replaces it, and a
//! datagram without a request withdraws it.

use std::io;
use std::os::unix::net::UnixDatagram;
use std::path::Path;

use arrayvec::ArrayVec;
use messages::{OperatorRequest, RequestBody};

use crate::clock::now_ns;
use crate::domain::DEADMAN_SOCKET;
use crate::requester::sign_from_memory;
use crate::{BusError, Domain};

const MAGIC: [u8; 16] = *b"nims dead man 01";
/// Bytes before the request: the magic number, the sender's number, and the instant.
const HEAD: usize = MAGIC.len() + 8 + 8;
const LONGEST: usize = HEAD + size_of::<OperatorRequest>();
/// Largest number of senders. A robot has one gateway; a second one may be plugged in.
const SENDERS: usize = 4;
/// Datagrams that are read in one cycle; the queue of the socket has about ten.
const AT_ONCE: usize = 16;
/// Latest instant of a deposit after its arrival, ns: a sender that names a later one does not keep the robot moving.
const LONGEST_NS: u64 = 1_000_000_000;

/// Whether motor-io accepts a deposit of this request: one that only ever stops, and that needs no reset afterwards.
fn is_accepted(request: &OperatorRequest) -> bool {
    request.body.is_stop() && request.body.verb != RequestBody::VERB_ESTOP
}

/// Creates the socket of a receiver.
fn bind(path: &Path) -> io::Result<UnixDatagram> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    let socket = UnixDatagram::bind(path)?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

/// A deposit of a sender.
#[derive(Debug, Clone, Copy)]
struct Deposit {
    sender: u64,
    due_ns: u64,
    request: OperatorRequest,
}

/// The deposits of all senders. No clock, no I/O.
#[derive(Debug, Default)]
struct Deposits(ArrayVec<Deposit, SENDERS>);

impl Deposits {
    /// Takes a datagram. Returns a request that has to be carried out at once, because there is no room for it.
    fn take(&mut self, now_ns: u64, datagram: &[u8]) -> Option<OperatorRequest> {
        let rest = datagram.strip_prefix(&MAGIC)?;
        let (sender, rest) = rest.split_first_chunk()?;
        let (due_ns, body) = rest.split_first_chunk()?;
        let sender = u64::from_le_bytes(*sender);
        let due_ns = u64::from_le_bytes(*due_ns).min(now_ns.saturating_add(LONGEST_NS));
        if body.is_empty() {
            self.0.retain(|one| one.sender != sender);
        }
        // A request of another build is none that this one can carry out.
        if body.len() != size_of::<OperatorRequest>() {
            return None;
        }
        let request: OperatorRequest = bytemuck::pod_read_unaligned(body);
        if !is_accepted(&request) {
            return None;
        }
        self.0.retain(|one| one.sender != sender);
        self.0.try_push(Deposit { sender, due_ns, request }).is_err().then_some(request)
    }

    /// Removes a deposit that is due, and returns its request.
    fn due(&mut self, now_ns: u64) -> Option<OperatorRequest> {
        let at = self.0.iter().position(|one| now_ns >= one.due_ns)?;
        Some(self.0.swap_remove(at).request)
    }
}

/// The receiving end of dead-man stops.
#[derive(Debug)]
pub struct Receiver {
    socket: UnixDatagram,
    deposits: Deposits,
}

impl Receiver {
    /// Creates the socket and replaces that of a predecessor. Only the process that has opened the drives may call it.
    ///
    /// # Errors
    /// [`BusError::DomainFolder`] if the socket cannot be created.
    pub fn open(domain: &Domain) -> Result<Self, BusError> {
        let path = domain.root().join(DEADMAN_SOCKET);
        let socket = bind(&path).map_err(|error| BusError::DomainFolder { path: path.clone(), why: error.into() })?;
        Ok(Self { socket, deposits: Deposits::default() })
    }

    /// Reads what senders have deposited, and returns a request that is due; never waits and never allocates.
    pub fn overdue(&mut self) -> Option<OperatorRequest> {
        let mut bytes = [0_u8; LONGEST];
        for _ in 0..AT_ONCE {
            let Ok(length) = self.socket.recv(&mut bytes) else { break };
            if let Some(request) = self.deposits.take(now_ns(), &bytes[..length]) {
                return Some(request);
            }
        }
        self.deposits.due(now_ns())
    }
}

/// The sending end: the deposit of one process.
#[derive(Debug)]
pub struct Sender {
    socket: UnixDatagram,
    number: u64,
}

impl Sender {
    /// Creates a sender; its deposits replace one another.
    ///
    /// # Errors
    /// [`BusError::Failed`] if this process cannot create a socket.
    pub fn new() -> Result<Self, BusError> {
        let failed = |error: io::Error| BusError::Failed {
            channel: DEADMAN_SOCKET.to_owned(),
            what: "be sent",
            why: error.to_string(),
        };
        let socket = UnixDatagram::unbound().map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        Ok(Self { socket, number: now_ns() ^ (u64::from(std::process::id()) << 32) })
    }

    /// Deposits a request that motor-io carries out at `due_ns` unless it is renewed or withdrawn before; never waits.
    /// Returns whether motor-io can read it: otherwise none runs, or it has read nothing for many cycles.
    pub fn deposit(&self, domain: &Domain, request: &OperatorRequest, due_ns: u64) -> bool {
        let mut signed = *request;
        sign_from_memory(&mut signed);
        self.send(domain, due_ns, bytemuck::bytes_of(&signed))
    }

    /// Withdraws the deposit; never waits. Returns as [`Sender::deposit`].
    pub fn withdraw(&self, domain: &Domain) -> bool {
        self.send(domain, 0, &[])
    }

    fn send(&self, domain: &Domain, due_ns: u64, body: &[u8]) -> bool {
        let mut bytes = Vec::with_capacity(LONGEST);
        bytes.extend_from_slice(&MAGIC);
        bytes.extend_from_slice(&self.number.to_le_bytes());
        bytes.extend_from_slice(&due_ns.to_le_bytes());
        bytes.extend_from_slice(body);
        self.socket.send_to(&bytes, domain.root().join(DEADMAN_SOCKET)).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Request;

    fn datagram(sender: u64, due_ns: u64, request: Option<Request>) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(sender.to_le_bytes());
        bytes.extend(due_ns.to_le_bytes());
        if let Some(request) = request {
            bytes.extend(bytemuck::bytes_of(&request.encode().unwrap()));
        }
        bytes
    }

    fn verb(request: Option<OperatorRequest>) -> Option<u8> {
        request.map(|request| request.body.verb)
    }

    #[test]
    fn a_deposit_is_carried_out_once_unless_it_is_renewed_or_withdrawn() {
        let mut deposits = Deposits::default();
        assert!(deposits.take(0, &datagram(7, 300, Some(Request::Stop))).is_none());
        assert!(deposits.take(200, &datagram(7, 500, Some(Request::Hold))).is_none());
        assert!(deposits.due(499).is_none());
        // The renewed one has replaced the first.
        assert_eq!(verb(deposits.due(500)), Some(RequestBody::VERB_HOLD));
        assert!(deposits.due(u64::MAX).is_none());
        deposits.take(600, &datagram(7, 900, Some(Request::Stop)));
        // Another sender withdraws nothing.
        deposits.take(700, &datagram(8, 0, None));
        assert_eq!(deposits.0.len(), 1);
        deposits.take(800, &datagram(7, 0, None));
        assert!(deposits.due(u64::MAX).is_none());
    }

    #[test]
    fn a_deposit_only_brings_to_rest_and_is_due_soon() {
        let mut deposits = Deposits::default();
        for request in [Request::Arm, Request::Resume, Request::Estop, Request::Jog { cable: 1, distance_m: 0.1 }] {
            assert!(deposits.take(0, &datagram(1, 0, Some(request))).is_none());
            assert!(deposits.due(u64::MAX).is_none());
        }
        for bytes in [&b"nims"[..], &[0; LONGEST], &datagram(1, 0, Some(Request::Stop))[..LONGEST - 1]] {
            assert!(deposits.take(0, bytes).is_none());
            assert!(deposits.due(u64::MAX).is_none());
        }
        deposits.take(5, &datagram(1, u64::MAX, Some(Request::Pause)));
        assert!(deposits.due(4 + LONGEST_NS).is_none());
        assert_eq!(verb(deposits.due(5 + LONGEST_NS)), Some(RequestBody::VERB_PAUSE));
    }

    #[test]
    fn a_deposit_without_room_stops_at_once() {
        let mut deposits = Deposits::default();
        for sender in 0..SENDERS as u64 {
            assert!(deposits.take(0, &datagram(sender, 900, Some(Request::Hold))).is_none());
        }
        assert_eq!(verb(deposits.take(0, &datagram(99, 900, Some(Request::Stop)))), Some(RequestBody::VERB_STOP));
        assert_eq!(std::iter::from_fn(|| deposits.due(900)).count(), SENDERS);
    }

    #[test]
    fn it_travels_through_the_domain_and_is_due_when_its_sender_is_silent() {
        let domain = Domain::for_test();
        let sender = Sender::new().unwrap();
        let stop = Request::Stop.encode().unwrap();
        assert!(!sender.deposit(&domain, &stop, 0), "no motor-io runs");
        let mut receiver = Receiver::open(&domain).unwrap();
        assert!(sender.deposit(&domain, &stop, now_ns() + LONGEST_NS));
        assert!(sender.withdraw(&domain));
        assert!(receiver.overdue().is_none() && receiver.deposits.0.is_empty());
        // A killed sender renews nothing.
        assert!(sender.deposit(&domain, &stop, now_ns()));
        drop(sender);
        let due = receiver.overdue().unwrap();
        assert!(due.body == stop.body && due.pid == std::process::id() && due.id != 0);
    }
}
