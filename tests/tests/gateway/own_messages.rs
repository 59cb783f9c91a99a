//! Sensors in Python without packages, which declare messages of their own: plugged in and out of a robot in flight.

use crate::rig::{Client, Gateway, OWNER};
use crate::robot::{Robot, program, root};
use bus::{Bus, Domain, clock};
use gateway_protocol::{Accepted, Call, Reply};
use messages::{Declaration, Header, Message, MotorAuthority, Request};
use rustix::process::Signal;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, SystemTime};

messages::message! {
    /// A reading of the device.
    pub struct Soil {
        header: Header,
        /// Voltage of the probe, V.
        value_v: f64,
        /// The last four counts.
        samples: [f64; 4],
    }
}

/// A folder whose module `iceoryx2` cannot be imported, whatever the interpreter has.
fn without_packages(folder: &Path) -> String {
    let block = folder.join("block");
    std::fs::create_dir_all(&block).unwrap();
    std::fs::write(block.join("iceoryx2.py"), "raise ImportError('a sensor needs no package')\n").unwrap();
    format!("PYTHONPATH={}", block.display())
}

/// The next samples of a channel, from the first one of a new life of its sensor on.
fn samples(robot: &mut Robot, channel: &str, count: usize) -> Vec<Soil> {
    let mut subscriber = robot.bus.subscriber::<Soil>(channel).unwrap();
    let mut found: Vec<Soil> = Vec::new();
    let give_up = clock::now_ns() + 60_000_000_000;
    while found.len() < count {
        assert!(clock::now_ns() < give_up, "{channel}: {} samples\n{}", found.len(), robot.printed());
        robot.for_cycles(5);
        while let Some(sample) = subscriber.receive().unwrap() {
            // The value of a new life begins at 0.
            if found.last().is_some_and(|last| sample.value_v < last.value_v) {
                found.clear();
            }
            found.push(sample);
        }
    }
    found
}

/// A sensor and a gateway as `nims new-sensor` prints them, with nothing but Python.
#[test]
fn a_new_sensor_is_plugged_in_and_out_in_flight_and_recorded_with_its_units() {
    let mut robot = Robot::up("");
    robot.arm();
    let written = robot.accepted(&["new-sensor", "soil"]);
    assert!(written.contains("nims plug soil -- python3 soil.py") && written.contains("nims plug gateway -- gateway"));
    let (python, packages) = ("python3", without_packages(robot.folder()));
    // Without a gateway it says so and ends, and the robot goes on.
    robot.nims(&["plug", "leaf", "--", "env", &packages, python, "soil.py"]);
    robot.until_reported("the sensor has ended", |robot| robot.state("leaf") == "DIED");
    assert!(robot.printed().contains("no gateway runs here"), "{}", robot.printed());
    robot.accepted(&["plug", "gateway", "--", "gateway"]);
    robot.until("the gateway has joined", |robot| robot.domain.gateway().is_some());
    robot.fly();

    robot.accepted(&["plug", "soil", "--", "env", &packages, python, "soil.py"]);
    let found = samples(&mut robot, "sensor/soil", 10);
    assert!(found.windows(2).all(|two| two[1].header.seq == two[0].header.seq + 1));
    for sample in &found {
        assert!(
            (sample.value_v - 0.1 * sample.samples[0]).abs() < 1e-9 && sample.samples[3] == sample.samples[0] + 3.0
        );
        assert!(sample.header.stamp_ns <= sample.header.published_ns && sample.header.stamp_ns > 0);
    }
    let info = robot.bus.channel("sensor/soil").unwrap().unwrap();
    // The class `Soil` that it wrote is the struct above.
    let declared = Declaration::new("Soil", info.schema.as_deref().unwrap()).unwrap();
    assert_eq!((declared.type_name(), info.type_name.as_str()), (Soil::type_name(), Soil::type_name()));
    let told = robot.accepted(&["channel", "info", "sensor/soil"]);
    assert!(told.contains("# Voltage of the probe, V.\nfloat64 value_v\n"), "{told}");
    assert!(robot.accepted(&["channel", "echo", "sensor/soil", "-n", "1"]).contains("\"value_v\":"));

    // Out, in again, and replaced by a new version.
    robot.accepted(&["unplug", "soil"]);
    robot.accepted(&["plug", "soil", "--", "env", &packages, python, "soil.py"]);
    samples(&mut robot, "sensor/soil", 5);
    robot.accepted(&["plug", "soil", "--replace", "--", "env", &packages, python, "soil.py"]);
    samples(&mut robot, "sensor/soil", 5);
    robot.accepted(&["unplug", "soil"]);
    assert_ne!(robot.last.mode, MotorAuthority::MODE_FAULTED);
    robot.down(Signal::INT);
    is_in_the_run_file(&robot);
}

/// The run file has its own definition with the comments, and every number; the report draws it.
fn is_in_the_run_file(robot: &Robot) {
    let report = runlog::info(&robot.run()).unwrap();
    let channel = report.channels.iter().find(|channel| channel.name == "sensor/soil").unwrap();
    assert_eq!((channel.schema.as_str(), channel.lost), ("nims_msgs/msg/Soil", 0));
    assert!(channel.messages >= 16, "{}", channel.messages);
    let python = nims_tests::python();
    let script = "import sys\nfrom mcap.reader import make_reader\nfrom mcap_ros2.decoder import DecoderFactory\n\
        r = make_reader(open(sys.argv[1], 'rb'), decoder_factories=[DecoderFactory()])\n\
        for s, _, _, m in r.iter_decoded_messages(topics=['/sensor/soil']): print(s.encoding, '# Voltage of the probe, V.' in s.data.decode(), round(10 * m.value_v - list(m.samples)[0], 6))";
    let file = robot.run().join("run.mcap");
    let output = Command::new(python).args(["-c", script]).arg(&file).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines.len() as u64, channel.messages);
    assert!(lines.iter().all(|line| ["ros2msg True 0.0", "ros2msg True -0.0"].contains(line)), "{said}");
    let drawn = Command::new(program()).arg("report").arg(robot.run()).output().unwrap();
    assert!(drawn.status.success(), "{}", String::from_utf8_lossy(&drawn.stderr));
    let page = std::fs::read_to_string(robot.run().join("report.html")).unwrap();
    assert!(page.contains("sensor/soil") && page.contains("value_v"));
}

fn declare(client: &mut Client, sensor: &str, message: &str, definition: &str) -> u16 {
    let call = Call::Declare { id: 3, sensor: sensor.to_owned(), message: message.to_owned() };
    reason(&client.call_with(&call, definition.as_bytes()))
}

fn reason(reply: &Reply) -> u16 {
    match reply {
        Reply::Done { .. } => 0,
        Reply::Answer { reason, .. } => *reason,
        other => panic!("{other:?}"),
    }
}

/// A declared channel is that of the struct, with whichever of both it begins, and keeps its type.
#[test]
fn a_declared_message_is_the_type_of_the_struct_and_does_not_change() {
    let mut robot = Robot::up("");
    robot.arm();
    let mut gateway = Gateway::joined(&robot, OWNER);
    assert_eq!(robot.domain.gateway().as_deref(), Some(gateway.socket.as_path()));
    let mut subscriber = robot.bus.subscriber::<Soil>("sensor/soil").unwrap();
    let mut client = gateway.client();
    assert_eq!(declare(&mut client, "soil", "Soil", Soil::schema()), 0);
    let sample = Soil { value_v: 1.5, ..Soil::default() };
    let publish = Call::Sample { id: 4, sensor: "soil".to_owned(), stamp_ns: None };
    assert_eq!(reason(&client.call_with(&publish, bytemuck::bytes_of(&sample))), 0);
    let received = subscriber.receive().unwrap().unwrap();
    assert_eq!((received.value_v, received.header.seq), (1.5, 1));
    // Other fields need another name, and the channels of the robot are out of reach.
    let mut second = gateway.client();
    let other = Soil::schema().replace("value_v", "value_a");
    drop(client);
    gateway.until("the first connection is closed", |gateway| {
        declare(&mut gateway.client(), "soil", "Soil", Soil::schema()) == 0
    });
    assert_eq!(declare(&mut second, "soil-2", "Soil", &other), 0);
    for (sensor, message) in [("soil", "Soil"), ("leaf", "MotorCommand"), ("../motor/command/a", "Soil")] {
        assert_eq!(declare(&mut gateway.client(), sensor, message, &other), 456, "{sensor} {message}");
    }
    // Any declarations, in the middle of a flight: refused, and nothing else happens.
    robot.fly();
    for number in 0..200_usize {
        let text: String = Soil::schema().chars().take(number * 3).collect();
        let refused = declare(&mut gateway.client(), "leaf", "Leaf", &text);
        assert!([0, 456].contains(&refused), "{refused}");
    }
    assert!(gateway.lives());
    assert_ne!(robot.last.mode, MotorAuthority::MODE_FAULTED);
    robot.down(Signal::INT);
}

/// The file of a channel in the folder of a domain.
fn channel_file(domain: &Domain, channel: &str) -> PathBuf {
    let (name, kind) = (format!("service_name = \"{channel}\""), "[messaging_pattern.PublishSubscribe]");
    let entries = std::fs::read_dir(domain.root().join("services")).unwrap();
    let mut files = entries.map(|entry| entry.unwrap().path());
    files
        .find(|path| std::fs::read_to_string(path).is_ok_and(|text| text.contains(&name) && text.contains(kind)))
        .unwrap()
}

/// Leaves a channel half made, as a process that is killed while it creates it, and young for ever.
fn half_made(robot: &Robot, channel: &str) -> PathBuf {
    // Where it would be: the names of a channel in two domains differ in their beginning.
    let other = Domain::for_test();
    let bus = Bus::join(&other, "other").unwrap();
    let known = "motor/authority";
    let _known = bus.publisher::<MotorAuthority>(known).unwrap();
    let declared = Declaration::new("Soil", Soil::schema()).unwrap();
    let quality = messages::quality_for(channel, declared.size());
    let _wanted = bus.declared_publisher(channel, &declared, quality).unwrap();
    let name = |domain: &Domain, channel: &str| {
        channel_file(domain, channel).file_name().unwrap().to_str().unwrap().to_owned()
    };
    let (here, there) = (name(&robot.domain, known), name(&other, known));
    let same = here.bytes().rev().zip(there.bytes().rev()).take_while(|(a, b)| a == b).count();
    let (here, there) = (&here[..here.len() - same], &there[..there.len() - same]);
    let own = name(&other, channel).strip_prefix(there).map(|rest| format!("{here}{rest}")).unwrap();
    let path = robot.domain.root().join("services").join(own);
    let file = std::fs::OpenOptions::new().write(true).create_new(true).mode(0o600).open(&path).unwrap();
    file.set_modified(SystemTime::now() + Duration::from_secs(3600)).unwrap();
    path
}

/// A channel that another process left half made is waited for, and nothing else waits: the gateway carries the stops.
#[test]
fn a_half_made_channel_delays_no_stop() {
    let mut robot = Robot::up("");
    robot.arm();
    let gateway = Gateway::joined(&robot, OWNER);
    let (mut sensor, mut person) = (gateway.client(), gateway.client());
    robot.fly();
    let half_made = half_made(&robot, "sensor/leaf");
    let declares = Call::Declare { id: 3, sensor: "leaf".to_owned(), message: "Soil".to_owned() };
    sensor.send(&declares, Soil::schema().as_bytes());
    // What is asked after it on the same connection is answered before it.
    sensor.send(&Call::Robot { id: 4 }, &[]);
    let (first, _) = sensor.next().unwrap();
    assert!(matches!(first, Reply::Robot { id: 4, .. }), "{first:?}");
    assert_eq!(person.ask(Request::Stop).1, Accepted::Accepted);
    robot.until("it holds", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
    let (second, _) = sensor.next().unwrap();
    assert!(matches!(second, Reply::Answer { id: 3, accepted: Accepted::Refused, .. }), "{second:?}");
    // Without it the sensor publishes.
    drop(sensor);
    std::fs::remove_file(half_made).unwrap();
    gateway.until("the channel is there", |gateway| {
        reason(&gateway.client().call_with(&declares, Soil::schema().as_bytes())) == 0
    });
    robot.down(Signal::INT);
}

/// Where nothing takes its samples, the module says what to do.
#[test]
fn the_module_names_the_way_out_without_a_gateway() {
    let folder = tempfile::tempdir().unwrap();
    let script = "import ctypes, nims_sensor\nclass Soil(nims_sensor.Sample):\n    _fields_ = [('a', ctypes.c_double, 'A, m.')]\n\
        for way in ({'gateway': '/nowhere.sock'}, {'domain': '/nowhere'}, {'shared_memory': True}):\n    try:\n        \
        with nims_sensor.Sensor('soil', Soil, **way) as sensor: print(sensor.send(a=1.0))\n    except nims_sensor.SensorError as error:\n        print(error)\n";
    let packages = without_packages(folder.path());
    let path = format!("{}:{}", packages, root().join("scripts/python").display());
    let output =
        Command::new("env").args([&path, "python3", "-c", script]).env_remove("NIMS_GATEWAY").output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let lines: Vec<&str> = said.lines().collect();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // Where the socket is missing it waits for it, because a gateway may be starting again.
    assert!(lines.len() == 3 && lines[0] == "False", "{said}");
    assert!(lines[1].contains("gateway") && lines[2].contains("iceoryx2"), "{said}");
}
