//! The workspace rules that a compiler does not check: which crate may depend on which, and what each crate promises.

// `clippy.toml` permits `unwrap` in test functions only, and this file has helpers.
#![allow(clippy::unwrap_used)]

use architecture::Package;
use architecture::modules::has_tests;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// Crates of `shared/` and `tests/` that link the services' pure libraries, and the command. No other crate does, and
/// no service links these.
const LINKS_SERVICES: [&str; 11] = [
    "lockstep",
    "replay",
    "commissioning",
    "nims-bench",
    "nims-paper",
    "nims-sim",
    "nims-truth",
    "nims-manual",
    "nims",
    "nims-tests",
    "benchmarks",
];

/// The rule of every drive family, whatever its name.
const FAMILY: &str = "a drive family";

/// The suite that every drive family runs, which is no family.
const SUITE: &str = "drive-conformance";

/// Whether a package is a drive family: a crate of `shared` on top of `drives`.
fn is_family(name: &str, package: &Package) -> bool {
    package.place == "shared" && package.dependencies.contains("drives") && name != SUITE
}

fn packages() -> BTreeMap<String, Package> {
    architecture::packages().unwrap()
}

/// Rust files of a crate's `src`.
fn sources(package: &Package) -> Vec<(PathBuf, String)> {
    architecture::sources(&package.folder.join("src")).unwrap()
}

/// What a shared crate may depend on among ours.
const MAY_DEPEND_ON: &[(&str, &[&str])] = &[
    ("cable-robot", &[]),
    ("cable-control", &["cable-robot"]),
    ("calibration", &["cable-robot"]),
    ("survey", &[]),
    ("identification", &[]),
    // for tests only
    ("sentences", &[]),
    ("notes", &[]),
    ("architecture", &[]),
    // a driver uses the transport of `serial`
    ("serial", &["cable-robot", "evidence"]),
    // what every drive family has in common
    ("drives", &["serial"]),
    (FAMILY, &["drives", "serial"]),
    // for tests only: the contract of `drives`
    ("drive-conformance", &["drives", "serial"]),
    ("messages", &[]),
    ("evidence", &[]),
    ("bus", &["messages"]),
    ("gateway-protocol", &["messages"]),
    // configuration types use the mathematics
    ("config", &["messages", "cable-robot"]),
    // a refused mission is an answer to a request
    ("mission", &["config", "robot-state"]),
    ("segments", &["messages", "cable-robot"]),
    // the runtime of a process fills in samples
    ("runtime", &["bus", "messages", "config", "robot-state"]),
    // starts its program with ordinary scheduling
    ("program-pipe", &["runtime"]),
    ("robot-state", &["messages"]),
    // an error wraps the errors of the layers below
    ("command", &["bus", "runlog", "messages", "config", "cable-robot"]),
    // a reader of numbers makes their sentences
    ("client", &["bus", "messages", "config", "cable-robot", "command", "robot-state", "gateway-protocol"]),
    ("runlog", &["messages"]),
    ("plot", &["command"]),
    ("georeference", &["messages", "config", "cable-robot", "survey"]),
    (
        "analysis",
        &[
            "runlog",
            "plot",
            "georeference",
            "survey",
            "identification",
            "calibration",
            "robot-state",
            "command",
            "messages",
            "config",
            "cable-robot",
            "bus",
            "runtime",
            "segments",
        ],
    ),
    ("plant", &["cable-robot"]),
    // measurements are files, and lengths come from samples
    ("site-calibration", &["cable-robot", "calibration", "command", "config", "messages"]),
    // speaks for people and files; the driver of a family is for its tests only
    ("nims-drive-capture", &["command", "runtime", "serial"]),
    ("solve", &["cable-robot", "cable-control", "calibration"]),
];

#[test]
fn dependencies_point_one_way() {
    let may: BTreeMap<_, _> = MAY_DEPEND_ON.iter().copied().collect();
    let packages = packages();
    let ours = |package: &Package| -> BTreeSet<String> {
        package.dependencies.iter().filter(|name| packages.contains_key(*name)).cloned().collect()
    };
    for (name, package) in &packages {
        let ours = ours(package);
        match package.place.as_str() {
            // These run the steps of the services and read everything that the services read.
            _ if LINKS_SERVICES.contains(&name.as_str()) => {}
            "shared" => {
                let rule = if is_family(name, package) { FAMILY } else { name.as_str() };
                let allowed =
                    may.get(rule).unwrap_or_else(|| panic!("{name} has no rule: decide what it may depend on"));
                for dependency in &ours {
                    assert!(
                        allowed.contains(&dependency.as_str()),
                        "{name} depends on {dependency}; it may depend on {allowed:?} only"
                    );
                }
            }
            "services" => {
                for dependency in &ours {
                    let (place, above) = (&packages[dependency].place, ["plot", "analysis", "solve"]);
                    assert!(
                        place == "shared" && !LINKS_SERVICES.iter().chain(&above).any(|name| name == dependency),
                        "services/{name} depends on {dependency}; a service depends on the libraries below it only"
                    );
                }
            }
            _ => assert!(ours.is_empty(), "{name} depends on {ours:?}"),
        }
    }
}

#[test]
fn libraries_link_no_service() {
    let packages = packages();
    let is_service = |name: &String| packages.get(name).is_some_and(|package| package.place == "services");
    let linking = |package: &Package| {
        package.dependencies.iter().chain(&package.dev_dependencies).find(|name| is_service(name)).cloned()
    };
    for (name, package) in &packages {
        let may = LINKS_SERVICES.contains(&name.as_str());
        let found = linking(package);
        assert!(may || found.is_none(), "{name} depends on the service {}", found.unwrap_or_default());
    }
    for name in LINKS_SERVICES {
        assert!(linking(&packages[name]).is_some(), "{name} links no service: take it off the list");
    }
}

#[test]
fn foreign_interfaces_are_named_in_one_place() {
    for (foreign, only) in [("iceoryx2", "bus"), ("serialport", "serial"), ("mcap", "runlog")] {
        for (name, package) in &packages() {
            let depends = package
                .dependencies
                .iter()
                .chain(&package.dev_dependencies)
                .any(|dependency| dependency == foreign || dependency.starts_with(&format!("{foreign}-")));
            assert!(!depends || name == only, "{name} depends on {foreign}; only {only} may");
        }
    }
}

/// A drive family is a crate of `shared/hardware` on top of `drives`. Only one file of motor-io, the virtual motor box,
/// the names of configuration keys and what finds questions in recordings list the families.
#[test]
fn drive_families_are_named_in_one_place() {
    let packages = packages();
    let families: Vec<&String> =
        packages.iter().filter(|(name, package)| is_family(name, package)).map(|(name, _)| name).collect();
    let names: BTreeSet<&str> = families.iter().map(|name| name.as_str()).collect();
    assert_eq!(names, config::DriveProtocol::NAMES.iter().copied().collect(), "crates and names of families differ");
    let may = [
        "motor-io/src/backend.rs",
        "config/src/choice.rs",
        "config/src/drive_family.rs",
        "drive-capture/src/question.rs",
    ];
    let mut named: BTreeSet<&&str> = BTreeSet::new();
    for (name, package) in &packages {
        let depends = package.dependencies.iter().any(|dependency| families.contains(&dependency));
        assert!(!depends || ["motor-io", "motor-box"].contains(&name.as_str()), "{name} depends on a drive family");
        if families.contains(&name) || name == "motor-box" {
            continue;
        }
        for (path, text) in sources(package) {
            let text = text.to_lowercase();
            let place = may.iter().find(|place| path.ends_with(place));
            for family in families.iter().filter(|family| text.contains(family.as_str())) {
                assert!(place.is_some(), "{} names {family}; accepted: {may:?}", path.display());
            }
            named.extend(place);
        }
    }
    assert_eq!(named.len(), may.len(), "a listed file names no drive family; remove it from the list");
}

/// The true world is in `[motor_box]`. Of the services only the virtual motor box has its types, the supervisor writes
/// the copies of the configuration, and the operator's command links tools that judge the robot. The others can only
/// ask whether the drives are virtual.
#[test]
fn no_process_of_the_chain_reads_the_true_world() {
    for (name, package) in packages().iter().filter(|(_, package)| package.place == "services") {
        assert!(!package.dependencies.contains("motor-box") || name == "nims", "{name} links the virtual motor box");
        if ["motor-box", "supervisor", "nims"].contains(&name.as_str()) {
            continue;
        }
        for (path, text) in sources(package) {
            let asks = text.replace("motor_box.is_some()", "").replace("motor_box.is_none()", "");
            for banned in [".motor_box", "MotorBoxTable", "MOTOR_BOX"] {
                assert!(!asks.contains(banned), "{} reads {banned}", path.display());
            }
        }
    }
}

#[test]
fn a_program_is_thin() {
    for (name, package) in packages().iter().filter(|(_, package)| package.place == "services") {
        let main = std::fs::read_to_string(package.folder.join("src/main.rs")).unwrap();
        assert!(
            main.lines().count() < 100,
            "services/{name}/src/main.rs has {} lines; move what it does to the library",
            main.lines().count()
        );
        assert!(package.folder.join("src/lib.rs").is_file(), "services/{name} has no library");
    }
}

#[test]
fn unsafe_code_lives_in_one_crate() {
    for (name, package) in &packages() {
        if name == "bus" {
            continue;
        }
        let lib = package.folder.join("src/lib.rs");
        let text = std::fs::read_to_string(&lib).unwrap();
        assert!(text.contains("#![forbid(unsafe_code)]"), "{} does not forbid unsafe code", lib.display());
    }
}

#[test]
fn every_unsafe_block_has_a_safety_comment() {
    for package in packages().values() {
        for (path, text) in sources(package) {
            let lines: Vec<&str> = text.lines().collect();
            for (number, line) in lines.iter().enumerate() {
                let code = line.split("//").next().unwrap_or("");
                if !(code.contains("unsafe {") || code.contains("unsafe impl")) {
                    continue;
                }
                let said = lines[number.saturating_sub(6)..=number].iter().any(|above| above.contains("SAFETY"));
                assert!(said, "{}:{} has no SAFETY line", path.display(), number + 1);
            }
        }
    }
}

#[test]
fn every_crate_has_the_workspace_lints_and_a_purpose() {
    for (name, package) in packages().iter().filter(|(_, package)| !package.separate) {
        let manifest = std::fs::read_to_string(package.folder.join("Cargo.toml")).unwrap();
        assert!(manifest.contains("[lints]\nworkspace = true"), "{name} does not inherit the workspace's lints");
        let dependencies = manifest.split("[dependencies]").nth(1).unwrap_or("");
        assert!(
            !dependencies.contains("version ="),
            "{name} declares versions; move them to the workspace's Cargo.toml"
        );
        let lib = std::fs::read_to_string(package.folder.join("src/lib.rs")).unwrap();
        assert!(lib.starts_with("//! "), "{name}'s root has no module documentation");
    }
}

#[test]
fn tests_are_found_under_a_further_condition_and_not_in_a_text_or_a_macro() {
    for text in ["#[cfg(test)] mod tests;", "mod a { #[cfg(all(test, unix))] mod tests {} }", "#[test] fn it() {}"] {
        assert!(has_tests(text).unwrap(), "{text}");
    }
    let suite = "macro_rules! suite { () => { #[test] fn it() {} } }";
    for text in [suite, "// #[cfg(test)]", "const TEXT: &str = \"#[cfg(test)]\";", "#[cfg(not(test))] mod real;"] {
        assert!(!has_tests(text).unwrap(), "{text}");
    }
}

/// A test program takes time to build even if it tests nothing.
#[test]
fn a_library_is_tested_exactly_if_it_has_tests() {
    for (name, package) in packages().iter().filter(|(_, package)| !package.separate) {
        let manifest = std::fs::read_to_string(package.folder.join("Cargo.toml")).unwrap();
        let manifest: toml::Table = manifest.parse().unwrap();
        let set = manifest.get("lib").and_then(|lib| lib.get("test")).and_then(toml::Value::as_bool);
        let sources = sources(package);
        let (tested, has) = (set.unwrap_or(true), sources.iter().any(|(_, text)| has_tests(text).unwrap()));
        assert!(tested || !has, "{name} has tests: take `test = false` out of [lib] in its Cargo.toml");
        assert!(has || !tested, "{name} has no tests: set `test = false` under [lib] in its Cargo.toml");
    }
}

/// Whether code names a crate: at the beginning of a path or of a macro, or in `use`.
fn names(code: &str, dependency: &str) -> bool {
    let name = dependency.replace('-', "_");
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    code.match_indices(&name).any(|(at, _)| {
        let after = &code[at + name.len()..];
        !code[..at].ends_with(is_word) && (["::", ";", "!", " as ", " {"].iter().any(|next| after.starts_with(next)))
    })
}

/// Each dependency adds build time for every crate that links it.
#[test]
fn every_dependency_is_used() {
    let text = |folders: &[PathBuf]| -> String {
        let files =
            folders.iter().filter(|folder| folder.is_dir()).flat_map(|folder| architecture::sources(folder).unwrap());
        files.map(|(_, text)| text).collect()
    };
    for (name, package) in packages().iter().filter(|(_, package)| !package.separate) {
        let mut folders = vec![package.folder.join("src")];
        if name == "nims-tests" {
            folders.push(architecture::root().join("scripts/templates"));
        }
        let code = text(&folders);
        for dependency in &package.dependencies {
            assert!(names(&code, dependency), "{name} does not use {dependency}: take it out of its Cargo.toml");
        }
        folders.extend(["tests", "examples", "benches"].map(|place| package.folder.join(place)));
        let code = text(&folders);
        for dependency in &package.dev_dependencies {
            assert!(
                names(&code, dependency),
                "{name} does not use {dependency} in tests: take it out of its Cargo.toml"
            );
        }
    }
}

/// Whether a line contains this word, not as a part of a longer one.
fn has_word(line: &str, word: &str) -> bool {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    line.match_indices(word).any(|(at, _)| {
        let after = &line[at + word.len()..];
        !line[..at].ends_with(is_word) && !after.starts_with(is_word)
    })
}

#[test]
fn the_mathematics_does_no_io_and_reads_no_clock() {
    let packages = packages();
    let mathematics = ["cable-robot", "cable-control", "calibration", "survey"].map(|name| sources(&packages[name]));
    for (path, text) in mathematics.into_iter().flatten() {
        for banned in [
            "std::fs",
            "std::io",
            "std::net",
            "std::time",
            "std::thread",
            "std::env",
            "println!",
            "SystemTime",
            "Instant",
        ] {
            let mut code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
            assert!(!code.any(|line| has_word(line, banned)), "{} names {banned}", path.display());
        }
    }
}

/// Functions that IEEE 754 does not fix differ between machines; those of `libm` do not.
#[test]
fn deciding_code_uses_libm() {
    let packages = packages();
    for name in ["cable-robot", "cable-control", "messages", "motor-io", "estimator", "controller", "planner"] {
        for (path, text) in sources(&packages[name]) {
            let code = text.split("#[cfg(test)]").next().unwrap_or("");
            let code: String = code.lines().filter(|line| !line.trim_start().starts_with("//")).collect();
            for function in [
                "sin", "cos", "tan", "sin_cos", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "exp2",
                "exp_m1", "ln", "ln_1p", "log", "log2", "log10", "powf", "hypot", "cbrt", "mul_add",
            ] {
                let call = format!(".{function}(");
                assert!(!code.contains(&call), "{} calls {call}..)", path.display());
            }
        }
    }
}
