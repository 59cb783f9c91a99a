//! The rules of the workspace that a compiler does not check: who may depend on whom, and what each crate promises.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// One of our crates.
struct Package {
    folder: PathBuf,
    /// `shared`, `services` or `tests`.
    place: String,
    dependencies: BTreeSet<String>,
    dev_dependencies: BTreeSet<String>,
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_path_buf()
}

/// From the manifests themselves: the toolchain need not be installed for the user who runs the tests.
fn packages() -> BTreeMap<String, Package> {
    let mut found = BTreeMap::new();
    let within = |folder: &Path| -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        entries.filter(|path| path.is_dir()).collect()
    };
    let mut folders = vec![root().join("tests")];
    folders.extend(within(&root().join("services")));
    folders.extend(within(&root().join("shared")).iter().flat_map(|group| within(group)));
    for folder in folders {
        let manifest: toml::Table = std::fs::read_to_string(folder.join("Cargo.toml")).unwrap().parse().unwrap();
        let names = |section: &str| -> BTreeSet<String> {
            manifest
                .get(section)
                .and_then(toml::Value::as_table)
                .into_iter()
                .flat_map(|table| table.keys().cloned())
                .collect()
        };
        assert!(
            !manifest.contains_key("target"),
            "{}: dependencies of one platform escape these rules",
            folder.display()
        );
        let name = manifest["package"]["name"].as_str().unwrap().to_owned();
        let place = folder
            .strip_prefix(root())
            .unwrap()
            .components()
            .next()
            .unwrap()
            .as_os_str()
            .to_string_lossy()
            .into_owned();
        let mut dependencies = names("dependencies");
        dependencies.extend(names("build-dependencies"));
        found.insert(name, Package { folder, place, dependencies, dev_dependencies: names("dev-dependencies") });
    }
    found
}

/// Rust files of a crate's `src`.
fn sources(package: &Package) -> Vec<(PathBuf, String)> {
    let mut files = Vec::new();
    let mut folders = vec![package.folder.join("src")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "rs") {
                let text = std::fs::read_to_string(&path).unwrap();
                files.push((path, text));
            }
        }
    }
    files
}

#[test]
fn dependencies_point_one_way() {
    let packages = packages();
    let ours = |package: &Package| -> BTreeSet<String> {
        package.dependencies.iter().filter(|name| packages.contains_key(*name)).cloned().collect()
    };
    let may: BTreeMap<&str, &[&str]> = BTreeMap::from([
        ("cable-robot", &[][..]),
        ("cable-control", &["cable-robot"]),
        ("calibration", &["cable-robot"]),
        ("survey", &[]),
        // for tests only
        ("sentences", &[]),
        // a driver is made over the transport of `serial`
        ("serial", &["cable-robot", "evidence"]),
        ("roboclaw", &["cable-robot", "serial"]),
        ("messages", &[]),
        ("evidence", &[]),
        ("bus", &["messages"]),
        // configuration types are made from the mathematics
        ("config", &["messages", "cable-robot", "cable-control"]),
        ("segments", &["messages", "cable-robot"]),
        // samples are filled by the chassis of a process
        ("runtime", &["bus", "messages", "config", "robot-state"]),
        ("robot-state", &["messages"]),
        // a failure is made from what goes wrong below
        ("command", &["bus", "runlog", "messages", "config", "cable-robot"]),
        ("client", &["bus", "messages", "config", "cable-robot", "command"]),
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
        ("solve", &["cable-robot", "cable-control", "calibration"]),
    ]);
    for (name, package) in &packages {
        let ours = ours(package);
        match package.place.as_str() {
            // These work with the very steps of the services, and with whatever they read.
            _ if LINKS_SERVICES.contains(&name.as_str()) => {}
            "shared" => {
                let allowed = may
                    .get(name.as_str())
                    .unwrap_or_else(|| panic!("{name} has no rule: decide what it may depend on"));
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
            _ => {}
        }
    }
}

/// Crates that link the services' pure libraries, which nothing but the command and the tests may link in turn.
const LINKS_SERVICES: [&str; 7] =
    ["lockstep", "replay", "commissioning", "nims-bench", "nims-paper", "nims", "nims-tests"];

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

#[test]
fn a_program_is_thin() {
    for (name, package) in packages().iter().filter(|(_, package)| package.place == "services") {
        let main = std::fs::read_to_string(package.folder.join("src/main.rs")).unwrap();
        assert!(
            main.lines().count() < 100,
            "services/{name}/src/main.rs has {} lines; what it does belongs into the library",
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
fn every_unsafe_block_says_why_it_is_sound() {
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

/// The modules of its crate that a file names: `crate::one` and `crate::{one, other::Name}`.
fn modules_named(text: &str) -> BTreeSet<String> {
    let code: Vec<&str> = text.lines().filter(|line| !line.trim_start().starts_with("//")).collect();
    let mut named = BTreeSet::new();
    for rest in code.join("\n").split("crate::").skip(1) {
        let inside = rest.strip_prefix('{').map(|rest| rest.split("};").next().unwrap_or(rest));
        let paths: Vec<&str> = inside.map_or_else(|| vec![rest], |inside| inside.split(',').collect());
        let first =
            |path: &str| path.trim().split(|c: char| !c.is_alphanumeric() && c != '_').next().map(str::to_owned);
        named.extend(paths.into_iter().filter_map(first));
    }
    named
}

/// Each file can be read with those below it alone.
#[test]
fn no_two_files_of_the_estimator_name_each_other() {
    let packages = packages();
    let mut left: BTreeMap<String, BTreeSet<String>> = sources(&packages["estimator"])
        .into_iter()
        .map(|(path, text)| (path.file_stem().unwrap().to_string_lossy().into_owned(), modules_named(&text)))
        .collect();
    assert!(left["kalman"].contains("cable_estimator") && left["method"].contains("phi"), "{left:?}");
    // A file that names none of those that are left stands in no ring.
    while let Some(lowest) =
        left.iter().find(|(_, named)| !named.iter().any(|name| left.contains_key(name))).map(|(file, _)| file.clone())
    {
        left.remove(&lowest);
    }
    assert!(left.is_empty(), "these files name each other in a ring: {left:?}");
}

#[test]
fn every_crate_has_the_workspace_lints_and_a_purpose() {
    for (name, package) in &packages() {
        let manifest = std::fs::read_to_string(package.folder.join("Cargo.toml")).unwrap();
        assert!(manifest.contains("[lints]\nworkspace = true"), "{name} does not inherit the workspace's lints");
        let dependencies = manifest.split("[dependencies]").nth(1).unwrap_or("");
        assert!(
            !dependencies.contains("version ="),
            "{name} gives versions of its own; they stand in the workspace's Cargo.toml"
        );
        let lib = std::fs::read_to_string(package.folder.join("src/lib.rs")).unwrap();
        assert!(lib.starts_with("//! "), "{name}'s root does not say what it is for");
    }
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
            let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
            assert!(code.into_iter().all(|line| !line.contains(banned)), "{} names {banned}", path.display());
        }
    }
}

/// What IEEE 754 does not fix is the system's own, and not the same bits on every machine: `libm`'s functions are.
#[test]
fn what_decides_takes_its_functions_from_libm() {
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

#[test]
fn every_example_configuration_loads() {
    let configs = root().join("configs");
    let files = |folder: &str| -> Vec<PathBuf> {
        std::fs::read_dir(configs.join(folder)).unwrap().map(|entry| entry.unwrap().path()).collect()
    };
    for path in files("robots") {
        config::RobotFile::load(&path).unwrap();
    }
    for path in files("systems") {
        config::SystemFile::load(&path).unwrap();
    }
    for path in files("sensors") {
        sensor::SensorFile::load(&path).unwrap();
    }
    for path in files("ground") {
        config::GroundFile::load(&path).unwrap();
    }
    for path in files("missions") {
        planner::mission::Mission::read(&path).unwrap();
    }
}
