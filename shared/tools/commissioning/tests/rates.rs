//! Highest control rates of the example systems.
#![allow(clippy::unwrap_used)]

use commissioning::check;
use commissioning::finding::Level;
use config::SystemFile;
use std::path::Path;

/// The example systems, and the highest rate of each, Hz; docs/drives.md has the table.
const HIGHEST_HZ: [(&str, f64); 6] = [
    ("demo3", 150.0),
    ("moteus4", 133.0),
    ("odrive4", 140.0),
    ("roboteq3", 100.0),
    ("mixed3", 208.0),
    // Its ports leave room for one cycle more than `rate_hz` may have.
    ("quick3", 501.0),
];

fn refusals(file: &SystemFile, rate_hz: f64) -> Vec<String> {
    let file = SystemFile { rate_hz, ..file.clone() };
    let findings = check::system(&file).unwrap();
    findings.into_iter().filter(|found| found.level == Level::Error).map(|found| found.cure).collect()
}

/// 500 Hz, the highest `rate_hz` of all, is for ports that leave the time for it, and for no other.
#[test]
fn at_500_hz_the_example_for_it_is_accepted_and_the_others_are_refused_with_their_own_rate() {
    let systems = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/systems");
    for (name, highest_hz) in HIGHEST_HZ {
        let file = SystemFile::load(&systems.join(name).with_extension("toml")).unwrap();
        let refused = refusals(&file, 500.0);
        let states = format!("rate_hz to at most {highest_hz}");
        assert_eq!(refused.is_empty(), name == "quick3", "{name}: {refused:?}");
        assert!(refused.iter().all(|cure| cure.contains(&states)), "{name}: {refused:?}");
    }
}

/// For every family, and for two of them in one robot: a rate that does not fit is refused with the one that does.
#[test]
fn a_rate_that_does_not_fit_is_refused_with_the_rate_that_does() {
    let systems = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/systems");
    for (name, highest_hz) in HIGHEST_HZ {
        let file = SystemFile::load(&systems.join(name).with_extension("toml")).unwrap();
        assert_eq!(check::highest_rate_hz(&file), highest_hz, "{name}");
        assert_eq!(refusals(&file, highest_hz), Vec::<String>::new(), "{name} at {highest_hz} Hz");
        let refused = refusals(&file, highest_hz + 1.0);
        let states = format!("rate_hz to at most {highest_hz}");
        assert!(!refused.is_empty() && refused.iter().all(|cure| cure.contains(&states)), "{name}: {refused:?}");
    }
}
