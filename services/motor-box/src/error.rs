//! Why the box cannot be built or go on.

use thiserror::Error;

use crate::config::ConfigError;

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
    #[error("port {port} does not exist: this box has {count}, numbered from 0")]
    NoSuchPort {
        /// Index asked for.
        port: usize,
        /// Ports there are.
        count: usize,
    },
    /// A unit that does not exist.
    #[error("there is no unit {address:#04x} on port {port}")]
    NoSuchUnit {
        /// Port asked for.
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
