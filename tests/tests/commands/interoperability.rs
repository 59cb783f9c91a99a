//! Independent readers get every field of a run file exactly: from a file written directly, and from a live recording.

use nims_tests::python;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use bus::clock::now_ns;
use bus::{Bus, Domain};
use messages::schema::{Number, Primitive, Schema};
use messages::{
    ControlStatus, Energy, Field, FieldMap, Header, Heartbeat, LogEvent, Message, MotorAuthority, MotorCommand,
    MotorInput, MotorSlots, MotorState, NodeEstimate, OperatorRequest, PlanMotion, PlanStatus, ProcessState, Reading,
    RecorderGap, RecorderStatus, Sample, SystemConfig, TruthNode, put_text, schema_name,
};
use runlog::{ChannelSpec, RunClock, RunWriter, info};
use serde_json::{Value, json};

/// Set if there is no JavaScript: its readers are then left out.
const WITHOUT_NODE: &str = "NIMS_WITHOUT_NODE";
/// The program `rerun`; if it is set, its checker verifies the files too.
const RERUN: &str = "NIMS_RERUN";

/// A generator of test data that needs no crate (xorshift64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn sample<T: Message>(&mut self, seq: u64, stamp_ns: u64) -> T {
        let mut sample = T::zeroed();
        for byte in bytemuck::bytes_of_mut(&mut sample) {
            *byte = self.next() as u8;
        }
        // a signalling NaN becomes a quiet one in a reader that widens it to its number type
        let schema = Schema::parse(T::schema()).ok();
        let fields = schema.iter().flat_map(|schema| schema.fields());
        for field in fields.filter(|field| field.primitive == Primitive::Float32) {
            let bytes = &mut bytemuck::bytes_of_mut(&mut sample)[field.offset..field.offset + field.size()];
            for number in bytes.chunks_exact_mut(4) {
                if f32::from_le_bytes(number.try_into().unwrap()).is_nan() {
                    number[2] |= 0x40;
                }
            }
        }
        let header = sample.header_mut();
        (header.seq, header.stamp_ns) = (seq, stamp_ns);
        sample
    }
}

/// The published samples: per topic the type and the value of every field.
#[derive(Default)]
struct Expected(BTreeMap<String, Value>);

impl Expected {
    fn add(&mut self, channel: &str, type_name: &str, schema: &str, sample: &[u8], times: Option<(u64, u64)>) {
        let schema = Schema::parse(schema).unwrap();
        let fields: Vec<Value> = schema
            .decode(sample)
            .map(|(field, value)| {
                let bits = |number| match number {
                    Number::Unsigned(value) => json!(value),
                    Number::Signed(value) => json!(value),
                    Number::Float32(value) => json!(value.to_bits()),
                    Number::Float64(value) => json!(value.to_bits()),
                };
                json!([field.path, field.primitive.name(), value.numbers().map(bits).collect::<Vec<_>>()])
            })
            .collect();
        let mut entry = json!({ "fields": fields });
        if let Some((log_time, publish_time)) = times {
            entry["log_time"] = json!(log_time);
            entry["publish_time"] = json!(publish_time);
        }
        let known = self
            .0
            .entry(format!("/{channel}"))
            .or_insert_with(|| json!({ "schema": schema_name(type_name).unwrap(), "samples": [] }));
        known["samples"].as_array_mut().unwrap().push(entry);
    }

    /// Adds fields by hand, so that their positions are also checked independently of the parser of definitions.
    fn spot(&mut self, channel: &str, spots: Vec<Value>) {
        let samples = self.0.get_mut(&format!("/{channel}")).unwrap()["samples"].as_array_mut().unwrap();
        samples.last_mut().unwrap()["fields"].as_array_mut().unwrap().extend(spots);
    }
}

/// Runs the independent readers and compares.
fn compare(run: &Path, expected: &Expected) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = python();
    let file = run.with_extension("expected.json");
    fs::write(&file, serde_json::to_vec(&expected.0).unwrap()).unwrap();
    let output = Command::new(&python).arg(root.join("python/read_run.py")).arg(run).arg(&file).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(said.lines().filter(|line| line.ends_with("fields equal")).count(), 3, "{said}");
    // The readers of Foxglove and Lichtblick; scripts/test installs them, and reports it if there is no JavaScript.
    if std::env::var_os(WITHOUT_NODE).is_none() {
        assert!(
            root.join("node/node_modules").exists(),
            "no JavaScript readers: run scripts/test, or: npm ci --prefix tests/node; {WITHOUT_NODE}=1 does without them"
        );
        let output = Command::new("node").arg(root.join("node/read_run.mjs")).arg(run).arg(&file).output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
        assert!(said.trim().ends_with("fields equal"), "{said}");
    } else {
        notes::left_out("run files as JavaScript reads them", format_args!("{WITHOUT_NODE} is set"));
    }
    // `pip install rerun-sdk` downloads 170 MB, so its checker of the format runs only if it is installed.
    if let Some(rerun) = std::env::var_os(RERUN) {
        let output = Command::new(rerun).args(["mcap", "check"]).arg(run).output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
        let channels = said.lines().filter(|line| line.starts_with("ok ")).count();
        assert!(channels >= expected.0.len(), "{channels} of {} channels are ok:\n{said}", expected.0.len());
    } else {
        notes::left_out("run files by the checker of rerun", format_args!("{RERUN} does not name the program rerun"));
    }
    // The project's reader for analysts, which extracts samples by the index instead of decoding them.
    let output = Command::new(&python).arg(root.join("python/check_reader.py")).arg(run).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    assert!(said.contains(" samples on "), "{said}");
}

fn write_some<T: Message>(
    writer: &mut RunWriter,
    clock: RunClock,
    random: &mut Random,
    expected: &mut Expected,
    channel: &str,
) {
    let id = writer.add_channel(&ChannelSpec::for_type::<T>(channel)).unwrap();
    for seq in 1..=5 {
        let stamp_ns = clock.t0_mono_ns + seq * 1_000_003;
        let sample: T = random.sample(seq, stamp_ns);
        let bytes = bytemuck::bytes_of(&sample);
        writer.write(id, seq, stamp_ns + 77, stamp_ns, bytes).unwrap();
        let times = (clock.unix_of(stamp_ns + 77), clock.unix_of(stamp_ns));
        expected.add(channel, T::type_name(), T::schema(), bytes, Some(times));
    }
}

#[test]
fn every_type_of_the_table_is_read_field_by_field() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let clock = RunClock { t0_unix_ns: 1_700_000_000_123_456_789, t0_mono_ns: 86_400_000_000_000 };
    let mut writer = RunWriter::create(&path, clock, &BTreeMap::new(), &[]).unwrap();
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let mut expected = Expected::default();
    macro_rules! write_all {
        ($($channel:literal: $type:ty),*) => {
            $( write_some::<$type>(&mut writer, clock, &mut random, &mut expected, $channel); )*
        };
    }
    write_all!("motor/state": MotorState, "motor/authority": MotorAuthority, "motor/input": MotorInput, "motor/slots": MotorSlots,
        "motor/command/a": MotorCommand, "motor/command/b": MotorCommand, "node/estimate/a": NodeEstimate,
        "plan/motion": PlanMotion, "plan/status": PlanStatus, "control/status/a": ControlStatus,
        "operator/request": OperatorRequest, "sensor/wind": Reading, "sample/wind": Sample, "map/wind": FieldMap, "energy": Energy,
        "system/heartbeat/motor-io": Heartbeat, "system/log/motor-io": LogEvent, "system/process": ProcessState,
        "system/config/motor-io": SystemConfig,
        "recorder/status": RecorderStatus, "recorder/gap": RecorderGap, "truth/node": TruthNode);

    let mut input = MotorInput::default();
    input.header.seq = 6;
    input.command[1].velocity_m_s[3] = -0.125;
    input.unit[2] = MotorInput::UNIT_RESYNC;
    input.counts[7] = -9;
    let id = writer.add_channel(&ChannelSpec::for_type::<MotorInput>("motor/input")).unwrap();
    writer.write(id, 6, clock.t0_mono_ns, clock.t0_mono_ns, bytemuck::bytes_of(&input)).unwrap();
    let type_name = MotorInput::type_name();
    expected.add("motor/input", type_name, MotorInput::schema(), bytemuck::bytes_of(&input), None);
    expected.spot(
        "motor/input",
        vec![
            json!(["command[1].velocity_m_s[3]", "float64", [(-0.125_f64).to_bits()]]),
            json!(["unit", "uint8", [0, 0, MotorInput::UNIT_RESYNC, 0, 0, 0, 0, 0]]),
            json!(["counts[7]", "int64", [-9]]),
            json!(["header.seq", "uint64", [6]]),
        ],
    );
    // readers give samples in the order of their log time, so this one, the earliest, comes first
    let samples = expected.0.get_mut("/motor/input").unwrap()["samples"].as_array_mut().unwrap();
    samples.rotate_right(1);
    writer.finish(&BTreeMap::new()).unwrap();
    compare(&path, &expected);
}

/// Declares a type of a foreign package.
macro_rules! foreign {
    ($name:ident, $size:literal, $schema:expr) => {
        #[repr(C)]
        #[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
        struct $name {
            header: Header,
            bytes: [u8; $size],
        }

        impl Field for $name {
            type Element = Self;
            const ROS: &'static str = concat!("my_lab/", stringify!($name));
        }

        impl Message for $name {
            const NAME: &'static str = stringify!($name);
            fn schema() -> &'static str {
                $schema
            }
            fn type_name() -> &'static str {
                concat!("my_lab/", stringify!($name), "/00000001")
            }
            fn header(&self) -> &Header {
                &self.header
            }
            fn header_mut(&mut self) -> &mut Header {
                &mut self.header
            }
        }
    };
}

foreign!(
    Spectrum,
    24,
    "# of a plug-in\nnims_msgs/Header header\nfloat32[4] band # V\nint16 gain\nuint8[6] pad0\n\
     ================================================================================\n\
     MSG: nims_msgs/Header\nuint64 life\nuint64 cycle\nuint64 seq\nuint64 stamp_ns\nuint64 published_ns\nuint64 oldest_input_ns\n"
);
foreign!(Broken, 8, "nims_msgs/Header header\nstring name\n");

/// A process that is killed when the test ends.
struct Recording(Child);

impl Drop for Recording {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn until(what: &str, mut done: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !done() {
        assert!(begin.elapsed() < Duration::from_secs(120), "{what}: not within two minutes");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// The history of a publisher ends with it, so it stays until everything is recorded.
#[must_use]
fn send<T: Message>(
    bus: &Bus,
    random: &mut Random,
    expected: &mut Expected,
    channel: &str,
    count: u64,
) -> bus::Publisher<T> {
    let mut publisher = bus.publisher::<T>(channel).unwrap();
    for seq in 1..=count {
        let mut sample: T = random.sample(seq, now_ns());
        publisher.send(&mut sample).unwrap();
        expected.add(channel, T::type_name(), T::schema(), bytemuck::bytes_of(&sample), None);
    }
    heard(bus, &mut publisher);
    publisher
}

/// A late subscriber gets the history at the publisher's next action.
fn heard<T: Message>(bus: &Bus, publisher: &mut bus::Publisher<T>) {
    until("the recorder listens", || bus.ports(publisher.channel()).is_ok_and(|(_, subscribers)| subscribers > 0));
    publisher.update_connections();
}

#[test]
fn a_live_recording_with_types_of_others_is_read_field_by_field() {
    let binary = std::env::current_exe().unwrap().parent().unwrap().join("../recorder");
    assert!(binary.exists(), "{}: build the processes first: cargo build --workspace", binary.display());
    let (domain, folder) = (Domain::for_test(), tempfile::tempdir().unwrap());
    let bus = Bus::join(&domain, "test").unwrap();
    let mut beats = bus.subscriber::<Heartbeat>("system/heartbeat/recorder").unwrap();
    let mut recording = Recording(
        Command::new(binary)
            .args(["--domain", domain.name(), "--run"])
            .arg(folder.path())
            .stderr(Stdio::null())
            .spawn()
            .unwrap(),
    );
    until("the recorder is ready", || {
        std::iter::from_fn(|| beats.receive().unwrap()).any(|beat| beat.state == Heartbeat::STATE_READY)
    });
    let mut random = Random(0x1234_5678_9abc_def1);
    let mut expected = Expected::default();
    let _states = send::<MotorState>(&bus, &mut random, &mut expected, "motor/state", 20);
    let _estimates = send::<NodeEstimate>(&bus, &mut random, &mut expected, "node/estimate/b", 20);
    let _motions = send::<PlanMotion>(&bus, &mut random, &mut expected, "plan/motion", 4);
    let _spectra = send::<Spectrum>(&bus, &mut random, &mut expected, "sensor/spectrum", 4);
    let mut log = LogEvent::default();
    put_text(&mut log.text, "höhe");
    log.header.stamp_ns = now_ns();
    let mut logs = bus.publisher::<LogEvent>("system/log/test").unwrap();
    logs.send(&mut log).unwrap();
    heard(&bus, &mut logs);
    expected.add("system/log/test", LogEvent::type_name(), LogEvent::schema(), bytemuck::bytes_of(&log), None);
    expected.spot("system/log/test", vec![json!(["text[1]", "uint8", [0xc3]]), json!(["text[4]", "uint8", [b'e']])]);
    // recorded as plain bytes, and harmless to the readers of everything else
    let mut broken: Broken = random.sample(1, now_ns());
    let mut publisher = bus.publisher::<Broken>("sensor/broken").unwrap();
    publisher.send(&mut broken).unwrap();
    heard(&bus, &mut publisher);

    let pid = recording.0.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &pid]).status().unwrap().success());
    assert_eq!(recording.0.wait().unwrap().code(), Some(0));

    let path = folder.path().join("run.mcap");
    let report = info(&path).unwrap();
    assert!(report.healthy, "{:?}", report.verdict);
    let found = report.channels.iter().find(|channel| channel.name == "sensor/broken").unwrap();
    assert_eq!((found.schema.as_str(), found.messages), ("nims_msgs/msg/Opaque56", 1));
    assert!(found.refused.as_ref().unwrap().contains("strings"));
    let opaque = "uint8[56] data\n";
    expected.add("sensor/broken", "nims_msgs/Opaque56", opaque, bytemuck::bytes_of(&broken), None);
    compare(&path, &expected);
}
