//! Failures of the box.

use thiserror::Error;

/// Reason why the box cannot be built or continue.
#[derive(Debug, Error)]
pub enum BoxError {
    /// The configuration cannot be used.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The plant rejects its configuration.
    #[error("the plant: {0}")]
    Plant(#[from] plant::PlantError),
    /// A port failed.
    #[error(transparent)]
    Serial(#[from] serial::Error),
    /// A port that does not exist.
    #[error("there is no port {}; accepted: 1 to {count}", .port.saturating_add(1))]
    NoSuchPort {
        /// Requested index, from 0.
        port: usize,
        /// Number of ports.
        count: usize,
    },
    /// A unit that does not exist.
    #[error("there is no unit with the address {address} on port {}", .port.saturating_add(1))]
    NoSuchUnit {
        /// Requested port, from 0.
        port: usize,
        /// Requested address.
        address: u8,
    },
    /// The file beside a port cannot be used.
    #[error("the file beside {}, in which the box tells what it leaves out of its time, cannot be made: {error}", .link.display())]
    Time {
        /// Name of the port.
        link: std::path::PathBuf,
        /// Error of the system.
        error: std::io::Error,
    },
    /// Waiting for bytes failed.
    #[error("cannot wait for bytes on the ports: {0}")]
    Wait(std::io::Error),
}

/// Reason why a system file cannot be used for the virtual motor box.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ConfigError {
    /// The file is for real hardware.
    #[error(
        "the system file has no [motor_box] section, so its drives are real ones: add the section, or do not start motor-box"
    )]
    NoSection,
    /// The section or its ground file cannot be used.
    #[error("{0}")]
    File(String),
    /// A port that is not in the domain's folder.
    #[error("motor_io.ports path = \"{0}\" is not a port of the virtual motor box: it has to begin with {{domain}}/")]
    NotOurPort(String),
}
