//! `disk`: writes the samples of a flight to a run file and syncs them as often as the recorder does, alternating with
//! plain writes of the same bytes.

use super::figures::{Ratio, Spread, record};
use super::flight;
use super::place::Scratch;
use super::settings::Settings;
use super::watch::Watch;
use bus::clock::{SECOND_NS, now_ns};
use command::{Answer, Failure};
use lockstep::Cycle;
use runlog::{ChannelId, ChannelSpec, RunClock, RunError, RunWriter, free_bytes};
use runtime::Timing;
use rustix::fs::{Access, access, statfs};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Duration;

/// Maximum bytes written to the disk per method: enough to measure, too little to wear a memory card.
const MAX_BYTES: u64 = 64 << 20;
/// Interval between two checks whether the disk has confirmed.
const POLL_INTERVAL: Duration = Duration::from_micros(200);

/// Result of `disk`.
#[derive(Debug, Clone, Serialize)]
pub struct DiskResult {
    /// Run file.
    pub ours: WriteStats,
    /// Plain file.
    pub plain: WriteStats,
    /// Plain file divided by run file, for the time of one batch.
    pub ratio: Ratio,
    /// Data rate of a robot at this control rate, MB/s.
    pub needed_mb_s: f64,
    /// Size of the run file as a share of the samples' size.
    pub compressed_to: f64,
    /// Whether the folder is in memory, so that the result does not apply to a disk.
    pub in_memory: bool,
}

/// Result of one way of writing.
#[derive(Debug, Clone, Serialize)]
pub struct WriteStats {
    /// Samples written and synced per second, MB/s.
    pub mb_s: f64,
    /// Time for the data that the recorder collects between two flushes, until the disk has confirmed them.
    #[serde(flatten)]
    pub batch: Spread,
    /// Time of `fdatasync` within it.
    pub sync: Spread,
}

/// Checks that the folder exists, is writable and has more space than the recorder leaves free.
///
/// # Errors
/// Bad input without such a folder; not now without space.
pub fn check(settings: &Settings) -> Answer {
    let runs = &settings.runs;
    let folder = runs.display();
    if !runs.is_dir() {
        return Err(Failure::BadInput(format!("the folder {folder} does not exist; give another one with --runs DIR")));
    }
    if access(runs, Access::WRITE_OK | Access::EXEC_OK).is_err() {
        return Err(Failure::NotNow(format!(
            "this user may not write to {folder}; give another folder with --runs DIR"
        )));
    }
    let free = free_bytes(runs).map_err(|error| Failure::NotNow(format!("{folder} cannot be examined: {error}")))?;
    room(free, settings.least_bytes).map_err(|sentence| Failure::NotNow(format!("{folder} {sentence}")))
}

/// Checks whether the free space is sufficient.
fn room(free: u64, least: u64) -> Result<(), String> {
    let wanted = least.saturating_add(2 * MAX_BYTES);
    if free >= wanted {
        return Ok(());
    }
    let megabytes = |bytes: u64| bytes as f64 * 1e-6;
    Err(format!(
        "has {:.0} MB left; the measurement needs {:.0} MB. Move old runs away, or give another folder with --runs DIR",
        megabytes(free),
        megabytes(wanted)
    ))
}

/// Measures for this many seconds.
///
/// # Errors
/// The benchmark was stopped, or the disk rejects writes.
pub fn measure(settings: &Settings, seconds: f64, watch: &mut Watch) -> Answer<DiskResult> {
    let scenario = flight::scenario(settings).map_err(Failure::bad)?;
    let cycles = flight::fly(&scenario).map_err(Failure::not_now)?;
    let bytes_per_cycle: usize = flight::samples(&cycles[0]).iter().map(|(_, sample)| sample.len()).sum();
    let at_once = ((settings.flush_s * settings.rate_hz).round() as usize).clamp(1, cycles.len());
    let scratch = Scratch::create(&settings.runs)?;
    let mut run = RunFile::begin(scratch.folder()).map_err(Failure::not_now)?;
    let mut plain = PlainFile::begin(scratch.folder()).map_err(write_failure)?;
    let end_ns = now_ns() + (seconds * 1e9) as u64;
    let mut bytes = 0;
    let batches = cycles.chunks_exact(at_once).cycle();
    for (turn, batch) in batches.enumerate() {
        // Alternate the order, because the first writer finds an idle disk.
        if turn % 2 == 0 {
            run.write(batch, watch)?;
            plain.write(batch).map_err(write_failure)?;
        } else {
            plain.write(batch).map_err(write_failure)?;
            run.write(batch, watch)?;
        }
        bytes += (bytes_per_cycle * batch.len()) as u64;
        watch.update();
        watch.check_stop()?;
        if now_ns() >= end_ns || bytes >= MAX_BYTES {
            break;
        }
    }
    let (in_file, ours, plain) = (run.writer.bytes(), run.times.stats(bytes), plain.times.stats(bytes));
    let ratio = Ratio::between(&plain.batch, &ours.batch);
    let needed_mb_s = bytes_per_cycle as f64 * settings.rate_hz * 1e-6;
    let compressed_to = in_file as f64 / bytes as f64;
    Ok(DiskResult { ours, plain, ratio, needed_mb_s, compressed_to, in_memory: in_memory(&settings.runs) })
}

fn in_memory(folder: &Path) -> bool {
    statfs(folder).is_ok_and(|found| found.f_type as u32 == commissioning::doctor::TMPFS_MAGIC)
}

fn write_failure(error: std::io::Error) -> Failure {
    Failure::NotNow(format!("the disk rejects writes: {error}"))
}

/// Times of one way of writing.
struct WriteTimes {
    batch: Timing,
    sync: Timing,
    total_ns: u64,
}

impl WriteTimes {
    fn new() -> Self {
        Self { batch: Timing::new(), sync: Timing::new(), total_ns: 0 }
    }

    fn add(&mut self, writing_ns: u64, sync_ns: u64) {
        record(&mut self.batch, 0, writing_ns + sync_ns);
        record(&mut self.sync, 0, sync_ns);
        self.total_ns += writing_ns + sync_ns;
    }

    fn stats(&self, bytes: u64) -> WriteStats {
        let seconds = self.total_ns.max(1) as f64 / SECOND_NS as f64;
        WriteStats {
            mb_s: bytes as f64 * 1e-6 / seconds,
            batch: Spread::from_timing(&self.batch),
            sync: Spread::from_timing(&self.sync),
        }
    }
}

/// A run file that is never finished.
struct RunFile {
    writer: RunWriter,
    channels: Vec<ChannelId>,
    seq: u64,
    times: WriteTimes,
}

impl RunFile {
    fn begin(folder: &Path) -> Result<Self, RunError> {
        let clock = RunClock::now();
        let mut writer = RunWriter::create(&folder.join("run.mcap"), clock, &BTreeMap::new(), &[])?;
        let channels = channels().into_iter().map(|spec| writer.add_channel(&spec)).collect::<Result<_, _>>()?;
        Ok(Self { writer, channels, seq: 0, times: WriteTimes::new() })
    }

    /// Writes a batch and waits until the disk has confirmed it. The recorder does not wait: a separate thread syncs
    /// its file.
    fn write(&mut self, batch: &[Cycle], watch: &Watch) -> Answer {
        let syncs = |writer: &RunWriter| (writer.sync_report().done, writer.sync_report().failed);
        self.settle(watch)?;
        let before = syncs(&self.writer);
        let begin_ns = now_ns();
        for cycle in batch {
            self.seq += 1;
            for ((header, sample), channel) in flight::samples(cycle).into_iter().zip(&self.channels) {
                self.writer.write(*channel, self.seq, now_ns(), header.stamp_ns, sample).map_err(Failure::not_now)?;
            }
        }
        self.writer.flush().map_err(Failure::not_now)?;
        let writing_ns = now_ns() - begin_ns;
        while syncs(&self.writer) == before {
            std::thread::sleep(POLL_INTERVAL);
            watch.check_stop()?;
        }
        let report = self.writer.sync_report();
        if report.failing {
            return Err(Failure::NotNow("the disk does not confirm writes".to_owned()));
        }
        self.times.add(writing_ns, report.last_ns);
        Ok(())
    }

    /// Waits for the sync that the creation of the file requested.
    fn settle(&self, watch: &Watch) -> Answer {
        while self.writer.sync_report().done + self.writer.sync_report().failed == 0 {
            std::thread::sleep(POLL_INTERVAL);
            watch.check_stop()?;
        }
        Ok(())
    }
}

fn channels() -> Vec<ChannelSpec> {
    let specs = [
        ChannelSpec::for_type::<messages::MotorInput>,
        ChannelSpec::for_type::<messages::MotorState>,
        ChannelSpec::for_type::<messages::MotorAuthority>,
        ChannelSpec::for_type::<messages::MotorSlots>,
        ChannelSpec::for_type::<messages::NodeEstimate>,
        ChannelSpec::for_type::<messages::MotorCommand>,
        ChannelSpec::for_type::<messages::ControlStatus>,
        ChannelSpec::for_type::<messages::Energy>,
    ];
    specs.iter().zip(flight::CHANNELS).map(|(spec, name)| spec(name)).collect()
}

/// A plain file.
struct PlainFile {
    file: BufWriter<File>,
    times: WriteTimes,
}

impl PlainFile {
    fn begin(folder: &Path) -> std::io::Result<Self> {
        Ok(Self { file: BufWriter::new(File::create_new(folder.join("plain"))?), times: WriteTimes::new() })
    }

    fn write(&mut self, batch: &[Cycle]) -> std::io::Result<()> {
        let begin_ns = now_ns();
        for (_, sample) in batch.iter().flat_map(flight::samples) {
            self.file.write_all(sample)?;
        }
        self.file.flush()?;
        let written_ns = now_ns();
        self.file.get_ref().sync_data()?;
        self.times.add(written_ns - begin_ns, now_ns() - written_ns);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn required_space_is_the_recorder_reserve_plus_both_files() {
        let wanted = 500_000_000 + 2 * MAX_BYTES;
        assert_eq!(room(wanted, 500_000_000), Ok(()));
        let sentence = room(wanted - 1, 500_000_000).unwrap_err();
        assert!(sentence.contains("634 MB") && sentence.contains("--runs"), "{sentence}");
        assert!(room(u64::MAX, u64::MAX).is_ok() && room(0, 0).is_err());
    }

    #[test]
    fn speed_is_bytes_divided_by_total_time() {
        let mut times = WriteTimes::new();
        times.add(1_000_000, 3_000_000);
        times.add(2_000_000, 14_000_000);
        let way = times.stats(2_000_000);
        assert!((way.mb_s - 100.0).abs() < 1e-9, "{way:?}");
        assert_eq!((way.batch.count, way.batch.worst_s, way.sync.worst_s), (2, 0.016, 0.014));
    }

    #[test]
    fn every_channel_has_its_own_type() {
        let cycle = &flight::fly(&flight::scenario(&Settings::default()).unwrap()).unwrap()[0];
        let sizes: Vec<usize> = channels().iter().map(|spec| spec.size).collect();
        assert_eq!(sizes, flight::samples(cycle).map(|(_, sample)| sample.len()));
    }
}
