//! The name of a system file beside the name in it.
#![allow(clippy::unwrap_used)]

use commissioning::check;
use commissioning::finding::Level;
use std::path::Path;

#[test]
fn a_file_that_no_service_would_run_is_named() {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs");
    let folder = tempfile::tempdir().unwrap();
    for (from, to) in [
        ("robots/lab3.toml", "robots/lab3.toml"),
        ("systems/demo3.toml", "systems/demo3.toml"),
        ("systems/demo3.toml", "systems/lab.toml"),
    ] {
        let to = folder.path().join(to);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::copy(configs.join(from), to).unwrap();
    }
    let notes = |name: &str| {
        let findings = check::check(&folder.path().join("systems").join(name), None).unwrap();
        findings.into_iter().filter(|found| found.finding.contains(config::OF_SERVICES)).collect::<Vec<_>>()
    };
    assert_eq!(notes("demo3.toml"), []);
    let found = notes("lab.toml");
    assert!(found.len() == 1 && found[0].level == Level::Note, "{found:?}");
    for word in ["lab.toml", "\"demo3\"", "/etc/nims/systems/demo3.toml", "nims@demo3"] {
        assert!(found[0].finding.contains(word), "no {word} in {found:?}");
    }
}
