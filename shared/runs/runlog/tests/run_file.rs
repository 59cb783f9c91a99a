//! A run file returns what was written; damage loses only the samples it hits.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use messages::{Message, MotorState, NodeEstimate, TruthNode};
use runlog::*;

/// A generator of test data without a dependency (xorshift64).
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
        let header = sample.header_mut();
        (header.seq, header.stamp_ns) = (seq, stamp_ns);
        sample
    }
}

fn write<T: Message>(writer: &mut RunWriter, channel: ChannelId, sample: &T) {
    let header = sample.header();
    writer.write(channel, header.seq, header.stamp_ns + 100, header.stamp_ns, bytemuck::bytes_of(sample)).unwrap();
}

const START: u64 = 1_000_000_000_000;
const PERIOD: u64 = 10_000_000;

/// Writes `cycles` samples of two channels at 100 Hz, flushed twice a second, and leaves the file open.
fn run(folder: &Path, cycles: u64) -> (RunWriter, PathBuf) {
    let clock = RunClock { t0_unix_ns: 1_700_000_000_000_000_000, t0_mono_ns: START };
    let path = next_file(folder);
    let about = BTreeMap::from([("robot".to_owned(), "lab3".to_owned())]);
    let config =
        Attachment { name: "system.toml".into(), media_type: "application/toml".into(), data: b"a = 1".to_vec() };
    let mut writer = RunWriter::create(&path, clock, &about, &[config]).unwrap();
    let state = writer.add_channel(&ChannelSpec::for_type::<MotorState>("motor/state")).unwrap();
    let truth = writer.add_channel(&ChannelSpec::for_type::<TruthNode>("truth/node")).unwrap();
    let mut random = Random(42);
    for cycle in 1..=cycles {
        write(&mut writer, state, &random.sample::<MotorState>(cycle, START + cycle * PERIOD));
        write(&mut writer, truth, &random.sample::<TruthNode>(cycle, START + cycle * PERIOD));
        if cycle % 50 == 0 {
            writer.flush().unwrap();
        }
    }
    (writer, path)
}

fn states(path: &Path) -> Vec<u64> {
    read_channel::<MotorState>(path, "motor/state").unwrap().iter().map(|(_, state)| state.header.seq).collect()
}

fn quiet(_: u64, _: u64) {}

#[test]
fn samples_come_back_bit_for_bit_with_their_times() {
    let folder = tempfile::tempdir().unwrap();
    let (writer, path) = run(folder.path(), 300);
    assert!(!path.exists());
    assert_eq!(writer.path(), path);
    let end = BTreeMap::from([("reason".to_owned(), "stopped".to_owned())]);
    assert_eq!(writer.finish(&end).unwrap(), path);
    assert_eq!(segments(folder.path()).unwrap(), std::slice::from_ref(&path), "no .part remains");

    let mut random = Random(42);
    let mut reader = RunReader::open(&path).unwrap();
    for cycle in 1..=300_u64 {
        let stamp = START + cycle * PERIOD;
        let expected: MotorState = random.sample(cycle, stamp);
        let recorded = reader.next_sample().unwrap().unwrap();
        assert_eq!(recorded.sample, bytemuck::bytes_of(&expected));
        assert!(recorded.decode::<TruthNode>().is_none());
        assert_eq!(recorded.channel.type_name, MotorState::type_name());
        assert_eq!(recorded.sequence, cycle as u32);
        assert_eq!(recorded.publish_time_ns, 1_700_000_000_000_000_000 + cycle * PERIOD);
        assert_eq!(recorded.log_time_ns, recorded.publish_time_ns + 100);
        let expected: TruthNode = random.sample(cycle, stamp);
        let recorded = reader.next_sample().unwrap().unwrap();
        assert_eq!(bytemuck::bytes_of(&recorded.decode::<TruthNode>().unwrap()), bytemuck::bytes_of(&expected));
    }
    assert!(reader.next_sample().unwrap().is_none());
    assert_eq!(reader.clock().unwrap().t0_mono_ns, START);
    assert_eq!(reader.metadata()["robot"], "lab3");

    let report = info(folder.path()).unwrap();
    assert!(report.healthy, "{:?}", report.verdict);
    assert_eq!(report.messages, 600);
    assert_eq!(report.attachments, ["system.toml"]);
    assert_eq!(report.ended.as_deref(), Some("stopped"));
    assert_eq!(report.started.as_deref(), Some("2023-11-14 22:13:20 UTC"));
    let state = &report.channels[0];
    assert_eq!((state.name.as_str(), state.messages, state.lost), ("motor/state", 300, 0));
    assert!((state.rate_hz.unwrap() - 100.0).abs() < 1e-6 && (state.longest_silence_s - 0.01).abs() < 1e-9);
    assert!(report.findings.is_empty() && report.verdict.len() == 1, "{:?}", report.verdict);
    let text = report.to_string();
    assert!(text.contains("motor/state") && text.contains(&report.verdict[0]), "{text}");
    assert!(serde_json::to_value(&report).unwrap()["channels"][1]["name"] == "truth/node");
}

#[test]
fn losses_are_seen_by_number() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut writer = RunWriter::create(&path, RunClock::now(), &BTreeMap::new(), &[]).unwrap();
    let channel = writer.add_channel(&ChannelSpec::for_type::<MotorState>("motor/state")).unwrap();
    let mut random = Random(1);
    for seq in [1_u64, 2, 5, 6, 9] {
        write(&mut writer, channel, &random.sample::<MotorState>(seq, seq));
    }
    let short = writer.write(channel, 10, 1, 1, &[0; 8]).unwrap_err();
    let bytes = size_of::<MotorState>();
    let RunError::Size { channel: named, got: 8, expected } = &short else { panic!("{short}") };
    assert_eq!((named.as_str(), *expected), ("motor/state", bytes));
    writer.finish(&BTreeMap::new()).unwrap();
    let report = info(&path).unwrap();
    assert_eq!((report.channels[0].lost, report.channels[0].gaps, report.messages), (4, 2, 5));
    let lost = Finding::Lost { channel: "motor/state".into(), samples: 4, gaps: 2 };
    assert!(!report.healthy && report.findings.contains(&lost), "{:?}", report.findings);
    // 6 and 7 are missing between 5 and 8, 9 and 10 ... each sample is stamped one nanosecond after the previous one.
    assert!(report.channels[0].unrecorded_s > 0.0);
    let wrong = read_channel::<NodeEstimate>(&path, "motor/state").unwrap_err();
    let RunError::Type { channel, found, wanted } = &wrong else { panic!("{wrong}") };
    assert_eq!(channel, "motor/state");
    assert_eq!((found.as_str(), wanted.as_str()), (MotorState::type_name(), NodeEstimate::type_name()));
}

#[test]
fn a_file_that_was_left_alone_is_readable_to_its_last_flush_and_recovered() {
    let folder = tempfile::tempdir().unwrap();
    let (writer, path) = run(folder.path(), 130);
    let part = folder.path().join("run.mcap.part");
    let busy = recover(&part, &mut quiet).unwrap_err();
    assert!(matches!(&busy, RunError::Busy { path } if *path == part), "{busy}");
    // as after a kill: the file is not closed, but the lock is released
    let abandoned = folder.path().join("run-0002.mcap.part");
    fs::copy(&part, &abandoned).unwrap();
    assert_eq!(states(&abandoned), (1..=100).collect::<Vec<_>>());
    let report = info(&part).unwrap();
    assert!(report.recording && !report.healthy && report.files[0].recording, "{:?}", report.verdict);
    assert_eq!((report.silent_s, &report.findings[0]), (0, &Finding::Recording { path: part.clone() }));
    // A suspended recorder holds its file and does not write.
    let written = std::time::SystemTime::now() - std::time::Duration::from_secs(60);
    fs::File::open(&part).unwrap().set_modified(written).unwrap();
    let report = info(&part).unwrap();
    assert!(report.recording && (60..600).contains(&report.silent_s), "{} s", report.silent_s);
    assert_eq!(report.findings[0], Finding::Silent { path: part.clone(), silent_s: report.silent_s });
    let silent = format!(" {} s", report.silent_s);
    assert_eq!(report.to_string().matches(&silent).count(), 2, "once for the file, once for the run: {report}");
    let report = info(&abandoned).unwrap();
    assert!(!report.recording && !report.files[0].recording);
    assert!(!report.healthy && report.findings[0] == Finding::NotClosed { path: abandoned.clone() });

    let mut told = (0, 0);
    let recovery = recover(&abandoned, &mut |done, all| told = (done, all)).unwrap();
    assert_eq!(told.0, told.1);
    assert_eq!(recovery.file, folder.path().join("run-0002.mcap"));
    assert_eq!((recovery.messages, recovery.orphaned, recovery.damage.len()), (200, 0, 0));
    assert!(recovery.kept.is_none() && !abandoned.exists());
    let report = info(&recovery.file).unwrap();
    assert!(report.files[0].recovered && report.files[0].finished && !report.healthy, "the loss is unknown");
    assert_eq!(report.findings, [Finding::Recovered { path: recovery.file, lack: MissingData::Unknown }]);
    assert_eq!(report.attachments, ["system.toml"]);
    assert_eq!(report.about["robot"], "lab3");
    writer.finish(&BTreeMap::new()).unwrap();
    assert_eq!(states(&path).len(), 130);
    // a finished file is copied and stays unchanged
    let recovery = recover(&path, &mut quiet).unwrap();
    assert_eq!(recovery.file, folder.path().join("run-recovered.mcap"));
    assert_eq!(recovery.kept.as_deref(), Some(path.as_path()));
    let again = recover(&path, &mut quiet).unwrap_err();
    let RunError::NotARun { what: NotARunReason::RecoveredBefore { beside }, .. } = &again else { panic!("{again}") };
    assert_eq!(*beside, recovery.file);
}

#[test]
fn a_recovery_leaves_room_for_a_recorder_and_nothing_where_it_fails() {
    let folder = tempfile::tempdir().unwrap();
    let (writer, _) = run(folder.path(), 130);
    writer.give_up();
    let part = folder.path().join("run.mcap.part");
    let left = || {
        let mut names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.retain(|name| name.to_string_lossy().starts_with("run"));
        names.sort();
        names
    };
    // An interrupted recovery has left its file.
    fs::write(folder.path().join("run.mcap.recovering"), "half").unwrap();
    let bytes = fs::metadata(&part).unwrap().len();
    let refused = recover_leaving(&part, u64::MAX - bytes, &mut quiet).unwrap_err();
    assert!(matches!(refused, RunError::NoRoom { needed_bytes: u64::MAX, .. }), "{refused}");
    assert_eq!(left(), ["run.mcap.part"]);
    // The result cannot take its place.
    let target = folder.path().join("run.mcap");
    let failed = recover_leaving(&part, 1, &mut |_, _| fs::create_dir_all(&target).unwrap()).unwrap_err();
    assert!(matches!(failed, RunError::Io { .. }), "{failed}");
    assert_eq!(left(), ["run.mcap", "run.mcap.part"]);
    fs::remove_dir(&target).unwrap();
    assert_eq!(recover_leaving(&part, 1, &mut quiet).unwrap().messages, 200);
    assert_eq!(left(), ["run.mcap"]);
}

#[test]
fn a_file_that_a_power_cut_emptied_keeps_no_other_from_being_read() {
    // A new file is in its folder before its content is on the disk: empty, or full of zeros.
    for left in [&b""[..], &[0; 5000]] {
        let folder = tempfile::tempdir().unwrap();
        let (writer, path) = run(folder.path(), 100);
        writer.finish(&BTreeMap::new()).unwrap();
        for name in ["run-0002.mcap.part", "run-0003.mcap.part"] {
            fs::write(folder.path().join(name), left).unwrap();
        }
        let part = folder.path().join("run-0002.mcap.part");
        assert_eq!(states(folder.path()).len(), 100);
        assert_eq!(Instant::read(folder.path(), u64::MAX).unwrap().samples["motor/state"].len(), 8);
        let report = info(folder.path()).unwrap();
        assert_eq!((report.messages, report.files.len(), report.healthy), (200, 3, false));
        let finding = match left.is_empty() {
            true => Finding::NotClosed { path: part.clone() },
            false => Finding::Damaged { path: part.clone(), places: 1 },
        };
        assert!(report.findings.contains(&finding), "{:?}", report.findings);
        let recovery = recover(&part, &mut quiet).unwrap();
        assert_eq!((recovery.messages, recovery.kept.is_some()), (0, !left.is_empty()));
        assert!(!part.exists() && info(folder.path()).unwrap().files[1].finished);
        // As the first file of the run it has no clock; that of the others holds.
        fs::rename(&path, folder.path().join("run-0004.mcap")).unwrap();
        let reader = RunReader::open(folder.path()).unwrap();
        assert_eq!(reader.begin_ns(), Some(1_700_000_000_000_000_000));
        assert_eq!(reader.metadata()["robot"], "lab3");
        fs::remove_file(folder.path().join("run-0004.mcap")).unwrap();
        fs::remove_file(recovery.file).unwrap();
        let alone = info(folder.path()).unwrap_err();
        assert!(matches!(alone, RunError::NotARun { .. }), "nothing in it can be read: {alone}");
    }
}

#[test]
fn an_export_that_fails_leaves_nothing_of_it_and_all_of_others() {
    let folder = tempfile::tempdir().unwrap();
    let (writer, path) = run(folder.path(), 100);
    writer.finish(&BTreeMap::new()).unwrap();
    let out = folder.path().join("export");
    let request = |channels: &[&str]| export::ExportRequest {
        format: export::Format::Csv,
        folder: out.clone(),
        channels: channels.iter().map(|name| (*name).to_owned()).collect(),
        from_s: f64::NEG_INFINITY,
        to_s: f64::INFINITY,
    };
    let left = || fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect::<Vec<_>>();
    export::export(&path, &request(&["truth/node"]), &mut quiet).unwrap();
    let table = fs::read(out.join("truth.node.csv")).unwrap();
    // The table of the first channel is begun when the second one is found to exist.
    let failed = export::export(&path, &request(&[]), &mut quiet).unwrap_err();
    assert!(matches!(&failed, RunError::Io { path, .. } if path.ends_with("truth.node.csv")), "{failed}");
    assert_eq!(left(), ["truth.node.csv"]);
    assert_eq!(fs::read(out.join("truth.node.csv")).unwrap(), table);
    export::export(&path, &request(&["motor/state"]), &mut quiet).unwrap();
    assert_eq!(left().len(), 2);
}

#[test]
fn a_recovered_file_lacks_what_the_numbers_of_the_next_one_show() {
    // Each file but the last is as a killed recorder leaves it: flushed up to sample 100, then recovered.
    for (next, lack) in [(101_u64, MissingData::Nothing), (131, MissingData::NotOnDisk)] {
        let folder = tempfile::tempdir().unwrap();
        let (writer, _) = run(folder.path(), 130);
        let part = folder.path().join("run.mcap.part");
        let left = fs::read(&part).unwrap();
        drop(writer);
        fs::write(&part, left).unwrap();
        recover(&part, &mut quiet).unwrap();
        let clock = RunClock { t0_unix_ns: 1_700_000_000_000_000_000, t0_mono_ns: START };
        let mut writer = RunWriter::create(&next_file(folder.path()), clock, &BTreeMap::new(), &[]).unwrap();
        let state = writer.add_channel(&ChannelSpec::for_type::<MotorState>("motor/state")).unwrap();
        let truth = writer.add_channel(&ChannelSpec::for_type::<TruthNode>("truth/node")).unwrap();
        let mut random = Random(43);
        for seq in next..next + 100 {
            write(&mut writer, state, &random.sample::<MotorState>(seq, START + seq * PERIOD));
            write(&mut writer, truth, &random.sample::<TruthNode>(seq, START + seq * PERIOD));
        }
        writer.finish(&BTreeMap::new()).unwrap();
        let report = info(folder.path()).unwrap();
        let recovered = Finding::Recovered { path: folder.path().join("run.mcap"), lack };
        assert!(!report.healthy && report.findings.contains(&recovered), "{:?}", report.findings);
        let unrecorded = report.findings.iter().any(|finding| matches!(finding, Finding::Unrecorded { .. }));
        assert_eq!(unrecorded, next > 101, "{:?}", report.findings);
    }
}

#[test]
fn a_cut_at_any_place_loses_only_what_is_behind_it() {
    let folder = tempfile::tempdir().unwrap();
    let (writer, _) = run(folder.path(), 200);
    let whole = fs::read(folder.path().join("run.mcap.part")).unwrap();
    drop(writer);
    fs::remove_file(folder.path().join("run.mcap.part")).unwrap();
    let mut random = Random(7);
    let mut best = 0;
    for _ in 0..40 {
        let cut = 8 + (random.next() as usize) % (whole.len() - 8);
        let part = folder.path().join("cut.mcap.part");
        fs::write(&part, &whole[..cut]).unwrap();
        let recovery = recover(&part, &mut quiet).unwrap();
        assert!(recovery.damage.iter().all(|damage| damage.torn_end), "{:?}", recovery.damage);
        let numbers = states(&recovery.file);
        assert_eq!(numbers, (1..=numbers.len() as u64).collect::<Vec<_>>());
        assert_eq!(numbers.len() % 50, 0, "whole chunks");
        best = best.max(numbers.len());
        fs::remove_file(recovery.file).unwrap();
    }
    assert!(best >= 100);
    // on some file systems a power cut leaves zeros after the last block
    let part = folder.path().join("zeros.mcap.part");
    fs::write(&part, [whole.as_slice(), &[0; 10_000]].concat()).unwrap();
    assert_eq!(states(&recover(&part, &mut quiet).unwrap().file).len(), 200);
}

#[test]
fn a_flipped_byte_anywhere_costs_one_chunk_at_most() {
    let folder = tempfile::tempdir().unwrap();
    let (writer, path) = run(folder.path(), 400);
    writer.finish(&BTreeMap::new()).unwrap();
    let whole = fs::read(&path).unwrap();
    let mut random = Random(99);
    let (mut hit, mut spared) = (0, 0);
    for round in 0..120_u64 {
        // both ends of the file, where single bytes matter most, and random places
        let at = if round < 40 { round as usize } else { (random.next() as usize) % whole.len() };
        let mut flipped = whole.clone();
        flipped[at] ^= 1 << (random.next() % 8);
        let damaged = folder.path().join("damaged.mcap");
        fs::write(&damaged, &flipped).unwrap();
        let recovery = recover(&damaged, &mut quiet).unwrap();
        let numbers = states(&recovery.file);
        let missing = 400 - numbers.len();
        assert!(missing <= 50, "byte {at}: {missing} samples of one channel are missing; {:?}", recovery.damage);
        assert!(numbers.windows(2).all(|pair| pair[0] < pair[1]));
        assert!(info(&recovery.file).unwrap().files[0].damage.is_empty());
        hit += usize::from(missing > 0);
        spared += usize::from(missing == 0);
        fs::remove_file(recovery.file).unwrap();
    }
    assert!(hit > 20 && spared > 5, "{hit} hits, {spared} missed");
}

#[test]
fn an_undecodable_type_is_recorded_as_plain_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut writer = RunWriter::create(&path, RunClock::now(), &BTreeMap::new(), &[]).unwrap();
    let spec = |name: &str, type_name: &str, schema: &str, size| ChannelSpec {
        name: name.into(),
        type_name: type_name.into(),
        schema: schema.into(),
        size,
    };
    let bad = writer.add_channel(&spec("sensor/bad", "x/Bad/1", "float64 a\nuint8 b\n", 16)).unwrap();
    let good = writer.add_channel(&spec("sensor/good", "x/Good/1", "float64 a\nuint8[8] b\n", 16)).unwrap();
    assert_eq!(writer.refusal(bad), Some(SchemaRefusal::Size { described: 9, sample: 16 }.to_string().as_str()));
    assert!(writer.refusal(good).is_none());
    for channel in [bad, good] {
        writer.write(channel, 1, 5, 5, &[7; 16]).unwrap();
    }
    writer.finish(&BTreeMap::new()).unwrap();
    let report = info(&path).unwrap();
    assert_eq!(report.channels[0].schema, "nims_msgs/msg/Opaque16");
    assert!(report.channels[0].refused.is_some() && report.channels[1].refused.is_none());
}

#[test]
fn what_is_not_a_run_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("note.mcap");
    for (content, why) in [
        (&b""[..], NotARunReason::Empty),
        (b"hello", NotARunReason::NotMcap),
        (&[0x89; 100_000], NotARunReason::NotMcap),
    ] {
        fs::write(&path, content).unwrap();
        let error = info(&path).unwrap_err();
        assert!(matches!(&error, RunError::NotARun { path: at, what } if *at == path && *what == why), "{error}");
    }
    let absent = folder.path().join("absent.mcap");
    let error = info(&absent).unwrap_err();
    let missing = std::io::ErrorKind::NotFound;
    assert!(
        matches!(&error, RunError::Io { path, source, .. } if *path == absent && source.kind() == missing),
        "{error}"
    );
    let other = folder.path().join("note.txt");
    fs::write(&other, "x").unwrap();
    let error = recover(&other, &mut quiet).unwrap_err();
    assert!(matches!(&error, RunError::NotARun { path, what: NotARunReason::Name } if *path == other), "{error}");
    fs::remove_file(&path).unwrap();
    let writer = RunWriter::create(&path, RunClock::now(), &BTreeMap::new(), &[]).unwrap();
    let twice = RunWriter::create(&path, RunClock::now(), &BTreeMap::new(), &[]);
    let error = twice.err().unwrap();
    let (part, exists) = (folder.path().join("note.mcap.part"), std::io::ErrorKind::AlreadyExists);
    assert!(matches!(&error, RunError::Io { path, source, .. } if *path == part && source.kind() == exists), "{error}");
    drop(writer);
    // A finished file is not replaced either.
    assert!(RunWriter::create(&other.with_file_name("done.mcap"), RunClock::now(), &BTreeMap::new(), &[]).is_ok());
    let (done, part) = (folder.path().join("done.mcap"), folder.path().join("done.mcap.part"));
    fs::rename(&part, &done).unwrap();
    let error = RunWriter::create(&done, RunClock::now(), &BTreeMap::new(), &[]).err().unwrap();
    assert!(matches!(&error, RunError::Io { path, source, .. } if *path == done && source.kind() == exists), "{error}");
    assert!(done.exists() && !part.exists());
}

#[test]
fn a_power_cut_leaves_all_but_the_last_moments() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let begun = std::time::Instant::now();
    let now = || begun.elapsed().as_nanos() as u64;
    let clock = RunClock { t0_unix_ns: 1_700_000_000_000_000_000, t0_mono_ns: 0 };
    let mut writer = RunWriter::create(&path, clock, &BTreeMap::new(), &[]).unwrap();
    let channel = writer.add_channel(&ChannelSpec::for_type::<MotorState>("motor/state")).unwrap();
    let mut random = Random(5);
    // flushed fifty times as often as the recorder does: the count of unsafe flushes must never exceed two, whatever
    // the speed of the disk
    let (mut flushed, mut cuts) = (Vec::new(), Vec::new());
    for seq in 1..=400_u64 {
        write(&mut writer, channel, &random.sample::<MotorState>(seq, now()));
        if seq % 10 == 0 {
            writer.flush().unwrap();
            flushed.push(seq);
            let report = writer.sync_report();
            cuts.push((report.done, report.safe_bytes));
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let whole = fs::read(folder.path().join("run.mcap.part")).unwrap();
    let mut last = 0;
    for (done, safe) in cuts.iter().filter(|(done, _)| *done > 0).step_by(5) {
        let cut = folder.path().join("cut.mcap.part");
        fs::write(&cut, &whole[..*safe as usize]).unwrap();
        let numbers = states(&cut);
        let count = numbers.len() as u64;
        assert_eq!(numbers, (1..=count).collect::<Vec<_>>());
        assert!(
            count == 0 || flushed.contains(&count),
            "{count} samples safe after {done} confirmations: a flush, whole"
        );
        assert!(count >= last);
        last = count;
    }
    assert!(last >= 200, "{last} samples were safe at last");
}
