//! The drive families: the only file of motor-io that names one.

use crate::odometry;
use crate::settings::CoreConfig;
use config::{DriveProtocol, PortSection, UnitSection, Wire};
use drives::{DriveBus, Error, InvalidConfig};
use serial::{ReopeningPort, StatusPin};

/// Opens the bus of one configured port with the family that its `protocol` names. The device at `path` need not be
/// there.
///
/// # Errors
/// A setting that the family does not have.
pub fn open(port: &PortSection, path: &str, config: &CoreConfig) -> Result<Box<dyn DriveBus>, Error> {
    let wrong = |what| Error::Configuration { port: path.into(), what };
    match port.protocol {
        DriveProtocol::Roboclaw => {
            let watchdog_tenths = roboclaw::watchdog_tenths(config.watchdog_s).map_err(wrong)?;
            let unit = |section: &UnitSection| roboclaw::UnitConfig {
                address: section.address,
                watchdog_tenths,
                bound: odometry::count_bound(config, &section.cables),
            };
            let bus = roboclaw::BusConfig {
                baud: port.baud,
                margin_ns: roboclaw::driver::USB_MARGIN_NS,
                units: port.units.iter().map(unit).collect(),
                stop_pin: stop_pin(port),
            };
            Ok(Box::new(roboclaw::Bus::new(ReopeningPort::new(path, port.baud), &bus)?))
        }
        DriveProtocol::Moteus => {
            use moteus::codec::Checksums;
            let watchdog_ms = moteus::watchdog_ms(config.watchdog_s).map_err(wrong)?;
            let unit = |section: &UnitSection| moteus::UnitConfig {
                address: section.address,
                watchdog_ms,
                bound: odometry::count_bound(config, &section.cables),
                torque_constant_n_m_a: port.torque_constant_n_m_a.unwrap_or(0.0),
                second: section.second_encoder.map(|source| moteus::SecondInput {
                    source,
                    bound: odometry::second_bound(config, &section.cables),
                }),
            };
            let bus = moteus::BusConfig {
                baud: if port.wire == Wire::Usb { 0 } else { port.baud },
                // Most UARTs are behind a USB adapter.
                margin_ns: moteus::driver::USB_MARGIN_NS,
                checksums: if port.wire == Wire::Usb { Checksums::Absent } else { Checksums::Required },
                units: port.units.iter().map(unit).collect(),
                stop_pin: stop_pin(port),
            };
            Ok(Box::new(moteus::Bus::new(ReopeningPort::new(path, port.baud), &bus)?))
        }
        DriveProtocol::Odrive => {
            let watchdog_ms = odrive::watchdog_ms(config.watchdog_s).map_err(wrong)?;
            let board = port.units.first().ok_or_else(|| wrong(InvalidConfig::NoUnits))?;
            let bus = odrive::BusConfig {
                baud: if port.wire == Wire::Usb { 0 } else { port.baud },
                margin_ns: odrive::driver::USB_MARGIN_NS,
                address: board.address,
                axes: board.cables.len(),
                watchdog_ms,
                bound: odometry::count_bound(config, &board.cables),
                torque_constant_n_m_a: port.torque_constant_n_m_a.unwrap_or(0.0),
                stop_pin: stop_pin(port),
            };
            Ok(Box::new(odrive::Bus::new(ReopeningPort::new(path, port.baud), &bus)?))
        }
        DriveProtocol::Roboteq => {
            let watchdog_ms = roboteq::watchdog_ms(config.watchdog_s).map_err(wrong)?;
            let controller = port.units.first().ok_or_else(|| wrong(InvalidConfig::NoUnits))?;
            let bus = roboteq::BusConfig {
                baud: if port.wire == Wire::Usb { 0 } else { port.baud },
                margin_ns: roboteq::driver::USB_MARGIN_NS,
                address: controller.address,
                axes: controller.cables.len(),
                watchdog_ms,
                bound: odometry::count_bound(config, &controller.cables),
                stop_pin: stop_pin(port),
            };
            Ok(Box::new(roboteq::Bus::new(ReopeningPort::new(path, port.baud), &bus)?))
        }
    }
}

fn stop_pin(port: &PortSection) -> Option<StatusPin> {
    port.stop_pin.and_then(|pin| StatusPin::named(pin.name()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The limits that configuration checks are those of the drivers.
    #[test]
    fn configuration_and_drivers_accept_the_same() {
        for protocol in DriveProtocol::ALL {
            let family = protocol.family();
            let ([shortest_s, longest_s], step_s) = (family.watchdog_s, family.watchdog_step_s);
            match protocol {
                DriveProtocol::Roboclaw => assert_eq!(family.addresses, roboclaw::codec::ADDRESSES),
                DriveProtocol::Moteus => assert_eq!(family.addresses, moteus::codec::ADDRESSES),
                // A name for messages.
                DriveProtocol::Odrive | DriveProtocol::Roboteq => {}
            }
            assert_eq!(family.torque, takes_torque(*protocol), "{}", protocol.name());
            let accepts = |seconds| match protocol {
                DriveProtocol::Roboclaw => roboclaw::watchdog_tenths(seconds).is_ok(),
                DriveProtocol::Moteus => moteus::watchdog_ms(seconds).is_ok(),
                DriveProtocol::Odrive => odrive::watchdog_ms(seconds).is_ok(),
                DriveProtocol::Roboteq => roboteq::watchdog_ms(seconds).is_ok(),
            };
            for (seconds, accepted) in [
                (shortest_s, true),
                (longest_s, true),
                (shortest_s + step_s, true),
                (shortest_s - step_s, false),
                (longest_s + step_s, false),
                (shortest_s + 0.5 * step_s, false),
            ] {
                assert_eq!(accepts(seconds), accepted, "{}: {seconds} s", protocol.name());
            }
        }
    }

    /// What the driver of a family offers where the port states its constant.
    fn takes_torque(protocol: DriveProtocol) -> bool {
        let file = match protocol {
            DriveProtocol::Roboclaw => "demo3",
            DriveProtocol::Moteus => "moteus4",
            DriveProtocol::Odrive => "odrive4",
            DriveProtocol::Roboteq => "roboteq3",
        };
        let path = format!("{}/../../configs/systems/{file}.toml", env!("CARGO_MANIFEST_DIR"));
        let system = config::SystemFile::load(std::path::Path::new(&path)).unwrap();
        let config = CoreConfig::from_files(&system, &system.robot_file().unwrap()).unwrap();
        let port = PortSection { torque_constant_n_m_a: Some(0.05), ..system.motor_io.ports[0].clone() };
        open(&port, "/nowhere", &config).unwrap().capabilities().torque
    }
}
