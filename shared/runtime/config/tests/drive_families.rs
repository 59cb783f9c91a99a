//! What each drive family accepts on a port, and the time that its cycle needs.
#![allow(clippy::unwrap_used)]

use config::{DriveProtocol, SystemFile, Wire};
use std::path::Path;

/// Loads a system of three cables with this table of ports, and these settings before it.
fn load(settings: &str, ports: &str) -> Result<SystemFile, String> {
    let robot = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/robots/lab3.toml").canonicalize().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("system.toml");
    let head = format!("name = \"x\"\nrobot = {robot:?}\n[motor_io]\ncounts_per_m = [1e4, 1e4, 1e4]\n{settings}\n");
    std::fs::write(&path, format!("{head}{ports}")).unwrap();
    SystemFile::load(&path).map_err(|error| error.to_string())
}

fn port(number: usize, keys: &str) -> String {
    format!("[[motor_io.ports]]\npath = \"/dev/none{number}\"\n{keys}\n")
}

#[test]
fn ports_of_different_families_are_accepted_together() {
    let ports = port(0, "protocol = \"odrive\"\nbaud = 921600\nunits = [{ address = 0, cables = [1, 2] }]")
        + &port(1, "protocol = \"moteus\"\nbaud = 921600\nunits = [{ address = 1, cables = [3] }]");
    let file = load("", &ports).unwrap();
    let families: Vec<&str> = file.motor_io.ports.iter().map(|port| port.protocol.name()).collect();
    assert_eq!(families, ["odrive", "moteus"]);
    let units =
        "units = [{ address = 1, cables = [1] }, { address = 2, cables = [2] }, { address = 126, cables = [3] }]";
    let usb = port(0, &format!("protocol = \"moteus\"\nwire = \"usb\"\nbaud = 921600\n{units}"));
    assert_eq!(load("watchdog_s = 0.125", &usb).unwrap().motor_io.ports[0].wire, Wire::Usb);
}

#[test]
fn what_a_family_does_not_have_is_refused_with_what_it_has() {
    let rest = &port(1, "units = [{ address = 128, cables = [2, 3] }]");
    for (keys, settings, named) in [
        ("wire = \"usb\"\nunits = [{ address = 128, cables = [1] }]", "", &["wire", "serial", "roboclaw"][..]),
        (
            "protocol = \"moteus\"\nunits = [{ address = 1, cables = [1] }, { address = 2, cables = [1] }]",
            "",
            &["2", "at most 1", "moteus"],
        ),
        (
            "protocol = \"odrive\"\nwire = \"usb\"\nunits = [{ address = 1, cables = [1] }, { address = 2, cables = [1] }]",
            "",
            &["2", "at most 1", "odrive"],
        ),
        ("protocol = \"moteus\"\nunits = [{ address = 127, cables = [1] }]", "", &["address", "127", "1 to 126"]),
        ("protocol = \"moteus\"\nunits = [{ address = 1, cables = [1, 2] }]", "", &["unit 1", "2 cables", "one"]),
        (
            "protocol = \"moteus\"\nbaud = 9600\nunits = [{ address = 1, cables = [1] }]",
            "",
            &["baud", "9600", "921600", "3000000"],
        ),
        (
            "protocol = \"moteus\"\nunits = [{ address = 1, cables = [1] }]",
            "watchdog_s = 0.125",
            &["watchdog_s", "0.125", "0.1"],
        ),
        (
            "protocol = \"odriv\"\nunits = [{ address = 1, cables = [1] }]",
            "",
            &["protocol", "odriv", "did you mean odrive"],
        ),
    ] {
        let error = load(settings, &(port(0, keys) + rest)).unwrap_err();
        assert!(named.iter().all(|part| error.contains(part)), "{keys}: {error}");
    }
}

#[test]
fn a_cycle_takes_longer_with_more_units_and_at_a_lower_baud() {
    for protocol in DriveProtocol::ALL {
        let family = protocol.family();
        let (slow, fast) = (family.bauds[0], *family.bauds.last().unwrap());
        let cycle_s = |units, baud, wire| family.cycle_s(units, baud, wire);
        assert!(cycle_s(1, slow, Wire::Serial) > cycle_s(1, fast, Wire::Serial));
        assert!(cycle_s(2, fast, Wire::Serial) > cycle_s(1, fast, Wire::Serial));
        if family.usb_s.is_some() {
            // The baud rate has no meaning.
            assert_eq!(cycle_s(1, slow, Wire::Usb).to_bits(), cycle_s(1, fast, Wire::Usb).to_bits());
        }
    }
    // The bytes of the first family's cycle, as they were before there were others.
    let roboclaw = DriveProtocol::default().family().cycle_s(2, 230_400, Wire::Serial);
    assert!((roboclaw - 0.005_311).abs() < 1e-6, "{roboclaw}");
}
