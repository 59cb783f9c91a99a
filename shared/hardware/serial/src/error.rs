//! What can go wrong with a serial line, told apart by what helps against it.

use std::io;
use std::sync::Arc;

/// Why a serial line could not be used. Cloning one does not allocate.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// Nothing is there under this name.
    #[error("{port}: no such device; check the name and that the adapter is plugged in and powered")]
    Missing {
        /// Name under which the port was asked for.
        port: Arc<str>,
    },
    /// Another program holds the port.
    #[error("{port}: in use by another program; end that program, only one may drive the motors")]
    Busy {
        /// Name under which the port was asked for.
        port: Arc<str>,
    },
    /// This user may not open it.
    #[error(
        "{port}: this user may not open it; add the user to the group that owns the device (often dialout) and log in again"
    )]
    Denied {
        /// Name under which the port was asked for.
        port: Arc<str>,
    },
    /// It is there, but it cannot be used as a serial port.
    #[error("{port}: cannot be used as a serial port at {baud} baud ({detail})")]
    Unusable {
        /// Name under which the port was asked for.
        port: Arc<str>,
        /// Bits per second asked for.
        baud: u32,
        /// What the system said.
        detail: Arc<str>,
    },
    /// It was there and went away. A handle that has said this once never works again.
    #[error("{port}: the device went away while {doing}; plug it in again, it is reopened by itself")]
    Gone {
        /// Name under which the port was asked for.
        port: Arc<str>,
        /// What was being done.
        doing: &'static str,
    },
    /// The device did not take the bytes before the deadline.
    #[error("{port}: the device took no more bytes; check its cable, or unplug it and plug it in again")]
    Stuck {
        /// Name under which the port was asked for.
        port: Arc<str>,
    },
    /// Its inputs beside the data cannot be read.
    #[error("{port}: has no status pins that can be read; wire the stop input to another port, or leave stop_pin out")]
    NoPin {
        /// Name under which the port was asked for.
        port: Arc<str>,
    },
    /// A pseudo-terminal could not be offered.
    #[error("pseudo-terminal {port}: could not {doing} ({kind})")]
    Terminal {
        /// The published name, or what is known of it.
        port: Arc<str>,
        /// What was being done.
        doing: &'static str,
        /// What the system said.
        kind: io::ErrorKind,
    },
    /// A pseudo-terminal could not be offered, because something else has its name.
    #[error(
        "pseudo-terminal {port}: could not publish its name: a file that is not a link is in the way ({})",
        io::ErrorKind::AlreadyExists
    )]
    NotALink {
        /// The name.
        port: Arc<str>,
    },
}

impl Error {
    /// True where only opening the port again can help.
    #[must_use]
    pub fn is_lost(&self) -> bool {
        !matches!(self, Error::Stuck { .. } | Error::NoPin { .. })
    }

    pub(crate) fn from_open(port: &Arc<str>, baud: u32, error: &serialport::Error) -> Error {
        use serialport::ErrorKind as Kind;
        let port = Arc::clone(port);
        match error.kind() {
            Kind::NoDevice => Error::Busy { port },
            Kind::Io(io::ErrorKind::NotFound) => Error::Missing { port },
            Kind::Io(io::ErrorKind::PermissionDenied) => Error::Denied { port },
            _ => Error::Unusable { port, baud, detail: error.to_string().into() },
        }
    }
}

/// serialport loses the system's error number, so its kinds have to be sorted by what they can mean.
pub(crate) fn only_a_pause(kind: io::ErrorKind) -> bool {
    matches!(kind, io::ErrorKind::TimedOut | io::ErrorKind::Interrupted | io::ErrorKind::WouldBlock)
}
