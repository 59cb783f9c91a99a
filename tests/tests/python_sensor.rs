//! `nims new-sensor`: its output runs unmodified; a recorder that was started earlier records the sensor in Python.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use nims_tests::python;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use bus::{Bus, Domain, Subscriber};
use messages::{Heartbeat, hash_of};
use runlog::info;

fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

/// A process that ends with the test.
struct Guard(Child);

impl Drop for Guard {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Guard {
    fn end(&mut self) -> Option<i32> {
        assert!(Command::new("kill").args(["-TERM", &self.0.id().to_string()]).status().unwrap().success());
        self.0.wait().unwrap().code()
    }
}

fn until(what: &str, mut done: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !done() {
        assert!(begun.elapsed() < Duration::from_secs(30), "timeout: {what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Runs `nims new-sensor` in that folder; returns its success and its output.
fn new_sensor(folder: &Path, args: &[&str]) -> (bool, String) {
    let nims = std::env::current_exe().unwrap().parent().unwrap().join("../nims");
    let output = Command::new(nims).arg("new-sensor").args(args).current_dir(folder).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    (output.status.success(), said)
}

#[test]
fn a_new_sensor_in_rust_is_the_tested_template_under_its_name_and_nothing_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let (done, said) = new_sensor(folder.path(), &["soil-probe", "--rust"]);
    // The command that plugs it in.
    assert!(done && said.contains("nims plug soil-probe -- soil-probe/target/debug/soil-probe"), "{said}");
    for file in ["src/main.rs", "src/driver.rs"] {
        let read = |path: PathBuf| std::fs::read_to_string(path).unwrap();
        let template = read(project().join("scripts/templates/sensor").join(file));
        let expected = template.replace("\"example\"", "\"soil-probe\"").replace("Example", "SoilProbe");
        assert_eq!(read(folder.path().join("soil-probe").join(file)), expected);
        assert!(expected.lines().count() < 40, "{file}");
    }
    let manifest: toml::Table =
        std::fs::read_to_string(folder.path().join("soil-probe/Cargo.toml")).unwrap().parse().unwrap();
    assert_eq!(manifest["package"]["name"].as_str(), Some("soil-probe"));
    assert!(manifest.contains_key("workspace"), "the new crate is its own workspace");
    for library in ["messages", "runtime"] {
        let path = manifest["dependencies"][library]["path"].as_str().unwrap();
        assert!(Path::new(path).is_absolute() && Path::new(path).join("Cargo.toml").is_file(), "{path}");
    }
    std::fs::write(folder.path().join("leaf.py"), "mine").unwrap();
    for args in [&["soil-probe", "--rust"][..], &["leaf"]] {
        let (done, said) = new_sensor(folder.path(), args);
        assert!(!done, "{said}");
    }
    assert_eq!(std::fs::read_to_string(folder.path().join("leaf.py")).unwrap(), "mine");
    for args in [&["Soil"][..], &["2soil"], &["soil/probe"], &["soil", "--rust", "--nims", "/nowhere"]] {
        let (done, said) = new_sensor(folder.path(), args);
        assert!(!done && said.lines().count() == 1, "{said}");
    }
    assert!(!folder.path().join("soil").exists());
}

/// Runs a script of `tests/python` with the folder of the package; it checks by itself.
fn checks(script: &str, args: &[&str]) {
    let output = Command::new(python())
        .arg(project().join("tests/python").join(script))
        .arg(project().join("scripts/python"))
        .args(args)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_signal_ends_every_publisher_of_a_program() {
    let folder = tempfile::tempdir().unwrap();
    for signal in ["SIGINT", "SIGTERM"] {
        checks("check_signals.py", &[folder.path().to_str().unwrap(), signal]);
    }
}

#[test]
fn the_bridge_to_ros_2_outlives_the_gateway_and_publishes_nothing_after_its_end() {
    checks("check_bridge.py", &[]);
}

/// Starts the recorder, and waits until it is ready.
fn recorder(domain: &Domain, run: &Path, log: Stdio, beats: &mut Subscriber<Heartbeat>) -> Guard {
    let program = std::env::current_exe().unwrap().parent().unwrap().join("../recorder");
    let mut command = Command::new(program);
    let recorder = Guard(command.args(["--domain", domain.name(), "--run"]).arg(run).stderr(log).spawn().unwrap());
    until("the recorder is ready", || {
        std::iter::from_fn(|| beats.receive().unwrap()).any(|beat| beat.state == Heartbeat::STATE_READY)
    });
    recorder
}

/// The only place is taken before either starts.
#[test]
fn a_full_robot_still_records_a_new_sensor() {
    let (domain, folder) = (Domain::for_test(), tempfile::tempdir().unwrap());
    domain.set_processes(1).unwrap();
    let bus = Bus::join(&domain, "test").unwrap();
    let mut beats = bus.subscriber::<Heartbeat>("system/heartbeat/recorder").unwrap();
    let log = |name: &str| folder.path().join(name);
    let to = |name: &str| Stdio::from(std::fs::File::create(log(name)).unwrap());
    let mut recorder = recorder(&domain, folder.path(), to("recorder.log"), &mut beats);
    assert!(new_sensor(folder.path(), &["example"]).0);
    let mut python = Command::new(python());
    let sensor = python.arg(log("example.py")).args(["--shared-memory", "--domain", domain.name()]);
    let mut sensor = Guard(sensor.stderr(to("sensor.log")).spawn().unwrap());
    let mut tap = None;
    until("the sensor publishes", || {
        tap = tap.take().or_else(|| bus.tap("sensor/example").ok());
        tap.as_mut().is_some_and(|tap| tap.receive(|_| ()).unwrap().is_some())
    });
    // The recorder looks once a second.
    std::thread::sleep(Duration::from_secs(2));
    assert_eq!((sensor.end(), recorder.end()), (Some(0), Some(0)));
    for name in ["recorder.log", "sensor.log"] {
        let said = std::fs::read_to_string(log(name)).unwrap();
        let warnings: Vec<&str> = said.lines().filter(|line| line.contains("its 1 processes")).collect();
        assert!(matches!(*warnings, [only] if only.contains("`processes` of [bus]")), "{said}");
        assert!(!said.contains("Traceback"), "{said}");
    }
    let report = info(&log("run.mcap")).unwrap();
    let channel = report.channels.iter().find(|channel| channel.name == "sensor/example");
    assert!(channel.expect("the channel is recorded").messages >= 10);
}

#[test]
fn the_template_is_recorded_whole_under_its_own_field_names() {
    let (domain, folder) = (Domain::for_test(), tempfile::tempdir().unwrap());
    // Fewer places than the sensor would reserve by itself.
    domain.set_processes(64).unwrap();
    let bus = Bus::join(&domain, "test").unwrap();
    let mut beats = bus.subscriber::<Heartbeat>("system/heartbeat/recorder").unwrap();
    let mut recorder = recorder(&domain, folder.path(), Stdio::null(), &mut beats);
    let (done, said) = new_sensor(folder.path(), &["example"]);
    // The command that plugs it in.
    assert!(done && said.contains("nims plug example -- "), "{said}");
    let start = || {
        Guard(
            Command::new(python())
                .arg(folder.path().join("example.py"))
                .args(["--shared-memory", "--domain", domain.name()])
                .spawn()
                .unwrap(),
        )
    };
    let count = || bus.tap("sensor/example").ok();
    // One life, and a second one: a replaced sensor continues on the same channel.
    for _ in 0..2 {
        let mut sensor = start();
        let mut heard = 0;
        let mut tap = None;
        until("the sensor publishes", || {
            tap = tap.take().or_else(count);
            if let Some(tap) = &mut tap {
                while tap.receive(|_| ()).unwrap().is_some() {
                    heard += 1;
                }
            }
            heard >= 5
        });
        assert_eq!(sensor.end(), Some(0));
    }
    assert_eq!(recorder.end(), Some(0));

    let path = folder.path().join("run.mcap");
    let report = info(&path).unwrap();
    let channel =
        report.channels.iter().find(|channel| channel.name == "sensor/example").expect("the channel is recorded");
    assert_eq!(channel.schema, "nims_msgs/msg/Example");
    assert!(channel.messages >= 10, "{}", channel.messages);
    // An independent reader sees its names, and in both lives every sample from within the first second on.
    let script = "import sys\nfrom mcap.reader import make_reader\nfrom mcap_ros2.decoder import DecoderFactory\n\
        r = make_reader(open(sys.argv[1], 'rb'), decoder_factories=[DecoderFactory()])\n\
        for _, _, _, m in r.iter_decoded_messages(topics=['/sensor/example']): print(m.header.seq, round(10 * m.value_v), list(m.samples)[3])";
    let output = Command::new(python()).args(["-c", script]).arg(&path).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut last = 0;
    let mut lives = 0;
    for line in said.lines() {
        let numbers: Vec<f64> = line.split_whitespace().map(|number| number.parse().unwrap()).collect();
        let seq = numbers[0] as u64;
        if lives == 0 || seq < last {
            lives += 1;
            assert!(seq <= 10, "{said}");
        } else {
            assert_eq!(seq, last + 1, "{said}");
        }
        assert_eq!((numbers[1], numbers[2]), (seq as f64 - 1.0, seq as f64 + 2.0));
        last = seq;
    }
    assert_eq!(lives, 2, "{said}");
}

#[test]
fn type_definitions_from_python_equal_those_of_rust() {
    let output = Command::new(python()).arg(project().join("tests/python/sensor_types.py")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let (type_name, rest) = said.split_once('\n').unwrap();
    let (definition, refusals) = rest.split_at(rest.find("refused").unwrap());
    // Parsed with the parser that the recorder uses to validate plug-ins.
    let schema = messages::schema::Schema::parse(definition).unwrap();
    assert_eq!(schema.size(), 48 + 64 + 8 + 2 + 6);
    assert!(schema.has_header());
    assert!(
        definition.contains("# A spot.\n")
            && definition.contains("# Time since the measurement, s.\nfloat64 latency_s")
    );
    assert_eq!(type_name, format!("nims_msgs/Spot/{:08x}", hash_of(&messages::schema::without_comments(definition))));
    // The gateway, to which it would be declared, makes the same type of it.
    let declared = messages::Declaration::new("Spot", definition).unwrap();
    assert_eq!((declared.type_name(), declared.size()), (type_name, schema.size()));
    // The field and the type.
    assert!(refusals.contains("`value`") && refusals.contains("`Hidden`"), "{refusals}");
    assert!(refusals.contains("`class`") && refusals.contains("`Foreign.a`"), "{refusals}");
    assert!(!refusals.contains("accepted"), "{refusals}");
}

#[test]
fn fields_with_awkward_names_and_numbers_are_refused_or_read_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let script = project().join("tests/python/check_fields.py");
    let output = Command::new(python()).arg(script).arg(folder.path()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
