//! The browser that `start` opens. Its code stands in no command line, which every user of the machine can read: it is
//! told to the first program of this user that asks for it, and the kernel tells whose a connection is.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::{Mutex, PoisonError};

/// The path that is opened.
pub(crate) const PATH: &str = "/here";
/// The kernel's tables of the TCP sockets of this machine.
const TABLES: [&str; 2] = ["/proc/net/tcp", "/proc/net/tcp6"];

/// The two ends of a connection.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ends {
    pub(crate) browser: SocketAddr,
    pub(crate) page: SocketAddr,
}

/// The code for the browser that is opened.
#[derive(Debug, Default)]
pub(crate) struct Here(Mutex<Option<String>>);

impl Here {
    pub(crate) fn put(&self, code: String) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(code);
    }

    /// Takes the code, once, for a program of this user.
    pub(crate) fn take(&self, ends: Ends) -> Option<String> {
        let mut code = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        code.take_if(|_| user_of(ends) == Some(rustix::process::geteuid().as_raw()))
    }
}

/// The user of the program at the browser's end; `None` if that is not on this machine.
fn user_of(ends: Ends) -> Option<u32> {
    let wanted = [ends.browser, ends.page].map(canonical);
    let tables = TABLES.iter().filter_map(|path| std::fs::read_to_string(path).ok());
    tables
        .flat_map(|table| table.lines().filter_map(row).collect::<Vec<_>>())
        .find(|row| row.0 == wanted)
        .map(|row| row.1)
}

/// The ends of a socket, its own first, and its user.
fn row(line: &str) -> Option<([SocketAddr; 2], u32)> {
    let mut fields = line.split_whitespace().skip(1);
    let (own, other) = (address(fields.next()?)?, address(fields.next()?)?);
    // State, queues, timer and retransmissions come before it.
    Some(([own, other], fields.nth(4)?.parse().ok()?))
}

/// An address as the kernel prints it: words of its bytes in the order of the machine, and the port.
fn address(text: &str) -> Option<SocketAddr> {
    let (ip, port) = text.split_once(':')?;
    let word = |at: usize| Some(u32::from_str_radix(ip.get(at..at + 8)?, 16).ok()?.to_ne_bytes());
    let ip = match ip.len() {
        8 => IpAddr::from(Ipv4Addr::from(word(0)?)),
        32 => {
            let mut bytes = [0; 16];
            for (at, part) in bytes.chunks_exact_mut(4).enumerate() {
                part.copy_from_slice(&word(8 * at)?);
            }
            IpAddr::from(Ipv6Addr::from(bytes))
        }
        _ => return None,
    };
    Some(canonical(SocketAddr::new(ip, u16::from_str_radix(port, 16).ok()?)))
}

fn canonical(address: SocketAddr) -> SocketAddr {
    SocketAddr::new(address.ip().to_canonical(), address.port())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::{TcpListener, TcpStream};

    #[test]
    fn the_code_is_told_once_to_a_program_of_this_user() {
        for listens in ["127.0.0.1:0", "[::1]:0", "[::]:0"] {
            // Where the machine has no IPv6 there is none to try.
            let Ok(listener) = TcpListener::bind(listens) else { continue };
            let port = listener.local_addr().unwrap().port();
            let to = if listens.starts_with("[::1]") { format!("[::1]:{port}") } else { format!("127.0.0.1:{port}") };
            let browser = TcpStream::connect(to).unwrap();
            let (page, from) = listener.accept().unwrap();
            let ends = Ends { browser: from, page: page.local_addr().unwrap() };
            assert_eq!(user_of(ends), Some(rustix::process::geteuid().as_raw()), "{listens}");
            let here = Here::default();
            assert_eq!(here.take(ends), None);
            here.put("0128-7ZGZ".to_owned());
            // A connection that no program of this machine has.
            let stranger = Ends { browser: "10.255.255.1:9".parse().unwrap(), ..ends };
            assert_eq!((user_of(stranger), here.take(stranger)), (None, None));
            assert_eq!((here.take(ends), here.take(ends)), (Some("0128-7ZGZ".to_owned()), None));
            drop(browser);
        }
    }

    #[test]
    fn the_table_of_the_kernel_is_read() {
        let line = "   0: 0100007F:A0C4 0100007F:223E 01 00000000:00000000 00:00000000 00000000  1000        0 12345 1";
        let ends = ["127.0.0.1:41156", "127.0.0.1:8766"].map(|text| text.parse().unwrap());
        assert_eq!(row(line), cfg!(target_endian = "little").then_some((ends, 1000)));
        let mapped = "0000000000000000FFFF00000100007F:223E";
        assert_eq!(address(mapped), cfg!(target_endian = "little").then_some(ends[1]));
        for wrong in ["  sl  local_address rem_address   st", "", "0: 01:02 03:04 01"] {
            assert_eq!(row(wrong), None);
        }
    }
}
