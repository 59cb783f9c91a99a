//! The listening socket, and who connects to it.

use command::{Answer, Failure};
use rustix::fs::Mode;
use rustix::net::sockopt::socket_peercred;
use rustix::net::{
    AddressFamily, SocketAddrUnix, SocketFlags, SocketType, accept_with, bind, connect, listen as begin, socket_with,
};
use std::os::fd::OwnedFd;
use std::os::unix::fs::FileTypeExt;
use std::path::Path;

/// Connections that the kernel holds until they are accepted.
const BACKLOG: i32 = 128;
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
    if connect(new()?, &address).is_ok() {
        return Err(failed("another gateway listens there; end it first".to_owned()));
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

/// Accepts a connection, if one waits.
pub(crate) fn accept(listener: &OwnedFd) -> Option<(OwnedFd, Credentials)> {
    let accepted = accept_with(listener, SocketFlags::CLOEXEC | SocketFlags::NONBLOCK).ok()?;
    let found = socket_peercred(&accepted).ok()?;
    let pid = found.pid.as_raw_nonzero().get().unsigned_abs();
    Some((accepted, Credentials { uid: found.uid.as_raw(), gid: found.gid.as_raw(), pid }))
}
