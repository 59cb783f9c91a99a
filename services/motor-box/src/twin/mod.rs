//! The drive units of one port, whatever their family: what the machine shows them, and what they make of it.
//!
//! A family has a file here with a type that implements [`Twin`], and an arm in [`new`].

mod interface;
mod moteus;
mod odrive;
mod roboclaw;
mod roboteq;

use config::DriveProtocol;

use crate::settings::PortConfig;

pub(crate) use interface::{MOTORS, Readings, Twin, Winch};

/// The units of a port.
pub(crate) fn new(port: &PortConfig, turnaround_ns: u64) -> Box<dyn Twin> {
    match port.family {
        DriveProtocol::Roboclaw => Box::new(roboclaw::RoboclawTwin::new(port, turnaround_ns)),
        DriveProtocol::Odrive => Box::new(odrive::OdriveTwin::new(port, turnaround_ns)),
        DriveProtocol::Roboteq => Box::new(roboteq::RoboteqTwin::new(port, turnaround_ns)),
        DriveProtocol::Moteus => Box::new(moteus::MoteusTwin::new(port, turnaround_ns)),
    }
}
