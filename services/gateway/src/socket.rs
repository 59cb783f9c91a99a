//! The listening socket, and who connects to it.

use command::{Answer, Failure};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::net::sockopt::socket_peercred;
use rustix::net::{
    AddressFamily, SocketAddrUnix, SocketFlags, SocketType, accept_with, bind, connect, listen as begin, socket_with,
};
use std::os::fd::OwnedFd;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::Path;

/// Connections that the kernel holds until they are accepted.
const BACKLOG: i32 = 4096;
/// Its user and its group may connect.
const MODE: u32 = 0o660;

/// User, group and process at the other end of a connection, as the kernel knows them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Credentials {
    pub(crate) uid: u32,
    pub(crate) gid: u32,
    pub(crate) pid: u32,
}

/// Creates the socket with mode 0660. The remains of a gateway that has died are replaced.
///
/// # Errors
/// Another gateway listens there, or the socket cannot be created.
pub(crate) fn listen(path: &Path) -> Answer<OwnedFd> {
    let failed = |why: String| Failure::NotNow(format!("the socket {} cannot be created: {why}", path.display()));
    let address = SocketAddrUnix::new(path).map_err(|error| failed(error.to_string()))?;
    let new = || {
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None).map_err(|error| failed(error.to_string()))
    };
    match connect(new()?, &address) {
        // Only these say that nothing listens there; e.g. one with many waiting clients answers EAGAIN.
        Err(Errno::CONNREFUSED | Errno::NOENT) => {}
        Ok(()) | Err(Errno::AGAIN) => return Err(failed("another gateway listens there; end it first".to_owned())),
        // The kinds of files are told apart below.
        Err(Errno::NOTSOCK | Errno::PROTOTYPE) => {}
        Err(error) => return Err(failed(error.to_string())),
    }
    match std::fs::symlink_metadata(path) {
        Ok(found) if found.file_type().is_socket() => {
            std::fs::remove_file(path).map_err(|error| failed(error.to_string()))?;
        }
        Ok(_) => return Err(failed("a file of another kind has its name; move it away".to_owned())),
        Err(_) => {}
    }
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).map_err(|error| failed(error.to_string()))?;
    }
    let listener = new()?;
    // The group is that of the process: its service sets it.
    let before = rustix::process::umask(Mode::from_raw_mode(0o777 & !MODE));
    let bound = bind(&listener, &address);
    rustix::process::umask(before);
    bound.and_then(|()| begin(&listener, BACKLOG)).map_err(|error| failed(error.to_string()))?;
    Ok(listener)
}

/// Device and inode of a socket, by which it is recognized at the end.
pub(crate) fn identity(path: &Path) -> Option<(u64, u64)> {
    std::fs::symlink_metadata(path).ok().map(|found| (found.dev(), found.ino()))
}

/// A descriptor that is given up to accept and close a connection while there is no other: the listener would otherwise
/// remain readable, and its clients would wait.
pub(crate) struct Spare(Option<OwnedFd>);

impl Spare {
    pub(crate) fn new() -> Self {
        Self(rustix::fs::open("/dev/null", OFlags::RDONLY | OFlags::CLOEXEC, Mode::empty()).ok())
    }

    /// Accepts the connections that wait, at most `most`.
    pub(crate) fn accept(&mut self, listener: &OwnedFd, most: usize) -> Vec<(OwnedFd, Credentials)> {
        let mut accepted = Vec::new();
        for _ in 0..most {
            match accept_with(listener, SocketFlags::CLOEXEC | SocketFlags::NONBLOCK) {
                Ok(stream) => accepted.extend(credentials(&stream).map(|found| (stream, found))),
                Err(Errno::MFILE | Errno::NFILE) => {
                    self.0 = None;
                    drop(accept_with(listener, SocketFlags::CLOEXEC | SocketFlags::NONBLOCK));
                    *self = Self::new();
                }
                Err(Errno::INTR | Errno::CONNABORTED) => {}
                Err(_) => break,
            }
        }
        accepted
    }
}

fn credentials(stream: &OwnedFd) -> Option<Credentials> {
    let found = socket_peercred(stream).ok()?;
    let pid = found.pid.as_raw_nonzero().get().unsigned_abs();
    Some(Credentials { uid: found.uid.as_raw(), gid: found.gid.as_raw(), pid })
}
