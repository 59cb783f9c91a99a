//! An independent client receives every channel live and bit-exact, and does not disturb other processes.

#![allow(clippy::unwrap_used, clippy::expect_used)]

mod support;

use std::path::Path;
use std::process::{ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use bus::clock::now_ns;
use bus::{Bus, Domain, TestDomain};
use messages::ros::{Payload, TfMessage};
use messages::schema::{Number, Schema};
use messages::{Field, Header, Message, MotorInput, MotorState, Reading, schema_name};
use serde_json::{Map, Value, json};
use support::{LONG, Lines, Running, start, stop, until};

/// Number of different samples of each channel; they are published repeatedly.
const SAMPLES: u64 = 100;

/// A foreign type with a schema that readers reject: served as plain bytes.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Broken {
    header: Header,
    bytes: [u8; 8],
}

impl Field for Broken {
    type Element = Self;
    const ROS: &'static str = "my_lab/Broken";
}

impl Message for Broken {
    const NAME: &'static str = "Broken";
    fn schema() -> &'static str {
        "nims_msgs/Header header\nstring name\n"
    }
    fn type_name() -> &'static str {
        "my_lab/Broken/00000001"
    }
    fn header(&self) -> &Header {
        &self.header
    }
    fn header_mut(&mut self) -> &mut Header {
        &mut self.header
    }
}

fn address(said: &Lines) -> String {
    let line = said.until("open ws://");
    let address = line.split("open ").nth(1).unwrap().split(['\u{1b}', ' ']).next().unwrap().to_owned();
    assert!(address.starts_with("ws://127.0.0.1:"), "not this machine alone: {line}");
    address
}

/// Fills bytes with pseudo-random test data (xorshift64).
fn fill(bytes: &mut [u8], random: &mut u64) {
    for byte in bytes {
        *random ^= *random << 13;
        *random ^= *random >> 7;
        *random ^= *random << 17;
        *byte = *random as u8;
    }
}

fn samples<T: Message>(random: &mut u64) -> Vec<T> {
    let make = |cycle| {
        let mut sample = T::zeroed();
        fill(bytemuck::bytes_of_mut(&mut sample), random);
        *sample.header_mut() = Header { cycle, oldest_input_ns: cycle + 7, ..Header::at(now_ns()) };
        sample
    };
    (1..=SAMPLES).map(make).collect()
}

/// Fields that the publisher fills in.
const BY_PUBLISHING: [&str; 2] = ["header.seq", "header.published_ns"];

/// The samples that a tool must receive from a channel, without the fields that the publisher fills in.
fn expect<T: Message>(samples: &[T], enough: u64) -> Value {
    let schema = Schema::parse(T::schema()).unwrap();
    let fields = |sample: &T| -> Vec<Value> {
        let bits = |number| match number {
            Number::Unsigned(value) => json!(value),
            Number::Signed(value) => json!(value),
            Number::Float32(value) => json!(value.to_bits()),
            Number::Float64(value) => json!(value.to_bits()),
        };
        let all = schema.decode(bytemuck::bytes_of(sample));
        let all = all.filter(|(field, _)| !BY_PUBLISHING.contains(&field.path.as_str()));
        all.map(|(field, value)| {
            json!([field.path, field.primitive.name(), value.numbers().map(bits).collect::<Vec<_>>()])
        })
        .collect()
    };
    let all: Map<String, Value> =
        samples.iter().map(|sample| (sample.header().cycle.to_string(), json!(fields(sample)))).collect();
    json!({ "type": schema_name(T::type_name()).unwrap(), "definition": T::schema(), "key": "header.cycle",
            "enough": enough, "samples": all })
}

/// A transform, with its CDR body written by hand.
fn transform() -> (TfMessage, Value) {
    let mut body = vec![];
    for number in [1_u32, 1_700_000_000, 123_456_789, 4] {
        body.extend(number.to_le_bytes());
    }
    body.extend(b"map\0");
    body.extend(5_u32.to_le_bytes());
    body.extend(b"node\0\0\0\0");
    let numbers = [1.25, -2.5, 3.0625, 0.0, 0.0, 0.6, 0.8];
    numbers.iter().for_each(|number: &f64| body.extend(number.to_le_bytes()));
    body.resize(size_of::<TfMessage>(), 0);
    let mut fields = vec![json!(["transforms[0].header.stamp.sec", "int32", [1_700_000_000]])];
    let at = "transforms[0].transform";
    for (name, value) in
        ["translation.x", "translation.y", "translation.z", "rotation.x", "rotation.y", "rotation.z", "rotation.w"]
            .into_iter()
            .zip(numbers)
    {
        fields.push(json!([format!("{at}.{name}"), "float64", [value.to_bits()]]));
    }
    let expected = json!({ "type": "tf2_msgs/msg/TFMessage", "definition": TfMessage::schema(), "key": null,
                           "enough": 20, "samples": { "": fields } });
    (TfMessage::from_body(&body).unwrap(), expected)
}

fn subscribers(bus: &Bus, channel: &str) -> usize {
    bus.ports(channel).unwrap().1
}

#[test]
fn a_tool_receives_every_channel_live_and_bit_exact_without_disturbing_others() {
    let client = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/node/read_live.mjs");
    assert!(
        client.with_file_name("node_modules").is_dir(),
        "there is no JavaScript client: npm ci --prefix tests/node, or scripts/viewer --test"
    );
    let (domain, folder): (TestDomain, _) = (Domain::for_test(), tempfile::tempdir().unwrap());
    let bus = Bus::join(&domain, "test").unwrap();
    let mut random = 0x9e37_79b9_7f4a_7c15;
    let (states, inputs): (Vec<MotorState>, Vec<MotorInput>) = (samples(&mut random), samples(&mut random));
    let mut readings: Vec<Reading> = samples(&mut random);
    readings.truncate(1);
    let mut state_port = bus.publisher::<MotorState>("motor/state").unwrap();
    let mut wind_port = bus.publisher::<Reading>("sensor/wind").unwrap();
    // Published once before the viewer starts; tools that connect later receive it too.
    wind_port.send(&mut readings[0]).unwrap();
    let (viewer, said) = start(&domain, &[]);
    let address = address(&said);
    // These channels are created after the start of the viewer.
    let mut input_port = bus.publisher::<MotorInput>("motor/input").unwrap();
    let mut tf_port = bus.publisher::<TfMessage>("tf").unwrap();
    let mut broken_port = bus.publisher::<Broken>("sensor/broken").unwrap();

    let (mut tf, tf_expected) = transform();
    let mut broken = Broken { header: Header::default(), bytes: *b"whatever" };
    let opaque = json!({ "type": "nims_msgs/msg/Opaque56", "definition": "uint8[56] data\n", "key": null, "enough": 5,
                         "samples": { "": [[format!("data[{}]", size_of::<Header>()), "uint8", [b'w']]] } });
    let expected = json!({
        "/motor/state": expect(&states, 150), "/motor/input": expect(&inputs, 20),
        "/sensor/wind": expect(&readings, 1), "/tf": tf_expected, "/sensor/broken": opaque,
    });
    let file = folder.path().join("expected.json");
    std::fs::write(&file, expected.to_string()).unwrap();
    assert_eq!(subscribers(&bus, "motor/state"), 0, "no tool is connected yet");

    let mut tool = Running(
        Command::new("node")
            .arg(client)
            .args([&address, file.to_str().unwrap()])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap(),
    );
    let tool_said: ChildStdout = tool.0.stdout.take().unwrap();
    let tool_said = Lines::read(tool_said);
    tool_said.until("looking");
    until("the viewer listens", || {
        wind_port.update_connections();
        subscribers(&bus, "motor/state") == 1
    });
    let (mut published, begun) = (0_u64, Instant::now());
    let mut pass = 0_usize;
    while tool.0.try_wait().unwrap().is_none() {
        assert!(begun.elapsed() < LONG, "the tool does not end");
        // Ten times the rate that the viewer forwards.
        state_port.send(&mut states[pass % states.len()].clone()).unwrap();
        published += 1;
        if pass.is_multiple_of(25) {
            input_port.send(&mut inputs[pass / 25 % inputs.len()].clone()).unwrap();
            tf_port.send(&mut tf).unwrap();
            broken_port.send(&mut broken).unwrap();
            wind_port.update_connections();
        }
        pass += 1;
        std::thread::sleep(Duration::from_millis(2));
    }
    let line = tool_said.until("topics equal");
    assert!(tool.0.wait().unwrap().success(), "{line}");
    let counts: Value = serde_json::from_str(line.split("samples: ").nth(1).unwrap()).unwrap();
    let seen = counts["/motor/state"].as_u64().unwrap();
    assert!(2 * seen < published, "thinned: {seen} of {published}");
    println!("{line}; {published} of motor/state published");

    until("the viewer unsubscribes", || subscribers(&bus, "motor/state") == 0);
    stop(viewer);
}

#[test]
fn an_address_in_use_is_an_error_of_one_sentence() {
    let domain = Domain::for_test();
    let (viewer, said) = start(&domain, &[]);
    let address = address(&said);
    let port = address.rsplit(':').next().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_viewer"))
        .args(["--domain", domain.name(), "--name", "other", "--port", port])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains(&format!("port {port}")) && text.contains("--port"), "{text}");
    stop(viewer);
}
