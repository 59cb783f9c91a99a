//! Load on processors, memory and disk while wake-ups are measured, by threads of ordinary priority.

use super::args::Load;
use super::place::Scratch;
use command::{Answer, Failure};
use std::fs::File;
use std::hint::black_box;
use std::io::{Seek, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Memory that a thread walks through, bytes: more than the caches of the boards in docs/real-time.md.
const MEMORY_BYTES: usize = 64 << 20;
/// Text that is written to the disk at a time, bytes, and the size at which the file begins again.
const BLOCK_BYTES: usize = 1 << 20;
const FILE_BYTES: u64 = 256 << 20;
/// Pause after each block: 5 MB/s is five times what a robot records, and 50 GB in a certificate at 100 Hz; a disk at
/// its full speed would be worn out.
const WRITE_PAUSE: Duration = Duration::from_millis(200);

/// What the load did, as the certificate states it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Done {
    /// Threads that computed.
    pub processors: usize,
    /// Copied memory, bytes.
    pub copied_bytes: u64,
    /// Bytes that the disk confirmed.
    pub written_bytes: u64,
}

/// Running load.
pub struct Running {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<std::io::Result<()>>>,
    processors: usize,
    copied: Arc<AtomicU64>,
    written: Arc<AtomicU64>,
    _scratch: Option<Scratch>,
}

impl Running {
    /// Starts it; its file is in the folder of the runs.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn start(load: Load, runs: &Path) -> Answer<Self> {
        let mut running = Self {
            stop: Arc::default(),
            threads: Vec::new(),
            processors: 0,
            copied: Arc::default(),
            written: Arc::default(),
            _scratch: None,
        };
        if load == Load::None {
            return Ok(running);
        }
        let scratch = Scratch::create(runs)?;
        running.processors = std::thread::available_parallelism().map_or(1, usize::from);
        for _ in 0..running.processors {
            let stop = Arc::clone(&running.stop);
            running.add(move || compute(&stop));
        }
        let (stop, copied) = (Arc::clone(&running.stop), Arc::clone(&running.copied));
        running.add(move || copy(&stop, &copied));
        let file = File::create(scratch.folder().join("load")).map_err(Failure::not_now)?;
        let (stop, written) = (Arc::clone(&running.stop), Arc::clone(&running.written));
        running.add(move || write(&stop, file, &written));
        running._scratch = Some(scratch);
        Ok(running)
    }

    fn add(&mut self, work: impl FnOnce() -> std::io::Result<()> + Send + 'static) {
        self.threads.push(std::thread::spawn(|| {
            runtime::realtime::ordinary();
            work()
        }));
    }

    /// Ends it.
    ///
    /// # Errors
    /// A part of the load failed, so that the measurement was not made under it.
    pub fn end(mut self) -> Answer<Done> {
        self.stop.store(true, Ordering::Relaxed);
        for thread in std::mem::take(&mut self.threads) {
            let ended = thread.join().map_err(|_| Failure::NotNow("a thread of the load failed".to_owned()))?;
            ended.map_err(|error| Failure::NotNow(format!("the load on the disk failed: {error}")))?;
        }
        Ok(Done {
            processors: self.processors,
            copied_bytes: self.copied.load(Ordering::Relaxed),
            written_bytes: self.written.load(Ordering::Relaxed),
        })
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

fn compute(stop: &AtomicBool) -> std::io::Result<()> {
    let mut value = 0u64;
    while !stop.load(Ordering::Relaxed) {
        for _ in 0..100_000 {
            value = black_box(value.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1));
        }
    }
    Ok(())
}

fn copy(stop: &AtomicBool, copied: &AtomicU64) -> std::io::Result<()> {
    let (mut from, mut to) = (vec![1u8; MEMORY_BYTES / 2], vec![0u8; MEMORY_BYTES / 2]);
    while !stop.load(Ordering::Relaxed) {
        to.copy_from_slice(black_box(&from));
        std::mem::swap(&mut from, &mut to);
        copied.fetch_add(MEMORY_BYTES as u64 / 2, Ordering::Relaxed);
    }
    Ok(())
}

fn write(stop: &AtomicBool, mut file: File, written: &AtomicU64) -> std::io::Result<()> {
    let block = vec![0x5a; BLOCK_BYTES];
    let mut size = 0;
    while !stop.load(Ordering::Relaxed) {
        file.write_all(&block)?;
        file.sync_data()?;
        size += BLOCK_BYTES as u64;
        written.fetch_add(BLOCK_BYTES as u64, Ordering::Relaxed);
        if size >= FILE_BYTES {
            file.rewind()?;
            size = 0;
        }
        std::thread::sleep(WRITE_PAUSE);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    #[test]
    fn every_part_of_the_load_works_and_leaves_nothing() {
        let runs = tempfile::tempdir().unwrap();
        let running = Running::start(Load::All, runs.path()).unwrap();
        let give_up = Instant::now() + Duration::from_secs(60);
        while running.copied.load(Ordering::Relaxed) == 0 || running.written.load(Ordering::Relaxed) == 0 {
            assert!(Instant::now() < give_up, "the load does nothing");
            std::thread::sleep(Duration::from_millis(5));
        }
        let done = running.end().unwrap();
        assert!(done.processors >= 1 && done.copied_bytes > 0 && done.written_bytes > 0, "{done:?}");
        assert_eq!(std::fs::read_dir(runs.path()).unwrap().count(), 0);
    }

    #[test]
    fn no_load_does_nothing() {
        let done = Running::start(Load::None, Path::new("/proc/nothing")).unwrap().end().unwrap();
        assert_eq!(done, Done::default());
        assert!(Running::start(Load::All, Path::new("/proc/nothing")).is_err());
    }
}
