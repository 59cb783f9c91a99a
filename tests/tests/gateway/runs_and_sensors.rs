//! Deaths, finished runs, plug-ins and the example of the page.

use crate::rig::{Gateway, LONG, OWNER, nims, told};
use crate::robot::{Robot, program};
use bus::clock;
use gateway_protocol::{Accepted, Call, Published, ReadingQuality, Reply};
use messages::{MotorAuthority, Request, text_of};
use rustix::process::Signal;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

#[test]
fn the_gateway_outlives_the_robot_and_its_own_death_stops_nothing() {
    let mut robot = Robot::up("");
    robot.arm();
    let mut gateway = Gateway::joined(&robot, OWNER);
    robot.fly();
    // Killed in flight: the motion continues, and the next gateway finds the robot.
    gateway.kill();
    robot.for_cycles(50);
    assert_ne!(robot.last.mode, MotorAuthority::MODE_STOPPING);
    drop(gateway);
    let mut gateway = Gateway::joined(&robot, OWNER);
    let mut client = gateway.client();
    assert_eq!(client.ask(Request::Stop).1, Accepted::Accepted);
    client.call(&Call::Subscribe { id: 4, channel: "motor/authority".to_owned(), rate_hz: Some(5.0) });
    // The robot without its supervisor is still stopped through the gateway.
    robot.down(Signal::KILL);
    let (_, accepted) = client.ask(Request::Estop);
    assert_eq!(accepted, Accepted::Accepted);
    robot.until("emergency stop", |robot| robot.last.mode == MotorAuthority::MODE_EMERGENCY_STOP);
    for node in robot.domain.alive() {
        if !["gateway", "observer"].contains(&node.name.as_str()) {
            robot.signal(&node.name, Signal::KILL);
        }
    }
    gateway.until("no robot runs", |gateway| gateway.client().ask(Request::Arm).0 == 452);
    // The remains of its socket are no motor-io either.
    assert!(matches!(client.ask(Request::Estop).0, 452 | 455));
    assert!(matches!(client.call(&Call::Robot { id: 1 }), Reply::Robot { robot: None, .. }));
    // The next life, on the same connection: requests and the subscription go on.
    robot.up_again("");
    gateway.until_joined();
    client.ask(Request::Reset);
    let life = robot.last.header.life;
    let give_up = clock::now_ns() + LONG.as_nanos() as u64;
    loop {
        let (reply, body) = client.next().unwrap();
        if let Reply::Sample { id: 4, .. } = reply
            && bytemuck::pod_read_unaligned::<MotorAuthority>(&body).header.life == life
        {
            break;
        }
        assert!(clock::now_ns() < give_up);
    }
    assert_eq!(client.ask(Request::Arm).1, Accepted::Accepted);
    assert!(gateway.lives());
    // An orderly end leaves nothing behind, although the gateway was on the bus.
    robot.down(Signal::INT);
    gateway.until("no robot runs", |gateway| gateway.client().ask(Request::Arm).0 == 452);
}

#[test]
fn a_finished_run_is_fetched_whole_and_only_a_finished_one() {
    let mut robot = Robot::up("");
    robot.for_cycles(100);
    let run = robot.run().file_name().unwrap().to_str().unwrap().to_owned();
    let gateway = Gateway::joined(&robot, OWNER);
    let home = tempfile::tempdir().unwrap();
    let refused = nims(&gateway, home.path(), &["fetch", &run]);
    assert_eq!(refused.status.code(), Some(2), "{}", String::from_utf8_lossy(&refused.stderr));
    robot.down(Signal::INT);
    gateway.until("the run is finished", |gateway| told(gateway, home.path(), &["runs"]).contains(&run));
    told(&gateway, home.path(), &["fetch", &run, "copy"]);
    let same = |name: &str| {
        std::fs::read(robot.run().join(name)).unwrap() == std::fs::read(home.path().join("copy").join(name)).unwrap()
    };
    assert!(same("run.mcap") && same("manifest.json") && same("log/motor-io.txt"));
    // A report from the copy needs no robot; one of a closed folder is made through the gateway, and is the same.
    let from_copy = told(&gateway, home.path(), &["info", "copy"]);
    assert!(from_copy.contains("motor/input"), "{from_copy}");
    let contents = |text: &str| text.lines().filter(|line| !line.starts_with("file ")).collect::<Vec<_>>().join("\n");
    assert_eq!(contents(&told(&gateway, home.path(), &["info", &run])), contents(&from_copy));
    told(&gateway, home.path(), &["report", &run]);
    let page = std::fs::read_to_string(home.path().join(format!("{run}.html"))).unwrap();
    assert!(page.contains("<html") && !robot.run().join("report.html").exists());
    let refused = nims(&gateway, home.path(), &["info", "no-such-run"]);
    assert_eq!(refused.status.code(), Some(2), "{}", String::from_utf8_lossy(&refused.stderr));
    for name in ["../state", "..", "/etc", "no-such-run"] {
        let refused = nims(&gateway, home.path(), &["fetch", name, "other"]);
        assert_eq!(refused.status.code(), Some(2), "{name}");
    }
    assert!(!home.path().join("other").exists());
    told(&gateway, home.path(), &["fetch", &run, "."]);
    assert!(home.path().join(&run).join("run.mcap").is_file());
    assert_eq!(nims(&gateway, home.path(), &["fetch", &run, "."]).status.code(), Some(2), "it is there already");
}

/// A client that connects, publishes and closes in a loop: the channel stays the same one, and is not taken without
/// end.
fn a_connection_for_each_reading_makes_no_further_channel(robot: &Robot, gateway: &Gateway) {
    let objects = || {
        let names = std::fs::read_dir("/dev/shm").unwrap().map(|entry| entry.unwrap().file_name());
        names.filter(|name| name.to_string_lossy().starts_with(robot.domain.prefix())).count()
    };
    let (before, mut taken, mut refused) = (objects(), 0, 0);
    for _ in 0..200 {
        let reading = Published {
            sensor: "soil".to_owned(),
            values: vec![Some(1.0), None],
            quality: ReadingQuality::Good,
            age_s: None,
        };
        match gateway.client().call(&Call::Publish { id: 3, reading }) {
            Reply::Done { .. } => taken += 1,
            // The connection before it is just being closed; too many takes; too many readings.
            Reply::Answer { reason: 466 | 467 | 473, .. } => refused += 1,
            other => panic!("{other:?}"),
        }
    }
    assert!(taken >= 1 && refused >= 1, "{taken} taken, {refused} refused");
    // Each channel has several objects in shared memory; other processes may make a few meanwhile.
    assert!(before > 20 && objects() < before + 10, "{before} objects before, {} after", objects());
}

/// A plug-in in Python, which knows nothing but the socket: its readings are a channel as that of any sensor.
#[test]
fn a_plug_in_publishes_through_the_gateway() {
    let mut robot = Robot::up("");
    robot.arm();
    let declared = "[[plugin]]\nname = \"soil\"\nquantity = [\"moisture\", \"temperature\"]\nunit = [\"%\", \"°C\"]\nrate_hz = 50.0\nlever_m = [0.0, 0.0, -0.5]\n";
    let gateway = Gateway::joined(&robot, declared);
    let script = "import nims_gateway\nwith nims_gateway.Sensor() as sensor:\n    sent = 0\n    while sent < 20:\n        sent += \
                  sensor.send([sent, None], age_s=0.25)\n        nims_gateway.time.sleep(0.05)\n    try:\n        \
                  sensor.send([1.0])\n    except nims_gateway.Refused as refused:\n        print(refused.reason, refused)\n";
    let mut readings = robot.bus.subscriber::<messages::Reading>("sensor/soil").unwrap();
    let python = std::env::var("NIMS_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let mut plugin = Command::new(python);
    plugin.args(["-c", script]).env("PYTHONPATH", crate::robot::root().join("scripts/python")).env("NIMS_NAME", "soil");
    plugin.env("NIMS_GATEWAY", &gateway.socket).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut plugin = plugin.spawn().unwrap();
    let mut values = Vec::new();
    while plugin.try_wait().unwrap().is_none() {
        while let Some(reading) = readings.receive().unwrap() {
            assert!(reading.count == 2 && reading.value[1].is_nan() && reading.lever_m == [0.0, 0.0, -0.5]);
            assert_eq!(reading.header.stamp_ns - reading.header.oldest_input_ns, 250_000_000);
            let words = (text_of(&reading.quantity), text_of(&reading.unit));
            assert_eq!(words, ("moisture,temperature".to_owned(), "%,°C".to_owned()));
            values.push(reading.value[0]);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let output = plugin.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success() && said.starts_with("456 "), "{said}{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(values, (0..20).map(f64::from).collect::<Vec<_>>());
    a_connection_for_each_reading_makes_no_further_channel(&robot, &gateway);
    // Without systemd it says so; nothing is started as the robot's user instead.
    if !Path::new("/run/systemd/system").exists() {
        let start = Request::StartProcess { name: "soil".to_owned(), slot: None, law: None };
        assert_eq!(gateway.client().ask(start).0, 471);
    }
    robot.down(Signal::INT);
    let listed = Command::new(program()).args(["info", robot.run().to_str().unwrap()]).output().unwrap();
    let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
    assert!(listed.contains("sensor/soil"), "{listed}");
}

#[test]
fn the_example_of_the_page_speaks_with_the_gateway() {
    let mut robot = Robot::up("");
    robot.arm();
    let gateway = Gateway::joined(&robot, OWNER);
    let page = std::fs::read_to_string(crate::robot::root().join("docs/gateway.md")).unwrap();
    let example = page.split("```python\n").nth(1).unwrap().split("```").next().unwrap();
    let python = std::env::var("NIMS_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let output = Command::new(python).args(["-c", example]).arg(&gateway.socket).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(said.contains("holding") && said.matches("cycle ").count() >= 3, "{said}");
    // Its text has no more lines than a page.
    assert!(example.lines().count() <= 60);
}
