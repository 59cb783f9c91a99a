//! RoboClaw packet serial: codec, driver, and the unit's side of the protocol.
#![forbid(unsafe_code)]

pub mod codec;
mod crc;
pub mod driver;
mod error;
pub mod fleet;
mod packet;
mod status;
pub mod unit;

pub use crc::{Crc, crc16};
pub use driver::{Bus, BusConfig, Counters, Drive, Timed, UnitAnswer, UnitConfig, UnitReport};
pub use error::{Command, Error};
pub use fleet::{Fleet, FleetCommand, FleetReply, PortConfig, PortReport};
pub use packet::{MAX_PACKET, Packet};
pub use status::{Status, StatusWidth};
