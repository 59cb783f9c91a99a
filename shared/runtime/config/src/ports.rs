//! `[[motor_io.ports]]`: serial ports with their drive units.

use crate::drive_family::{DriveFamily, DriveProtocol, Wire};
use crate::problem::Problem;
use crate::section::between;
use serde::{Deserialize, Serialize};

crate::choice! {
    /// A status input of a serial port.
    pub enum StopPin {
        /// Clear to send.
        Cts = "cts",
        /// Data set ready.
        Dsr = "dsr",
        /// Carrier detect.
        Cd = "cd",
    }
}

crate::section! {
    /// `[[motor_io.ports]]`.
    pub struct PortSection {
        /// Device, e.g. `/dev/serial/by-id/..`; `{domain}` is replaced by the domain's folder, where the virtual motor
        /// box creates its ports.
        pub path: String = String::new(),
        /// Drive family on this port.
        pub protocol: DriveProtocol = DriveProtocol::default(),
        /// Baud rate.
        pub baud: u32 = 230_400,
        /// How the units are connected: `serial`, or `usb` for a USB adapter with a bus behind it, which not every
        /// family has.
        pub wire: Wire = Wire::Serial,
        /// Drive units on this port.
        pub units: Vec<UnitSection> = Vec::new(),
        /// Status input of this port, `cts`, `dsr` or `cd`, that the closed contact of a stop button keeps active;
        /// default: none. An inactive or unreadable input is an emergency stop.
        pub stop_pin: Option<StopPin> = None,
        /// Torque per motor current as these units state both, N m/A, for soft mode; default: unknown, and no soft
        /// mode.
        pub torque_constant_n_m_a: Option<f64> = None => between(1e-6, 1e3, "newton metres per ampere"),
    }
}

/// `[[motor_io.ports.units]]`.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct UnitSection {
    /// Address of the unit on the port; which ones there are is up to the drive family.
    pub address: u8,
    /// Numbers, from 1, of the cables on motor 1 and motor 2.
    pub cables: Vec<usize>,
    /// Input of the unit's second encoder of its one cable, as the drive family numbers them; default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub second_encoder: Option<u8>,
}

/// Checks the ports of a robot with so many cables.
pub(crate) fn check(ports: &[PortSection], cables: usize) -> Result<(), Problem> {
    if ports.is_empty() {
        let clause = "is empty; accepted: at least one serial port with its drive units";
        return Err(Problem::with_clause("motor_io.ports", clause));
    }
    let mut owner: Vec<Option<(usize, u8)>> = vec![None; cables];
    for (index, port) in ports.iter().enumerate() {
        let here =
            |problem: Problem| problem.within(&format!("motor_io.ports.{index}"), &format!("port {}", index + 1));
        if ports[..index].iter().any(|other| other.path == port.path) {
            let sentence = format!("two ports have the path {}; accepted: each device once", port.path);
            return Err(here(Problem::with_sentence("path", sentence)));
        }
        serial_port(port).map_err(here)?;
        for (at, unit) in port.units.iter().enumerate() {
            let of_unit =
                |problem: Problem| here(problem.within(&format!("units.{at}"), &format!("unit {}", unit.address)));
            if port.units[..at].iter().any(|other| other.address == unit.address) {
                let sentence = format!(
                    "two units on port {} have the address {}; accepted: each address once per port",
                    index + 1,
                    unit.address
                );
                return Err(of_unit(Problem::with_sentence("address", sentence)));
            }
            let family = port.protocol.family();
            drive_unit(unit, &family, index + 1, cables, &mut owner).map_err(of_unit)?;
        }
    }
    match owner.iter().position(Option::is_none) {
        Some(cable) => Err(Problem::with_sentence(
            "motor_io.ports",
            format!("no drive unit has cable {}; accepted: every cable on one motor", cable + 1),
        )),
        None => Ok(()),
    }
}

fn serial_port(port: &PortSection) -> Result<(), Problem> {
    if port.path.is_empty() {
        return Err(Problem::with_clause("path", "is empty; accepted: a device, e.g. /dev/serial/by-id/..."));
    }
    let family = port.protocol.family();
    if port.wire == Wire::Usb && family.usb_s.is_none() {
        let clause = format!("is usb; accepted: serial, because {} has no USB adapter", port.protocol.name());
        return Err(Problem::with_clause("wire", clause));
    }
    if port.torque_constant_n_m_a.is_some() && !family.torque {
        let clause = format!("is given; accepted: none, because {} takes no torque", port.protocol.name());
        return Err(Problem::with_clause("torque_constant_n_m_a", clause));
    }
    let bauds = family.bauds;
    if !bauds.contains(&port.baud) {
        let accepted: Vec<String> = bauds.iter().map(u32::to_string).collect();
        return Err(Problem::with_clause("baud", format!("is {}; accepted: {}", port.baud, accepted.join(", "))));
    }
    if port.units.is_empty() {
        return Err(Problem::with_clause("units", "is empty; accepted: at least one drive unit"));
    }
    let [on_serial, on_usb] = family.units;
    let most = if port.wire == Wire::Usb { on_usb } else { on_serial };
    if port.units.len() > most {
        let clause = format!(
            "has {} drive units; accepted: at most {most} on a port of {} with wire = \"{}\"",
            port.units.len(),
            port.protocol.name(),
            port.wire.name()
        );
        return Err(Problem::with_clause("units", clause));
    }
    Ok(())
}

/// Checks a unit on the port with this `number`; `owner` contains the port and the address of the unit of each cable.
fn drive_unit(
    unit: &UnitSection,
    family: &DriveFamily,
    number: usize,
    cables: usize,
    owner: &mut [Option<(usize, u8)>],
) -> Result<(), Problem> {
    let address = unit.address;
    if !family.addresses.contains(&address) {
        let accepted = family.addresses_in_words;
        let sentence = format!("`address` on port {number} is {address}; accepted: {accepted}");
        return Err(Problem::with_sentence("address", sentence));
    }
    let at_cables = |sentence: String| Err(Problem::with_sentence("cables", sentence));
    if !(1..=family.motors).contains(&unit.cables.len()) {
        let accepted = if family.motors == 1 { "one, on its motor" } else { "one or two, on motor 1 and motor 2" };
        return at_cables(format!(
            "unit {address} on port {number} has {} cables; accepted: {accepted}",
            unit.cables.len()
        ));
    }
    if let Some(input) = unit.second_encoder {
        let Some(inputs) = family.second_encoders.clone() else {
            let sentence = format!(
                "`second_encoder` of unit {address} on port {number} is {input}, and nims reads none from this drive family; accepted: no such key, or another family"
            );
            return Err(Problem::with_sentence("second_encoder", sentence));
        };
        if !inputs.contains(&input) || unit.cables.len() != 1 {
            let sentence = format!(
                "`second_encoder` of unit {address} on port {number} is {input} with {} cables; accepted: {} to {}, for one cable",
                unit.cables.len(),
                inputs.start(),
                inputs.end()
            );
            return Err(Problem::with_sentence("second_encoder", sentence));
        }
    }
    for cable in &unit.cables {
        if !(1..=cables).contains(cable) {
            return at_cables(format!("unit {address} on port {number} has cable {cable}; accepted: 1 to {cables}"));
        }
        if let Some((port, other)) = owner[cable - 1].replace((number, address)) {
            return at_cables(format!(
                "cable {cable} is on unit {other} of port {port} and on unit {address} of port {number}; accepted: one motor per cable"
            ));
        }
    }
    Ok(())
}
