//! The newest samples at an instant are those of a reading of the whole run, from a few chunks.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use messages::{Heartbeat, Message, MotorState, SystemConfig, TruthNode};
use runlog::{ChannelSpec, Instant, RECENT, RunClock, RunReader, RunWriter, next_file};
use std::collections::BTreeMap;
use std::path::Path;

const PERIOD: u64 = 10_000_000;

/// Writes a file of 100 Hz samples from one cycle to another, flushed twice a second; the configuration of cycle 1 at
/// its beginning, which each further file repeats, and a heartbeat once a second.
fn write(folder: &Path, from: u64, to: u64, finished: bool) {
    let clock = RunClock { t0_unix_ns: 1_700_000_000_000_000_000, t0_mono_ns: 0 };
    let mut writer = RunWriter::create(&next_file(folder), clock, &Default::default(), &[]).unwrap();
    let state = writer.add_channel(&ChannelSpec::for_type::<MotorState>("motor/state")).unwrap();
    let truth = writer.add_channel(&ChannelSpec::for_type::<TruthNode>("truth/node")).unwrap();
    let beat = writer.add_channel(&ChannelSpec::for_type::<Heartbeat>("system/heartbeat/planner")).unwrap();
    let config = writer.add_channel(&ChannelSpec::for_type::<SystemConfig>("system/config/planner")).unwrap();
    fn put<T: Message>(writer: &mut RunWriter, channel: runlog::ChannelId, cycle: u64, stamp_ns: u64, logged_ns: u64) {
        let mut sample = T::zeroed();
        let header = sample.header_mut();
        (header.cycle, header.seq, header.stamp_ns) = (cycle, cycle, stamp_ns);
        writer.write(channel, cycle, logged_ns, stamp_ns, bytemuck::bytes_of(&sample)).unwrap();
    }
    put::<SystemConfig>(&mut writer, config, 1, PERIOD, from * PERIOD);
    for cycle in from..to {
        let now_ns = cycle * PERIOD;
        put::<MotorState>(&mut writer, state, cycle, now_ns, now_ns);
        // Out of order across the chunks: it was received some cycles late.
        let late_ns = cycle.saturating_sub(cycle % 7) * PERIOD + cycle % 7;
        put::<TruthNode>(&mut writer, truth, cycle, late_ns, late_ns);
        if cycle % 100 == 0 {
            put::<Heartbeat>(&mut writer, beat, cycle, now_ns, now_ns);
        }
        if cycle % 50 == 0 {
            writer.flush().unwrap();
        }
    }
    if finished {
        writer.finish(&Default::default()).unwrap();
    } else {
        writer.flush().unwrap();
        writer.give_up();
    }
}

/// The same by reading everything.
fn all(run: &Path, at_ns: u64) -> BTreeMap<String, Vec<u64>> {
    let mut reader = RunReader::open(run).unwrap();
    let mut times: BTreeMap<String, Vec<u64>> = BTreeMap::new();
    while let Some(recorded) = reader.next_sample().unwrap() {
        if recorded.log_time_ns <= at_ns {
            times.entry(recorded.channel.name.clone()).or_default().push(recorded.log_time_ns);
        }
    }
    for times in times.values_mut() {
        times.sort_unstable();
        times.drain(..times.len().saturating_sub(RECENT));
    }
    times
}

fn times(instant: &Instant) -> BTreeMap<String, Vec<u64>> {
    let of = |kept: &runlog::KeptSample| kept.log_time_ns;
    instant.samples.iter().map(|(name, kept)| (name.clone(), kept.iter().map(of).collect())).collect()
}

#[test]
fn a_finished_file_is_read_by_its_index() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), 1, 6000, true);
    for cycle in [1, 37, 50, 51, 3000, 4999, 5999, 9000] {
        let at_ns = 1_700_000_000_000_000_000 + cycle * PERIOD;
        let instant = Instant::read(folder.path(), at_ns).unwrap();
        assert_eq!(times(&instant), all(folder.path(), at_ns), "at cycle {cycle}");
        // Eight heartbeats take eight seconds, and the file has sixty.
        assert!(instant.chunks <= 20 && instant.scanned == 0, "{} chunks", instant.chunks);
    }
    assert!(Instant::read(folder.path(), 5).unwrap().samples.is_empty(), "before the run");
}

#[test]
fn an_unfinished_file_and_the_files_before_it_are_read_too() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), 1, 500, true);
    write(folder.path(), 500, 900, false);
    let at_ns = 1_700_000_000_000_000_000 + 700 * PERIOD;
    let instant = Instant::read(folder.path(), at_ns).unwrap();
    assert_eq!(instant.scanned, 1);
    let state = instant.samples["motor/state"].back().unwrap();
    let sample = state.channel.conversion::<MotorState>().unwrap().apply::<MotorState>(&state.sample).unwrap();
    assert_eq!(sample.header.cycle, 700);
    let earlier = Instant::read(folder.path(), at_ns - 400 * PERIOD).unwrap();
    let state = earlier.samples["motor/state"].back().unwrap();
    assert_eq!(state.log_time_ns, at_ns - 400 * PERIOD);
}

#[test]
fn shortly_after_a_new_file_the_recent_samples_are_those_of_both_files() {
    for finished in [true, false] {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), 1, 500, true);
        write(folder.path(), 500, 520, finished);
        write(folder.path(), 520, 900, finished);
        for cycle in [499, 500, 503, 507, 508, 519, 520, 523, 527, 600, 800] {
            let at_ns = 1_700_000_000_000_000_000 + cycle * PERIOD;
            let instant = Instant::read(folder.path(), at_ns).unwrap();
            assert_eq!(times(&instant), all(folder.path(), at_ns), "at cycle {cycle}");
            let state = instant.samples["motor/state"].iter().map(|kept| u64::from(kept.sequence));
            assert_eq!(state.collect::<Vec<_>>(), (cycle - 7..=cycle).collect::<Vec<_>>());
            // The original, not one of the two repetitions.
            let config = &instant.samples["system/config/planner"];
            assert_eq!((config.len(), config[0].log_time_ns), (1, 1_700_000_000_000_000_000 + PERIOD));
        }
    }
    // Without the first file, its sample is known from the repetition alone.
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), 500, 520, true);
    let instant = Instant::read(folder.path(), 1_700_000_000_000_000_000 + 510 * PERIOD).unwrap();
    let config = &instant.samples["system/config/planner"];
    assert_eq!((config.len(), config[0].publish_time_ns), (1, 1_700_000_000_000_000_000 + PERIOD));
}
