//! The files of a session: full and failing disks, new channels, losses.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use config::RecorderSection;
use messages::{Message, RecorderGap, RecorderStatus, TruthNode, text_of};
use recorder::{Batch, DiskFull, ENDED_DISK_FULL, ReceivedSample, Session, Settings};
use runlog::{ChannelSpec, Finding, RunClock, RunError, RunReader, cause_phrase, info, read_channel, segments};

const SECOND: u64 = 1_000_000_000;
const MIN_FREE: u64 = 1_000;

fn settings(folder: &Path) -> Settings {
    Settings {
        min_free_bytes: MIN_FREE,
        segment_bytes: u64::MAX,
        segment_ns: u64::MAX,
        ..Settings::new(&RecorderSection::default(), folder.to_owned(), BTreeMap::new())
    }
}

fn truth(seq: u64, stamp_ns: u64) -> TruthNode {
    let mut sample = TruthNode::default();
    (sample.header.seq, sample.header.stamp_ns) = (seq, stamp_ns);
    sample
}

/// Passes one sample to the session, as the recorder does.
fn receive(session: &mut Session, row: usize, seq: u64, now_ns: u64, missing: u64) {
    let mut batch = Batch::default();
    let sample = truth(seq, now_ns);
    batch.push(ReceivedSample { row, logged_ns: now_ns, stamp_ns: now_ns, seq, missing }, bytemuck::bytes_of(&sample));
    session.write(&batch, now_ns, now_ns + 1_000);
}

/// A reason, shortened to the field of the status.
fn in_status(reason: &dyn std::fmt::Display) -> String {
    let mut status = RecorderStatus::default();
    messages::put_sentence(&mut status.reason, &reason.to_string());
    text_of(&status.reason)
}

fn status(session: &Session) -> RecorderStatus {
    session.status(0).next().unwrap()
}

#[test]
fn a_full_disk_stops_the_recording_and_free_space_resumes_it() {
    let folder = tempfile::tempdir().unwrap();
    let clock = RunClock::now();
    let mut session = Session::open(settings(folder.path()), clock, 0, 10_000).unwrap();
    let row = session.declare(ChannelSpec::for_type::<TruthNode>("truth/node"));
    assert_eq!(session.declare(ChannelSpec::for_type::<TruthNode>("truth/node")), row);
    receive(&mut session, row, 1, SECOND, 0);
    session.tick(SECOND, Some(10_000));
    assert_eq!(status(&session).state, RecorderStatus::STATE_RECORDING);
    assert!(!session.wants_free_bytes(SECOND + 1) && session.wants_free_bytes(2 * SECOND));

    session.tick(2 * SECOND, Some(MIN_FREE - 1));
    assert!(!session.is_recording());
    assert_eq!(info(folder.path()).unwrap().ended.as_deref(), Some(ENDED_DISK_FULL), "the file is closed in order");
    receive(&mut session, row, 2, 2 * SECOND, 0);
    session.tick(3 * SECOND, Some(MIN_FREE));
    assert_eq!(status(&session).state, RecorderStatus::STATE_DISK_FULL, "a few free bytes do not suffice");
    let reason = text_of(&status(&session).reason);
    let folder_of_run = folder.path().to_owned();
    let full = DiskFull { folder: folder_of_run, free_bytes: MIN_FREE - 1, needed_bytes: MIN_FREE };
    assert_eq!(reason, in_status(&full));
    receive(&mut session, row, 3, 3 * SECOND, 0);
    assert_eq!(status(&session).lost, 2);

    session.tick(4 * SECOND, Some(2 * MIN_FREE));
    assert!(session.is_recording());
    receive(&mut session, row, 4, 4 * SECOND, 0);
    assert_eq!(text_of(&status(&session).file), "run-0002.mcap");
    session.close("stopped").unwrap().unwrap();
    let numbers: Vec<u64> = read_channel::<TruthNode>(folder.path(), "truth/node")
        .unwrap()
        .iter()
        .map(|(_, sample)| sample.header.seq)
        .collect();
    assert_eq!(numbers, [1, 4]);
    let report = info(folder.path()).unwrap();
    let lost = Finding::Lost { channel: "truth/node".into(), samples: 2, gaps: 1 };
    assert_eq!(report.findings[0], lost, "{:?}", report.findings);
}

#[test]
fn recording_starts_when_a_full_disk_has_free_space() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = Session::open(settings(folder.path()), RunClock::now(), 0, 5).unwrap();
    assert!(!session.is_recording() && segments(folder.path()).is_err());
    session.tick(SECOND, Some(5 * MIN_FREE));
    assert!(session.is_recording());
    assert!(session.close("stopped").unwrap().unwrap().ends_with("run.mcap"));
}

#[test]
fn after_the_run_folder_was_removed_recording_resumes_in_a_new_one() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("run");
    assert!(Session::open(settings(&folder), RunClock::now(), 0, 10_000).is_err());
    fs::create_dir(&folder).unwrap();
    fs::write(folder.join("system.toml"), "x").unwrap();
    let mut session = Session::open(settings(&folder), RunClock::now(), 0, 10_000).unwrap();
    let row = session.declare(ChannelSpec::for_type::<TruthNode>("truth/node"));
    receive(&mut session, row, 1, SECOND / 2, 0);
    session.tick(SECOND, Some(10_000));
    assert_eq!(text_of(&status(&session).reason), "");
    fs::remove_dir_all(&folder).unwrap();
    session.tick(2 * SECOND, Some(10_000));
    let failed = status(&session);
    assert_eq!(failed.state, RecorderStatus::STATE_FAILED);
    let reason = text_of(&failed.reason);
    assert_eq!(reason, in_status(&RunError::Removed { path: folder.join("run.mcap") }));
    // The copy of a mission accepted meanwhile is attached after the configuration.
    fs::create_dir_all(folder.join("missions")).unwrap();
    fs::write(folder.join("missions/1-over.toml"), "y").unwrap();
    receive(&mut session, row, 2, 2 * SECOND, 0);
    assert_eq!(status(&session).lost, 1);
    session.tick(3 * SECOND, Some(10_000));
    assert_eq!(
        (status(&session).state, text_of(&status(&session).reason)),
        (RecorderStatus::STATE_RECORDING, String::new())
    );
    receive(&mut session, row, 3, 4 * SECOND, 0);
    session.close("stopped").unwrap().unwrap();
    assert_eq!(numbers(&folder, "truth/node"), [1, 3], "the last sample of the removed file starts the new one");
    let mut reader = RunReader::open(&folder).unwrap();
    while reader.next_sample().unwrap().is_some() {}
    let kept: Vec<&str> = reader.attachments().iter().map(|file| file.name.as_str()).collect();
    assert_eq!(kept, ["system.toml", "missions/1-over.toml"], "and so does the configuration");
}

#[test]
fn a_later_reason_replaces_the_first() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("run");
    fs::create_dir(&folder).unwrap();
    let mut session = Session::open(settings(&folder), RunClock::now(), 0, 10_000).unwrap();
    session.declare(ChannelSpec::for_type::<TruthNode>("truth/node"));
    fs::remove_dir_all(&folder).unwrap();
    session.tick(SECOND, Some(10_000));
    let path = folder.join("run.mcap");
    let first = status(&session);
    assert_eq!((first.removed, text_of(&first.reason)), (1, in_status(&RunError::Removed { path })));
    // A file with the path of the folder prevents its creation.
    fs::write(&folder, "").unwrap();
    session.tick(3 * SECOND, Some(10_000));
    let second = text_of(&status(&session).reason);
    assert_eq!(status(&session).removed, 1, "what the removed file held stays lost");
    let refused = fs::create_dir_all(&folder).unwrap_err().to_string();
    assert!(second.contains(folder.to_str().unwrap()) && second.contains(&refused), "{second}");
    fs::remove_file(&folder).unwrap();
    session.tick(9 * SECOND, Some(10_000));
    assert!(session.is_recording() && status(&session).removed == 0);
}

#[test]
fn a_file_that_was_replaced_by_another_of_its_name_is_removed_too() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = Session::open(settings(folder.path()), RunClock::now(), 0, 10_000).unwrap();
    session.tick(SECOND, Some(10_000));
    assert!(session.is_recording());
    let part = folder.path().join("run.mcap.part");
    fs::remove_file(&part).unwrap();
    fs::write(&part, "another").unwrap();
    session.tick(2 * SECOND, Some(10_000));
    assert!(!session.is_recording());
}

#[test]
fn missing_samples_are_counted_and_in_the_summary_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = Session::open(settings(folder.path()), RunClock::now(), 0, 10_000).unwrap();
    let row = session.declare(ChannelSpec::for_type::<TruthNode>("truth/node"));
    session.declare(ChannelSpec::for_type::<TruthNode>("truth/never"));
    receive(&mut session, row, 1, 10, 0);
    receive(&mut session, row, 5, 20, 3);
    let status = status(&session);
    assert_eq!((status.messages, status.lost, status.gaps), (2, 3, 1));
    assert_eq!(status.total_bytes, 2 * size_of::<TruthNode>() as u64);
    assert_eq!(status.worst_lag_ns, 1_000);
    assert_eq!(text_of(&status.channel), "truth/node");
    assert_eq!(session.status(0).count(), 2);
    session.close("stopped").unwrap().unwrap();
    let report = info(folder.path()).unwrap();
    let names: Vec<_> = report.channels.iter().map(|channel| channel.name.as_str()).collect();
    assert_eq!(names, ["recorder/gap", "truth/node"], "a channel without samples is not in the file");
    assert_eq!(report.channels[1].lost, 3);
    let sample = truth(1, 10);
    assert_eq!(read_channel::<TruthNode>(folder.path(), "truth/node").unwrap()[0].1.header(), sample.header());
}

#[test]
fn arbitrary_losses_do_not_overflow_their_count() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = Session::open(settings(folder.path()), RunClock::now(), 0, 10_000).unwrap();
    for channel in ["truth/node", "truth/other"] {
        let row = session.declare(ChannelSpec::for_type::<TruthNode>(channel));
        for seq in 1..4 {
            receive(&mut session, row, seq, SECOND, u64::MAX);
        }
    }
    assert_eq!(status(&session).lost, u64::MAX);
    session.close("the test is over").unwrap();
}

/// Numbers of the samples of a channel in one file or in a run.
fn numbers(path: &Path, channel: &str) -> Vec<u64> {
    read_channel::<TruthNode>(path, channel).unwrap().iter().map(|(_, sample)| sample.header.seq).collect()
}

#[test]
fn a_run_of_several_files_is_one_run_and_each_file_can_be_read_alone() {
    let folder = tempfile::tempdir().unwrap();
    let mut wanted = settings(folder.path());
    wanted.segment_ns = 10 * SECOND;
    fs::write(folder.path().join("system.toml"), "x").unwrap();
    fs::create_dir(folder.path().join("missions")).unwrap();
    let mut session = Session::open(wanted, RunClock::now(), 0, 10_000).unwrap();
    let [busy, still, silent] = ["truth/busy", "truth/still", "truth/silent"]
        .map(|name| session.declare(ChannelSpec::for_type::<TruthNode>(name)));
    let _ = silent;
    receive(&mut session, still, 1, SECOND / 4, 0);
    for seq in 1..=60 {
        let now = seq * SECOND / 2;
        receive(&mut session, busy, seq, now, 0);
        session.tick(now, None);
        // Missions flown while the first and the third file are written.
        if seq == 4 || seq == 50 {
            fs::write(folder.path().join(format!("missions/{seq}-over.toml")), format!("{seq}")).unwrap();
        }
    }
    receive(&mut session, still, 2, 31 * SECOND, 0);
    session.close("stopped").unwrap().unwrap();

    let files = segments(folder.path()).unwrap();
    let names: Vec<_> = files.iter().map(|file| file.file_name().unwrap().to_str().unwrap()).collect();
    assert_eq!(names, ["run.mcap", "run-0002.mcap", "run-0003.mcap", "run-0004.mcap"], "every ten seconds of thirty");
    assert_eq!(numbers(folder.path(), "truth/busy"), (1..=60).collect::<Vec<_>>(), "none missing, none twice");
    assert_eq!(numbers(folder.path(), "truth/still"), [1, 2]);
    for (at, file) in files.iter().enumerate() {
        assert_eq!(
            numbers(file, "truth/still")[0],
            1,
            "{names:?} {at}: the sample of a static channel is in every file"
        );
        let mut reader = RunReader::open(file).unwrap();
        while reader.next_sample().unwrap().is_some() {}
        let kept: Vec<&str> = reader.attachments().iter().map(|file| file.name.as_str()).collect();
        let mut expected = vec!["system.toml", "missions/4-over.toml"];
        expected.extend((at >= 2).then_some("missions/50-over.toml"));
        assert_eq!(kept, expected, "{names:?} {at}");
        assert_eq!(reader.ends()[0]["failed_syncs"], "0");
        assert_eq!(reader.metadata()["segment"], (at + 1).to_string());
        assert_eq!(reader.channels().len(), 2, "a channel without samples is in no file");
    }
    let mut reader = RunReader::open(folder.path()).unwrap();
    let mut last = 0;
    while let Some(recorded) = reader.next_sample().unwrap() {
        assert!(recorded.log_time_ns >= last);
        last = recorded.log_time_ns;
    }
    assert_eq!(reader.repeated(), 3);
    let report = info(folder.path()).unwrap();
    assert!(report.healthy, "{:?}", report.verdict);
    assert_eq!((report.files.len(), report.messages), (4, 62));
    assert_eq!(report.ended.as_deref(), Some("stopped"));
}

#[test]
fn a_file_that_is_large_enough_is_followed_by_the_next() {
    let folder = tempfile::tempdir().unwrap();
    let mut wanted = settings(folder.path());
    wanted.segment_bytes = 100_000;
    let mut session = Session::open(wanted, RunClock::now(), 0, 1 << 40).unwrap();
    let spec = ChannelSpec {
        name: "sensor/noise".into(),
        type_name: "x/Noise/1".into(),
        schema: "uint8[4096] data\n".into(),
        size: 4096,
    };
    let row = session.declare(spec);
    let mut random = 1_u64;
    for seq in 1..=200_u64 {
        let now = seq * SECOND / 10;
        let mut sample = [0_u8; 4096];
        for byte in &mut sample {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            *byte = (random >> 56) as u8;
        }
        let mut batch = Batch::default();
        batch.push(ReceivedSample { row, logged_ns: now, stamp_ns: now, seq, missing: 0 }, &sample);
        session.write(&batch, now, now);
        session.tick(now, None);
    }
    session.close("stopped").unwrap().unwrap();
    let files = segments(folder.path()).unwrap();
    assert!((5..=9).contains(&files.len()), "800 kB of noise in {} files", files.len());
    for file in &files[..files.len() - 1] {
        let bytes = fs::metadata(file).unwrap().len();
        assert!((100_000..200_000).contains(&bytes), "{bytes}: the limit, and what half a second more brings");
    }
    assert_eq!(info(folder.path()).unwrap().messages, 200);
}

#[test]
fn every_gap_is_recorded_at_its_place_in_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = Session::open(settings(folder.path()), RunClock::now(), 0, 10_000).unwrap();
    let row = session.declare(ChannelSpec::for_type::<TruthNode>("truth/node"));
    receive(&mut session, row, 1, SECOND, 0);
    receive(&mut session, row, 5, 2 * SECOND, 3);
    session.tick(3 * SECOND, Some(0));
    for seq in 6..=8 {
        receive(&mut session, row, seq, 3 * SECOND + seq, 0);
    }
    receive(&mut session, row, 11, 4 * SECOND, 2);
    session.tick(5 * SECOND, Some(10_000));
    receive(&mut session, row, 12, 6 * SECOND, 0);
    receive(&mut session, row, 13, 7 * SECOND, 0);
    assert_eq!((status(&session).lost, status(&session).gaps), (9, 2));
    session.close("stopped").unwrap().unwrap();

    let gaps: Vec<_> = read_channel::<RecorderGap>(folder.path(), "recorder/gap").unwrap();
    let seen: Vec<_> = gaps
        .iter()
        .map(|(_, gap)| (gap.missing, gap.last_seq, gap.next_seq, gap.last_ns, gap.next_ns, gap.cause))
        .collect();
    let (not_heard, full) = (RecorderGap::CAUSE_OVERFLOW, RecorderGap::CAUSE_DISK_FULL);
    assert_eq!(seen, [(3, 1, 5, SECOND, 2 * SECOND, not_heard), (6, 5, 12, 2 * SECOND, 6 * SECOND, full)]);
    assert_eq!(text_of(&gaps[0].1.channel), "truth/node");
    let report = info(folder.path()).unwrap();
    assert_eq!(report.gaps.len(), 2);
    assert!((report.gaps[1].lasted_s - 4.0).abs() < 1e-9 && report.gaps[1].cause == cause_phrase(full));
    let said = report.to_string();
    let line =
        |line: &&str| ["truth/node", " 6 ", "4.000 s", cause_phrase(full)].iter().all(|part| line.contains(part));
    assert_eq!(said.lines().filter(line).count(), 1, "{said}");
}

#[test]
fn a_restarted_recorder_goes_on_with_the_numbers_of_the_files() {
    let folder = tempfile::tempdir().unwrap();
    for number in ["1", "2", "3"] {
        let session = Session::open(settings(folder.path()), RunClock::now(), 0, 10_000).unwrap();
        let path = session.close("stopped").unwrap().unwrap();
        assert_eq!(RunReader::open(&path).unwrap().metadata()["segment"], number);
    }
}
