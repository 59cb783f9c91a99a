//! The device's side of a serial port of this machine: a pseudo-terminal under a stable name.

use std::fs;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStringExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, QueueSelector, ioctl_tiocnxcl, tcflush, tcgetattr, tcsetattr};

use crate::Error;

/// A pseudo-terminal in raw mode. Programs open its [`path`](Pty::path) as a serial port; this side reads and writes
/// without blocking.
#[derive(Debug)]
pub struct Pty {
    master: OwnedFd,
    /// Kept open so that the terminal keeps its settings, and reading this side does not fail while no program has it
    /// open.
    slave: OwnedFd,
    path: PathBuf,
}

impl Pty {
    /// Creates a pseudo-terminal. Needs no privileges.
    pub fn open() -> Result<Pty, Error> {
        let failed =
            |doing| move |error: rustix::io::Errno| terminal_error(Path::new("/dev/ptmx"), doing, error.into());
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let master = openpt(flags).map_err(failed("create one"))?;
        grantpt(&master).map_err(failed("grant access to it"))?;
        unlockpt(&master).map_err(failed("unlock it"))?;
        let name = ptsname(&master, Vec::new()).map_err(failed("learn its name"))?;
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let slave = rustix::fs::open(name.as_c_str(), flags, Mode::empty()).map_err(failed("open its other side"))?;
        // By default the group `tty` may write to a terminal; only the user may move the motors.
        rustix::fs::fchmod(&slave, Mode::RUSR | Mode::WUSR).map_err(failed("make it private"))?;
        // Raw before a program can open it: otherwise the terminal echoes the first command.
        let mut settings = tcgetattr(&slave).map_err(failed("read its settings"))?;
        settings.make_raw();
        tcsetattr(&slave, OptionalActions::Now, &settings).map_err(failed("make it raw"))?;
        let status = rustix::fs::fcntl_getfl(&master).map_err(failed("read its flags"))?;
        rustix::fs::fcntl_setfl(&master, status | OFlags::NONBLOCK).map_err(failed("make it non-blocking"))?;
        let path = PathBuf::from(std::ffi::OsString::from_vec(name.into_bytes()));
        Ok(Pty { master, slave, path })
    }

    /// Path under which programs open it.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads bytes that programs wrote; 0 if there are no bytes.
    pub fn read(&self, buffer: &mut [u8]) -> Result<usize, Error> {
        self.without_waiting("read from it", rustix::io::read(&self.master, buffer))
    }

    /// Writes bytes for the program; returns how many fit (fewer if no program reads and the terminal is full).
    pub fn write(&self, bytes: &[u8]) -> Result<usize, Error> {
        self.without_waiting("write to it", rustix::io::write(&self.master, bytes))
    }

    /// Allows the port to be opened again after its last user was killed. Call it a few times per second.
    ///
    /// A killed program leaves its exclusive mode on a pseudo-terminal for as long as this side is open, and an
    /// unprivileged program can then never open it. Two programs are kept apart by the file lock, which ends with its
    /// holder.
    pub fn release_exclusive(&self) {
        let _ = ioctl_tiocnxcl(&self.slave);
    }

    /// Discards bytes that no program has read: a real device does not queue bytes for an absent program.
    pub fn discard_unread(&self) {
        let _ = tcflush(&self.slave, QueueSelector::IFlush);
    }

    fn without_waiting(&self, doing: &'static str, result: rustix::io::Result<usize>) -> Result<usize, Error> {
        match result {
            Ok(n) => Ok(n),
            Err(rustix::io::Errno::AGAIN | rustix::io::Errno::INTR) => Ok(0),
            Err(error) => Err(terminal_error(&self.path, doing, error.into())),
        }
    }
}

impl AsFd for Pty {
    /// Descriptor of this side, for `poll`.
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.master.as_fd()
    }
}

/// A stable link to a pseudo-terminal that can be unplugged and plugged in again.
#[derive(Debug)]
pub struct PtyLink {
    link: PathBuf,
    pty: Option<Pty>,
}

impl PtyLink {
    /// An empty jack; nothing is published yet.
    #[must_use]
    pub fn new(link: &Path) -> PtyLink {
        PtyLink { link: link.to_owned(), pty: None }
    }

    /// Name that programs use.
    #[must_use]
    pub fn link(&self) -> &Path {
        &self.link
    }

    /// Creates a pseudo-terminal and points the link at it, atomically. Creates the link's folder.
    pub fn plug(&mut self) -> Result<&Pty, Error> {
        let pty = Pty::open()?;
        let link = self.link.clone();
        let failed = |doing| {
            let link = link.as_path();
            move |error: io::Error| terminal_error(link, doing, error)
        };
        if let Some(folder) = self.link.parent() {
            fs::create_dir_all(folder).map_err(failed("create its folder"))?;
        }
        if fs::symlink_metadata(&self.link).is_ok_and(|there| !there.is_symlink()) {
            return Err(Error::NotALink { port: Arc::from(self.link.to_string_lossy()) });
        }
        // The process number keeps the temporary names of two boxes that start at once apart.
        let mut fresh = self.link.clone().into_os_string();
        fresh.push(format!(".{}", std::process::id()));
        let _ = fs::remove_file(&fresh);
        std::os::unix::fs::symlink(&pty.path, &fresh).map_err(failed("publish its name"))?;
        fs::rename(&fresh, &self.link).map_err(failed("publish its name"))?;
        Ok(self.pty.insert(pty))
    }

    /// Removes the link and closes the pseudo-terminal: a program that has it open finds its device gone.
    pub fn unplug(&mut self) {
        if let Some(pty) = self.pty.take()
            // Another process may have published its terminal under this name meanwhile.
            && fs::read_link(&self.link).is_ok_and(|target| target == pty.path)
        {
            let _ = fs::remove_file(&self.link);
        }
    }

    /// Pseudo-terminal while it is plugged in.
    #[must_use]
    pub fn pty(&self) -> Option<&Pty> {
        self.pty.as_ref()
    }
}

impl Drop for PtyLink {
    fn drop(&mut self) {
        self.unplug();
    }
}

fn terminal_error(port: &Path, doing: &'static str, error: io::Error) -> Error {
    Error::Terminal { port: Arc::from(port.to_string_lossy()), doing, kind: error.kind() }
}
