//! Failures of a serial port, classified by their remedy.

use std::io;
use std::sync::Arc;

/// Reason why a serial port cannot be used. Cloning one does not allocate.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// No device has this name.
    #[error("{port}: no such device; check the name and that the adapter is plugged in and powered")]
    Missing {
        /// Name of the port as configured.
        port: Arc<str>,
    },
    /// Another program holds the port.
    #[error("{port}: in use by another program; end that program, only one may drive the motors")]
    Busy {
        /// Name of the port as configured.
        port: Arc<str>,
    },
    /// The user has no permission to open it.
    #[error(
        "{port}: no permission to open it; add the user to the group that owns the device (often dialout) and log in again"
    )]
    Denied {
        /// Name of the port as configured.
        port: Arc<str>,
    },
    /// The device is not usable as a serial port.
    #[error("{port}: cannot be used as a serial port at {baud} baud ({detail})")]
    Unusable {
        /// Name of the port as configured.
        port: Arc<str>,
        /// Configured bits per second.
        baud: u32,
        /// Error of the system.
        detail: Arc<str>,
    },
    /// The device went away. The handle does not recover.
    #[error("{port}: the device went away while {doing}; plug it in again, it is reopened automatically")]
    Gone {
        /// Name of the port as configured.
        port: Arc<str>,
        /// Operation that failed.
        doing: &'static str,
    },
    /// The device did not take the bytes before the deadline.
    #[error("{port}: the device took no more bytes; check its cable, or unplug it and plug it in again")]
    Stuck {
        /// Name of the port as configured.
        port: Arc<str>,
    },
    /// Its status inputs cannot be read.
    #[error("{port}: has no status pins that can be read; wire the stop input to another port, or leave stop_pin out")]
    NoPin {
        /// Name of the port as configured.
        port: Arc<str>,
    },
    /// A pseudo-terminal could not be created or published.
    #[error("pseudo-terminal {port}: could not {doing} ({kind})")]
    Terminal {
        /// Published name, or the known part of it.
        port: Arc<str>,
        /// Operation that failed.
        doing: &'static str,
        /// Error of the system.
        kind: io::ErrorKind,
    },
    /// A pseudo-terminal could not be published, because a file that is not a link has its name.
    #[error(
        "pseudo-terminal {port}: could not publish its name: a file that is not a link is in the way ({})",
        io::ErrorKind::AlreadyExists
    )]
    NotALink {
        /// Name of the link.
        port: Arc<str>,
    },
}

impl Error {
    /// True where only reopening the port can help.
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
