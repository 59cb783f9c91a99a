//! The user at the other end of a connection.
//!
//! TCP does not state it. If the other end is on this machine, the kernel's table of connections contains that end too,
//! with its user.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

/// The tables of this network namespace. A socket of IPv6 that is connected to an address of IPv4 is in the second.
const TABLES: [&str; 2] = ["/proc/thread-self/net/tcp", "/proc/thread-self/net/tcp6"];
/// A table that changes while it is read can lack an entry.
const ATTEMPTS: usize = 2;
/// Connected: any other state of the other end is no client that may look, and of a closed one the kernel may state
/// the user 0.
const ESTABLISHED: &str = "01";

/// Address and port of one end; an address of IPv4 is one in a socket of IPv6 too.
type End = (IpAddr, u16);

/// The other end of a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Peer {
    /// A program of this user on this machine.
    Local(u32),
    /// A program on another machine.
    Remote,
    /// A program on this machine that has no open connection any more.
    Gone,
}

/// The two ends of a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Ends {
    /// The end here.
    pub(crate) own: SocketAddr,
    /// The other one.
    pub(crate) peer: SocketAddr,
}

/// Returns who is at the other end of each connection. One look at the tables serves all of them, because the kernel
/// takes milliseconds for one.
///
/// # Errors
/// The kernel's tables cannot be read.
pub(crate) fn peers_of(connections: &[Ends]) -> std::io::Result<Vec<Peer>> {
    let mut owners = BTreeMap::new();
    for _ in 0..ATTEMPTS {
        for table in TABLES {
            match std::fs::File::open(table) {
                Ok(file) => owners.extend(owners_in(BufReader::new(file), connections)?),
                // A kernel without IPv6.
                Err(error) if error.kind() == std::io::ErrorKind::NotFound && table == TABLES[1] => {}
                Err(error) => return Err(error),
            }
        }
        if (0..connections.len()).all(|at| owners.contains_key(&at)) {
            break;
        }
    }
    let other = |ends| if is_remote(ends, UdpSocket::bind) { Peer::Remote } else { Peer::Gone };
    let of = |(at, ends): (usize, &Ends)| owners.get(&at).map_or_else(|| other(*ends), |uid| Peer::Local(*uid));
    Ok(connections.iter().enumerate().map(of).collect())
}

/// Returns the user of each connection whose other end is in a table of the kernel, by its place in `connections`.
fn owners_in(table: impl BufRead, connections: &[Ends]) -> std::io::Result<BTreeMap<usize, u32>> {
    let wanted: BTreeMap<(End, End), usize> =
        connections.iter().enumerate().map(|(at, ends)| ((canonical(ends.peer), canonical(ends.own)), at)).collect();
    let mut owners = BTreeMap::new();
    for line in table.lines() {
        if let Some((local, remote, uid)) = connection(&line?)
            && let Some(at) = wanted.get(&(local, remote))
        {
            owners.insert(*at, uid);
        }
    }
    Ok(owners)
}

/// Both addresses and the user of one line, if it is a connection with a socket:
/// `sl local remote state queues timer retransmissions uid timeout inode ...`.
fn connection(line: &str) -> Option<(End, End, u32)> {
    let mut fields = line.split_ascii_whitespace().skip(1);
    let (local, remote, state) = (fields.next()?, fields.next()?, fields.next()?);
    let (uid, inode) = (fields.nth(3)?, fields.nth(1)?);
    (state == ESTABLISHED && inode != "0").then_some(())?;
    Some((address(local)?, address(remote)?, uid.parse().ok()?))
}

/// `0100007F:1F90`: words of 32 bits in the order of this processor, and the port.
fn address(text: &str) -> Option<End> {
    let (words, port) = text.split_once(':')?;
    let mut bytes = Vec::with_capacity(16);
    for at in (0..words.len()).step_by(8) {
        bytes.extend(u32::from_str_radix(words.get(at..at + 8)?, 16).ok()?.to_ne_bytes());
    }
    let ip = match bytes.len() {
        4 => IpAddr::V4(Ipv4Addr::from(<[u8; 4]>::try_from(bytes).ok()?)),
        16 => IpAddr::V6(Ipv6Addr::from(<[u8; 16]>::try_from(bytes).ok()?)),
        _ => return None,
    };
    Some((ip.to_canonical(), u16::from_str_radix(port, 16).ok()?))
}

fn canonical(address: SocketAddr) -> End {
    (address.ip().to_canonical(), address.port())
}

/// Returns whether the other end is on another machine: only an address of this machine can be bound. Any other failure
/// of `bind`, e.g. because this process has too many open files, says nothing about the address. No other machine
/// reaches a loopback address.
fn is_remote<S>(ends: Ends, bind: impl Fn(SocketAddr) -> std::io::Result<S>) -> bool {
    let is_loopback = |end: SocketAddr| end.ip().to_canonical().is_loopback();
    if is_loopback(ends.own) || is_loopback(ends.peer) {
        return false;
    }
    let mut address = ends.peer;
    address.set_port(0);
    bind(address).is_err_and(|error| error.kind() == std::io::ErrorKind::AddrNotAvailable)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::{TcpListener, TcpStream};

    const TABLE: &str =
        "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode
   0: 0100007F:223D 00000000:0000 0A 00000000:00000000 00:00000000 00000000  1000        0 4711 1 0 100 0 0 10 0
   1: 0100007F:9C40 0100007F:223D 01 00000000:00000000 00:00000000 00000000  1001        0 4712 1 0 20 4 30 10 -1
   2: 0100007F:223D 0100007F:9C40 01 00000000:00000000 00:00000000 00000000  1000        0 4713 1 0 20 4 30 10 -1
   3: 0100007F:9C41 0100007F:223D 06 00000000:00000000 03:00000A2B 00000000     0        0 0 3 0
   4: 0100007F:9C42 0100007F:223D 05 00000000:00000000 00:00000000 00000000     0        0 0 1 0 20 4 30 10 -1
   5: 0100007F:9C43 0100007F:223D 01 00000000:00000000 00:00000000 00000000     0        0 0 1 0 20 4 30 10 -1
   6: broken
";

    fn at(port: u16) -> SocketAddr {
        SocketAddr::from(([127, 0, 0, 1], port))
    }

    fn documented(last: u8) -> SocketAddr {
        SocketAddr::from(([192, 0, 2, last], 4000))
    }

    #[test]
    fn only_an_address_that_this_machine_lacks_is_one_of_another_machine() {
        let failing = |kind: std::io::ErrorKind| move |_| Err::<(), _>(std::io::Error::from(kind));
        let (own, peer) = (documented(2), documented(1));
        assert!(is_remote(Ends { own, peer }, failing(std::io::ErrorKind::AddrNotAvailable)));
        assert!(!is_remote(Ends { own, peer }, |_| Ok(())));
        let too_many_files = |_| Err::<(), _>(std::io::Error::from_raw_os_error(24));
        assert!(!is_remote(Ends { own, peer }, too_many_files));
        assert!(!is_remote(Ends { own, peer }, failing(std::io::ErrorKind::PermissionDenied)));
        for (own, peer) in [(at(8765), peer), (own, at(4000))] {
            assert!(!is_remote(Ends { own, peer }, failing(std::io::ErrorKind::AddrNotAvailable)), "{own} {peer}");
        }
    }

    /// Not connected any more in one direction: the kernel's table contains the end, and it is no user that may look.
    #[test]
    fn a_program_of_this_machine_with_a_half_closed_connection_is_not_admitted() {
        let probe = UdpSocket::bind("0.0.0.0:0").unwrap();
        let address = probe.connect(documented(1)).and_then(|()| probe.local_addr());
        let beyond_loopback = address.map(|address| address.ip()).unwrap_or(Ipv4Addr::LOCALHOST.into());
        for address in [beyond_loopback, Ipv4Addr::LOCALHOST.into()] {
            let listener = TcpListener::bind((address, 0)).unwrap();
            let client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
            let (stream, peer) = listener.accept().unwrap();
            client.shutdown(std::net::Shutdown::Write).unwrap();
            let ends = Ends { own: stream.local_addr().unwrap(), peer };
            assert_eq!(peers_of(&[ends]).unwrap(), [Peer::Gone], "{ends:?}");
        }
    }

    #[test]
    #[cfg(target_endian = "little")]
    fn only_the_other_end_of_an_open_connection_states_its_user() {
        let from = |port| Ends { own: at(0x223D), peer: at(port) };
        // Also closed ends, of which the kernel states the user 0, and one that does not exist.
        let ends = [0x9C41, 0x9C42, 0x9C43, 0x9C44, 0x9C40].map(from);
        assert_eq!(owners_in(TABLE.as_bytes(), &ends).unwrap(), BTreeMap::from([(4, 1001)]));
        let mapped = SocketAddr::from((Ipv4Addr::LOCALHOST.to_ipv6_mapped(), 0x9C40));
        let ends = [Ends { peer: mapped, ..from(0) }];
        assert_eq!(owners_in(TABLE.as_bytes(), &ends).unwrap(), BTreeMap::from([(0, 1001)]));
    }

    #[test]
    fn addresses_are_read_as_the_kernel_writes_them() {
        let word = |bytes: [u8; 4]| format!("{:08X}", u32::from_ne_bytes(bytes));
        assert_eq!(address(&format!("{}:1F90", word([127, 0, 0, 1]))), Some((Ipv4Addr::LOCALHOST.into(), 8080)));
        let (zero, one) = (word([0; 4]), word([0, 0, 0, 1]));
        assert_eq!(address(&format!("{zero}{zero}{zero}{one}:0001")), Some((Ipv6Addr::LOCALHOST.into(), 1)));
        let mapped = format!("{zero}{zero}{}{}:0001", word([0, 0, 0xff, 0xff]), word([10, 0, 0, 7]));
        assert_eq!(address(&mapped), Some((Ipv4Addr::new(10, 0, 0, 7).into(), 1)));
        assert_eq!([address("0100007F"), address("01:1"), address(""), address("zz00007F:1F90")], [None; 4]);
    }

    /// Every way to connect from this machine states the user of this test: also a socket of IPv6 to an address of
    /// IPv4, and other addresses of this machine.
    #[test]
    fn the_kernel_states_who_connects() {
        let own = rustix::process::geteuid().as_raw();
        let mut open = Vec::new();
        for (listen, connect) in [
            ("127.0.0.1", "127.0.0.1"),
            ("0.0.0.0", "127.0.0.7"),
            ("127.0.0.1", "::ffff:127.0.0.1"),
            ("::1", "::1"),
            ("::", "127.0.0.1"),
        ] {
            let Ok(listener) = TcpListener::bind((listen.parse::<IpAddr>().unwrap(), 0)) else { continue };
            let to = SocketAddr::new(connect.parse().unwrap(), listener.local_addr().unwrap().port());
            let client = TcpStream::connect(to).unwrap();
            let (stream, peer) = listener.accept().unwrap();
            open.push((client, Ends { own: stream.local_addr().unwrap(), peer }, stream));
        }
        // An address for documentation, which no machine has.
        let remote = Ends { own: documented(2), peer: documented(1) };
        let ends: Vec<Ends> = open.iter().map(|(_, ends, _)| *ends).chain([remote]).collect();
        let mut expected = vec![Peer::Local(own); open.len()];
        expected.push(Peer::Remote);
        assert_eq!(peers_of(&ends).unwrap(), expected, "{ends:?}");
        drop(open.remove(1).0);
        expected[1] = Peer::Gone;
        assert_eq!(peers_of(&ends).unwrap(), expected, "{ends:?}");
    }
}
