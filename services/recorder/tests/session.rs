//! What a session does with its files when the disk fills, fails, and when channels come and go.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use messages::{Message, RecorderStatus, TruthNode, text_of};
use recorder::{Batch, Heard, Session, Settings};
use runlog::{ChannelSpec, RunClock, info, read_channel, segments};

const SECOND: u64 = 1_000_000_000;
const MIN_FREE: u64 = 1_000;

fn settings(folder: &Path) -> Settings {
    Settings {
        folder: folder.to_owned(),
        min_free_bytes: MIN_FREE,
        flush_ns: SECOND / 2,
        about: BTreeMap::new(),
        attachments: Vec::new(),
    }
}

fn truth(seq: u64, stamp_ns: u64) -> TruthNode {
    let mut sample = TruthNode::default();
    (sample.header.seq, sample.header.stamp_ns) = (seq, stamp_ns);
    sample
}

/// One sample, as the recorder would bring it.
fn hear(session: &mut Session, row: usize, seq: u64, now_ns: u64, missing: u64) {
    let mut batch = Batch::default();
    let sample = truth(seq, now_ns);
    batch.push(Heard { row, logged_ns: now_ns, stamp_ns: now_ns, seq, missing }, bytemuck::bytes_of(&sample));
    session.write(&batch, now_ns, now_ns + 1_000);
}

fn status(session: &Session) -> RecorderStatus {
    session.status(0).next().unwrap()
}

#[test]
fn a_full_disk_stops_the_recording_loudly_and_room_lets_it_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let clock = RunClock::now();
    let mut session = Session::open(settings(folder.path()), clock, 0, 10_000).unwrap();
    let row = session.declare(ChannelSpec::of::<TruthNode>("truth/node"));
    assert_eq!(session.declare(ChannelSpec::of::<TruthNode>("truth/node")), row);
    hear(&mut session, row, 1, SECOND, 0);
    session.tick(SECOND, Some(10_000));
    assert_eq!(status(&session).state, RecorderStatus::STATE_RECORDING);
    assert!(!session.wants_free_bytes(SECOND + 1) && session.wants_free_bytes(2 * SECOND));

    session.tick(2 * SECOND, Some(MIN_FREE - 1));
    assert!(!session.is_recording());
    assert_eq!(info(folder.path()).unwrap().ended.as_deref(), Some("the disk was full"), "the file is closed in order");
    hear(&mut session, row, 2, 2 * SECOND, 0);
    session.tick(3 * SECOND, Some(MIN_FREE));
    assert_eq!(status(&session).state, RecorderStatus::STATE_DISK_FULL, "not for a handful of bytes");
    hear(&mut session, row, 3, 3 * SECOND, 0);
    assert_eq!(status(&session).lost, 2);

    session.tick(4 * SECOND, Some(2 * MIN_FREE));
    assert!(session.is_recording());
    hear(&mut session, row, 4, 4 * SECOND, 0);
    assert_eq!(text_of(&status(&session).file), "run-0002.mcap");
    session.close("stopped").unwrap().unwrap();
    let numbers: Vec<u64> = read_channel::<TruthNode>(folder.path(), "truth/node")
        .unwrap()
        .iter()
        .map(|(_, sample)| sample.header.seq)
        .collect();
    assert_eq!(numbers, [1, 4]);
    let report = info(folder.path()).unwrap();
    assert!(report.verdict[0].contains("truth/node: 2 samples missing in 1 gaps"), "{:?}", report.verdict);
}

#[test]
fn a_disk_that_is_full_from_the_beginning_is_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = Session::open(settings(folder.path()), RunClock::now(), 0, 5).unwrap();
    assert!(!session.is_recording() && segments(folder.path()).is_err());
    session.tick(SECOND, Some(5 * MIN_FREE));
    assert!(session.is_recording());
    assert!(session.close("stopped").unwrap().unwrap().ends_with("run.mcap"));
}

#[test]
fn a_folder_that_goes_away_is_said_and_recording_goes_on_when_it_is_back() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("run");
    assert!(Session::open(settings(&folder), RunClock::now(), 0, 10_000).is_err());
    fs::create_dir(&folder).unwrap();
    let mut session = Session::open(settings(&folder), RunClock::now(), 0, 10_000).unwrap();
    let row = session.declare(ChannelSpec::of::<TruthNode>("truth/node"));
    fs::remove_dir_all(&folder).unwrap();
    session.tick(SECOND, Some(0)); // closing the file fails: there is no folder
    session.tick(2 * SECOND, Some(10_000)); // neither can another be begun
    assert_eq!(status(&session).state, RecorderStatus::STATE_FAILED);
    hear(&mut session, row, 1, 2 * SECOND, 0);
    fs::create_dir(&folder).unwrap();
    session.tick(3 * SECOND, Some(10_000));
    assert_eq!(status(&session).state, RecorderStatus::STATE_FAILED, "not at once");
    session.tick(8 * SECOND, Some(10_000));
    hear(&mut session, row, 2, 8 * SECOND, 0);
    session.close("stopped").unwrap().unwrap();
    assert_eq!(read_channel::<TruthNode>(&folder, "truth/node").unwrap().len(), 1);
}

#[test]
fn what_is_missing_is_counted_and_stands_at_the_end_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = Session::open(settings(folder.path()), RunClock::now(), 0, 10_000).unwrap();
    let row = session.declare(ChannelSpec::of::<TruthNode>("truth/node"));
    session.declare(ChannelSpec::of::<TruthNode>("truth/never"));
    hear(&mut session, row, 1, 10, 0);
    hear(&mut session, row, 5, 20, 3);
    let status = status(&session);
    assert_eq!((status.messages, status.lost, status.gaps), (2, 3, 1));
    assert_eq!(status.total_bytes, 2 * size_of::<TruthNode>() as u64);
    assert_eq!(status.worst_lag_ns, 1_000);
    assert_eq!(text_of(&status.channel), "truth/node");
    assert_eq!(session.status(0).count(), 2);
    session.close("stopped").unwrap().unwrap();
    let report = info(folder.path()).unwrap();
    assert_eq!(report.channels.len(), 1, "a channel without samples is not in the file");
    assert_eq!(report.channels[0].lost, 3);
    let sample = truth(1, 10);
    assert_eq!(read_channel::<TruthNode>(folder.path(), "truth/node").unwrap()[0].1.header(), sample.header());
}

#[test]
fn losses_without_sense_do_not_overflow_their_count() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = Session::open(settings(folder.path()), RunClock::now(), 0, 10_000).unwrap();
    for channel in ["truth/node", "truth/other"] {
        let row = session.declare(ChannelSpec::of::<TruthNode>(channel));
        for seq in 1..4 {
            hear(&mut session, row, seq, SECOND, u64::MAX);
        }
    }
    assert_eq!(status(&session).lost, u64::MAX);
    session.close("the test is over").unwrap();
}
