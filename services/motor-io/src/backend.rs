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
        DriveProtocol::Moteus => open_moteus(port, path, config),
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

fn open_moteus(port: &PortSection, path: &str, config: &CoreConfig) -> Result<Box<dyn DriveBus>, Error> {
    let wrong = |what| Error::Configuration { port: path.into(), what };
    use moteus::codec::Checksums;
    let watchdog_ms = moteus::watchdog_ms(config.watchdog_s).map_err(wrong)?;
    let unit = |section: &UnitSection| moteus::UnitConfig {
        address: section.address,
        watchdog_ms,
        bound: odometry::count_bound(config, &section.cables),
        torque_constant_n_m_a: port.torque_constant_n_m_a.unwrap_or(0.0),
        second: section
            .second_encoder
            .map(|source| moteus::SecondInput { source, bound: odometry::second_bound(config, &section.cables) }),
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

/// Counts of a step of a second encoder at a port of this family.
pub(crate) fn second_step_counts(protocol: DriveProtocol) -> f64 {
    match protocol {
        DriveProtocol::Moteus => moteus::SECOND_STEP_COUNTS,
        // These read none.
        DriveProtocol::Roboclaw | DriveProtocol::Odrive | DriveProtocol::Roboteq => 1.0,
    }
}

fn stop_pin(port: &PortSection) -> Option<StatusPin> {
    port.stop_pin.and_then(|pin| StatusPin::named(pin.name()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ask::{Trouble, ask};
    use drives::CountBound;
    use serial::{Device, Pipe, WireQueue};

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

    const PATIENCE_S: f64 = 3.0;

    /// A wire that brings back what was sent.
    struct Loopback;

    impl Device for Loopback {
        fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
            reply.push(now_ns, &[byte]);
        }
        fn advance(&mut self, _: u64) {}
    }

    /// A wire on which another device sends text.
    struct Stranger;

    impl Device for Stranger {
        fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
            if byte == b'\n' || byte == b'\r' {
                reply.push(now_ns, b"T=21.5;H=40\r\n");
            }
        }
        fn advance(&mut self, _: u64) {}
    }

    fn on_wire<D: Device + 'static>(protocol: DriveProtocol, device: D) -> Box<dyn DriveBus> {
        let bound = CountBound::NONE;
        match protocol {
            DriveProtocol::Roboclaw => {
                let unit = roboclaw::UnitConfig { address: 0x80, watchdog_tenths: 3, bound };
                let config =
                    roboclaw::BusConfig { baud: 230_400, margin_ns: 5_000_000, units: vec![unit], stop_pin: None };
                Box::new(roboclaw::Bus::new(Pipe::new("wire", 230_400, device), &config).unwrap())
            }
            DriveProtocol::Moteus => {
                let unit = moteus::UnitConfig {
                    address: 1,
                    watchdog_ms: 300,
                    bound,
                    torque_constant_n_m_a: 0.0,
                    second: None,
                };
                let config = moteus::BusConfig {
                    baud: 921_600,
                    margin_ns: 5_000_000,
                    checksums: moteus::codec::Checksums::Required,
                    units: vec![unit],
                    stop_pin: None,
                };
                Box::new(moteus::Bus::new(Pipe::new("wire", 921_600, device), &config).unwrap())
            }
            DriveProtocol::Odrive => {
                let config = odrive::BusConfig {
                    baud: 921_600,
                    margin_ns: 5_000_000,
                    address: 0,
                    axes: 2,
                    watchdog_ms: 300,
                    bound,
                    torque_constant_n_m_a: 0.0,
                    stop_pin: None,
                };
                Box::new(odrive::Bus::new(Pipe::new("wire", 921_600, device), &config).unwrap())
            }
            DriveProtocol::Roboteq => {
                let config = roboteq::BusConfig {
                    baud: 115_200,
                    margin_ns: 5_000_000,
                    address: 0,
                    axes: 2,
                    watchdog_ms: 300,
                    bound,
                    stop_pin: None,
                };
                Box::new(roboteq::Bus::new(Pipe::new("wire", 115_200, device), &config).unwrap())
            }
        }
    }

    fn trouble(protocol: DriveProtocol, device: impl Device + 'static) -> Trouble {
        ask(&mut *on_wire(protocol, device), protocol, PATIENCE_S).unwrap_err()
    }

    /// Each virtual unit as it comes out of the box, and with a fault that a builder meets; the cure names these words.
    #[test]
    fn each_family_answers_and_its_troubles_have_cures() {
        use DriveProtocol::{Moteus, Odrive, Roboclaw, Roboteq};
        let roboclaw =
            || roboclaw::unit::UnitBus::new(vec![roboclaw::unit::Unit::new(roboclaw::unit::UnitOptions::new(0x80))]);
        let moteus = || {
            let unit = moteus::unit::Unit::new(moteus::unit::UnitOptions::new(1));
            moteus::unit::UnitBus::new(vec![unit], moteus::codec::Checksums::Required)
        };
        let board = || odrive::unit::Board::new(odrive::unit::BoardOptions::new(0));
        let controller = || roboteq::unit::Controller::new(roboteq::unit::ControllerOptions::new(0));
        for (protocol, mut bus) in [
            (Roboclaw, on_wire(Roboclaw, roboclaw())),
            (Moteus, on_wire(Moteus, moteus())),
            (Odrive, on_wire(Odrive, board())),
            (Roboteq, on_wire(Roboteq, controller())),
        ] {
            let asked = ask(&mut *bus, protocol, PATIENCE_S).unwrap();
            assert!(asked.len() == 1 && asked[0].firmware.is_some(), "{protocol:?}: {asked:?}");
        }
        let mut muted = (roboclaw(), moteus(), board(), controller());
        muted.0.units_mut()[0].mute_until(u64::MAX);
        muted.1.units_mut()[0].mute_until(u64::MAX);
        muted.2.mute_until(u64::MAX);
        muted.3.mute_until(u64::MAX);
        let mut kept = (roboclaw(), moteus(), board(), controller());
        kept.0.units_mut()[0].keep_watchdog(0);
        kept.1.units_mut()[0].keep_watchdog(900);
        kept.2.keep_watchdog(900);
        kept.3.keep_watchdog(900);
        let mut open_loop = controller();
        open_loop.settings_mut().modes = [0; 2];
        open_loop.save();
        open_loop.reboot(0);
        for (protocol, found, words) in [
            (Roboclaw, trouble(Roboclaw, muted.0), "Motion Studio"),
            (Moteus, trouble(Moteus, muted.1), "id.id"),
            (Odrive, trouble(Odrive, muted.2), "uart_a_baudrate"),
            (Roboteq, trouble(Roboteq, muted.3), "115200"),
            (Moteus, trouble(Moteus, kept.1), "moteus_tool"),
            (Odrive, trouble(Odrive, kept.2), "watchdog_timeout"),
            (Roboteq, trouble(Roboteq, kept.3), "RWD"),
            (Roboclaw, trouble(Roboclaw, kept.0), "firmware"),
            (Moteus, trouble(Moteus, Loopback), "loopback"),
            (Odrive, trouble(Odrive, Loopback), "loopback"),
            (Roboteq, trouble(Roboteq, Loopback), "loopback"),
            (Roboclaw, trouble(Roboclaw, Loopback), "loopback"),
            (Moteus, trouble(Moteus, Stranger), "fdcanusb"),
            (Odrive, trouble(Odrive, Stranger), "ASCII"),
            (Roboteq, trouble(Roboteq, Stranger), "115200"),
            (Roboteq, trouble(Roboteq, open_loop), "MMOD"),
        ] {
            println!("{protocol:?}: {}: {}", found.sentence, found.cure);
            assert!(found.cure.contains(words), "{protocol:?}, {words}: {found:?}");
            assert!(found.sentence.starts_with("wire"), "names the port: {found:?}");
        }
    }
}
