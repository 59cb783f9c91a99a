//! Exported tables (CSV, NumPy, Parquet) hold the content of the run files, checked with independent software, for a
//! run of several files with types that this project does not define.

use config::RecorderSection;
use messages::{Message, MotorInput, MotorState, NodeEstimate, OperatorRequest, TruthNode, put_text, schema_name};
use nims_tests::python;
use recorder::{Batch, ReceivedSample, Session, Settings};
use runlog::export::{ExportRequest, Format, export};
use runlog::{ChannelSpec, NotARunReason, RunClock, RunError};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

const SECOND: u64 = 1_000_000_000;

/// A generator of test data that needs no crate (xorshift64).
struct Random(u64);

impl Random {
    fn fill(&mut self, bytes: &mut [u8]) {
        for byte in bytes {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            *byte = self.0 as u8;
        }
    }
}

struct Writing {
    session: Session,
    random: Random,
    now_ns: u64,
}

impl Writing {
    /// One sample of random bytes behind a header, a tenth of a second after the one before.
    fn put<T: Message>(&mut self, channel: &str, seq: u64, finish: impl FnOnce(&mut T)) {
        let row = self.session.declare(ChannelSpec::for_type::<T>(channel));
        self.now_ns += SECOND / 10;
        let mut sample = T::zeroed();
        self.random.fill(bytemuck::bytes_of_mut(&mut sample));
        let header = sample.header_mut();
        (header.seq, header.stamp_ns) = (seq, self.now_ns);
        finish(&mut sample);
        self.record(row, seq, bytemuck::bytes_of(&sample));
    }

    fn record(&mut self, row: usize, seq: u64, sample: &[u8]) {
        let mut batch = Batch::default();
        batch.push(ReceivedSample { row, logged_ns: self.now_ns, stamp_ns: self.now_ns, seq, missing: 0 }, sample);
        self.session.write(&batch, self.now_ns, self.now_ns);
        self.session.tick(self.now_ns, None);
    }
}

/// A run of three files.
fn run(folder: &Path) {
    let settings = Settings {
        min_free_bytes: 0,
        segment_bytes: u64::MAX,
        segment_ns: 10 * SECOND,
        ..Settings::new(&RecorderSection::default(), folder.to_owned(), BTreeMap::new())
    };
    let clock = RunClock { t0_unix_ns: 1_700_000_000_123_456_789, t0_mono_ns: 0 };
    let session = Session::open(settings, clock, 0, u64::MAX).unwrap();
    let mut writing = Writing { session, random: Random(0x1234_5678_9abc_def1), now_ns: 0 };
    writing.put::<OperatorRequest>("operator/request", 1, |request| {
        put_text(&mut request.text, "go, \"there\"\nand back");
        put_text(&mut request.answer, "höchstens 0.4 m/s");
    });
    for seq in 1..=60 {
        writing.put::<MotorState>("motor/state", seq, |_| {});
        writing.put::<MotorInput>("motor/input", seq, |_| {});
        writing.put::<NodeEstimate>("node/estimate/a", seq, |estimate| {
            estimate.position_m = [f64::NAN, f64::NEG_INFINITY, -0.0];
        });
        writing.put::<TruthNode>("truth/node", seq, |_| {});
        // a foreign type, and one whose definition is rejected: plain bytes
        for (name, type_name, schema) in [
            ("sensor/wind", "lab/Wind/1", "int16[4] gust\nfloat32 speed_m_s\nint8 sign\nuint8[3] raw\n"),
            ("sensor/odd", "lab/Odd/1", "string name\n"),
        ] {
            let spec = ChannelSpec { name: name.into(), type_name: type_name.into(), schema: schema.into(), size: 16 };
            let row = writing.session.declare(spec);
            let mut sample = [0; 16];
            writing.random.fill(&mut sample);
            writing.record(row, seq, &sample);
        }
    }
    assert_eq!(writing.session.close("stopped").unwrap().unwrap(), folder.join("run-0003.mcap"));
}

fn wanted(format: Format, folder: &Path) -> ExportRequest {
    let (from_s, to_s) = (f64::NEG_INFINITY, f64::INFINITY);
    ExportRequest { format, folder: folder.to_owned(), channels: Vec::new(), from_s, to_s }
}

#[test]
fn three_formats_hold_what_independent_readers_find_in_three_files() {
    let folder = tempfile::tempdir().unwrap();
    let (recorded, tables) = (folder.path().join("run"), folder.path().join("tables"));
    std::fs::create_dir(&recorded).unwrap();
    run(&recorded);
    let mut told = (0, 1);
    for format in [Format::Csv, Format::Npy, Format::Parquet] {
        let export = export(&recorded, &wanted(format, &tables), &mut |done, all| told = (done, all)).unwrap();
        assert!(export.left_out.is_empty() && export.damaged == 0);
        assert!(export.repeated >= 2, "every file contains the request");
        let samples: Vec<_> = export.tables.iter().map(|table| (table.channel.as_str(), table.samples)).collect();
        let of = |channel| samples.iter().find(|(name, _)| *name == channel).unwrap().1;
        assert_eq!((of("operator/request"), of("motor/state"), of("sensor/odd")), (1, 60, 60));
        assert_eq!(
            export.tables.iter().find(|table| table.channel == "motor/state").unwrap().type_name,
            schema_name(MotorState::type_name()).unwrap()
        );
    }
    assert_eq!(told.0, told.1);
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = python();
    let says = |script: &str, args: &[&PathBuf]| {
        let output = Command::new(&python).arg(root.join("python").join(script)).args(args).output();
        let output = output.unwrap();
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
        said
    };
    let said = says("check_export.py", &[&recorded, &tables]);
    assert!(said.contains("samples on 7 channels agree"), "{said}");
    let said = says("check_reader.py", &[&recorded]);
    assert!(said.starts_with("2 repeated; 361 samples on 7 channels agree"), "{said}");
    let said = says("check_columns.py", &[&recorded]);
    assert_eq!(said.lines().filter(|line| line.ends_with(" of 7 channels agree")).count(), 3, "{said}");
}

#[test]
fn only_the_requested_channels_are_exported_and_nothing_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let (recorded, tables) = (folder.path().join("run"), folder.path().join("tables"));
    std::fs::create_dir(&recorded).unwrap();
    run(&recorded);
    let mut few = wanted(Format::Csv, &tables);
    few.channels = vec!["motor/*".into(), "truth/node".into()];
    (few.from_s, few.to_s) = (5.0, 10.0);
    let export_few = || export(&recorded, &few, &mut |_, _| {});
    let done = export_few().unwrap();
    let names: Vec<_> = done.tables.iter().map(|table| table.channel.as_str()).collect();
    assert_eq!(names, ["motor/input", "motor/state", "truth/node"]);
    let text = std::fs::read_to_string(&done.tables[1].file).unwrap();
    let times: Vec<f64> = text.lines().skip(1).map(|line| line.split(',').next().unwrap().parse().unwrap()).collect();
    assert!(!times.is_empty() && times.iter().all(|t_s| (5.0..10.0).contains(t_s)), "{times:?}");
    let again = export_few().unwrap_err();
    assert!(
        matches!(&again, RunError::Io { source, .. } if source.kind() == std::io::ErrorKind::AlreadyExists),
        "an existing table was overwritten: {again}"
    );

    let mut none = wanted(Format::Csv, &tables);
    none.channels = vec!["sensor/rain".into()];
    let error = export(&recorded, &none, &mut |_, _| {}).unwrap_err();
    assert!(
        matches!(&error, RunError::NotARun { what: NotARunReason::NoChannel { wanted, there }, .. }
            if wanted == &["sensor/rain"] && there.contains(&"motor/input".into())),
        "{error}"
    );
    // One wrong name beside a right one leaves no table behind.
    let other = folder.path().join("other");
    let mut both = wanted(Format::Csv, &other);
    both.channels = vec!["motor/state".into(), "motor/stat".into(), "sensor/*".into()];
    let error = export(&recorded, &both, &mut |_, _| {}).unwrap_err();
    assert!(
        matches!(&error, RunError::NotARun { what: NotARunReason::NoChannel { wanted, .. }, .. } if wanted == &["motor/stat"]),
        "{error}"
    );
    assert_eq!(std::fs::read_dir(&other).unwrap().count(), 0);
    let mut late = wanted(Format::Csv, &tables);
    late.from_s = 1e6;
    let error = export(&recorded, &late, &mut |_, _| {}).unwrap_err();
    assert!(matches!(error, RunError::NotARun { what: NotARunReason::NoSampleThen, .. }), "{error}");
}

#[test]
fn a_second_export_into_a_folder_keeps_the_definitions_of_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let (recorded, tables) = (folder.path().join("run"), folder.path().join("tables"));
    std::fs::create_dir(&recorded).unwrap();
    run(&recorded);
    let export = |channel: &str| {
        let args = analysis::export::Args {
            run: recorded.clone(),
            out: Some(tables.clone()),
            format: analysis::export::TableFormat::Csv,
            channel: vec![channel.to_owned()],
            from: None,
            to: None,
        };
        analysis::export::run(&args).unwrap().value["tables"].as_array().unwrap().len()
    };
    let listed = || -> Vec<String> {
        let text = std::fs::read_to_string(tables.join("tables.json")).unwrap();
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        let tables = value["tables"].as_array().unwrap();
        assert!(tables.iter().all(|table| !table["definition"].as_str().unwrap().is_empty()));
        tables.iter().map(|table| table["channel"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!((export("truth/node"), listed()), (1, vec!["truth/node".to_owned()]));
    assert_eq!((export("motor/*"), listed().len()), (2, 3));
    std::fs::remove_file(tables.join("truth.node.csv")).unwrap();
    assert_eq!(export("operator/request"), 1);
    assert_eq!(listed(), ["motor/input", "motor/state", "operator/request"]);
}
