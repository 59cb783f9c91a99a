//! Why the box cannot be built or go on.

use thiserror::Error;

/// What went wrong in the box.
#[derive(Debug, Error)]
pub enum BoxError {
    /// The configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The physics.
    #[error("the plant: {0}")]
    Plant(#[from] plant::PlantError),
    /// A port.
    #[error(transparent)]
    Serial(#[from] serial::Error),
    /// A port that does not exist.
    #[error("there is no port {}; accepted: 1 to {count}", .port.saturating_add(1))]
    NoSuchPort {
        /// Index asked for, from 0.
        port: usize,
        /// Ports there are.
        count: usize,
    },
    /// A unit that does not exist.
    #[error("there is no unit with the address {address} on port {}", .port.saturating_add(1))]
    NoSuchUnit {
        /// Index of the port asked for, from 0.
        port: usize,
        /// Address asked for.
        address: u8,
    },
    /// The file beside a port.
    #[error("the file beside {}, in which the box tells what it leaves out of its time, cannot be made: {error}", .link.display())]
    Time {
        /// The port.
        link: std::path::PathBuf,
        /// What the system said.
        error: std::io::Error,
    },
    /// Waiting for bytes failed.
    #[error("cannot wait for bytes on the ports: {0}")]
    Wait(std::io::Error),
}

/// A system file that is not, or not only, for the virtual motor box.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ConfigError {
    /// Real hardware is configured.
    #[error(
        "the system file has no [motor_box] section, so its drives are real ones: add the section, or do not start motor-box"
    )]
    NoSection,
    /// The ground.
    #[error("{0}")]
    Ground(String),
    /// A port that is not in the domain's folder.
    #[error("motor_io.ports path = \"{0}\" is not a port of the virtual motor box: it has to begin with {{domain}}/")]
    NotOurPort(String),
}
