//! Recovers run files that were not closed, because their recorder was killed or the power failed. They are searched in
//! all runs beside the present one, independently of shared memory, and closed on a separate thread.

use runlog::{PART_ENDING, RunError};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant, SystemTime};

/// Age below which a file is not touched yet: a recorder may just have created it without locking it.
const FRESH: Duration = Duration::from_secs(1);

/// Progress of the recovery of a file, as a sentence.
pub enum RecoveryEvent {
    /// Its recovery has started.
    Started(String),
    /// It is complete.
    Recovered(String),
    /// It could not be recovered.
    Failed(String),
}

/// Recovery of unfinished runs on its own thread.
#[derive(Default)]
pub struct UnfinishedRuns {
    news: Option<Receiver<RecoveryEvent>>,
}

impl UnfinishedRuns {
    /// Starts the recovery of every run in `folders` and of `runs`, except the `present` one, whose recorder runs and
    /// keeps `leave_bytes` free.
    ///
    /// # Errors
    /// No thread can be started.
    pub fn recover(
        folders: Vec<PathBuf>,
        runs: Vec<PathBuf>,
        present: PathBuf,
        leave_bytes: u64,
    ) -> std::io::Result<Self> {
        let (say, news) = channel();
        std::thread::Builder::new().name("recover".to_owned()).spawn(move || {
            // On Linux niceness is per thread: the robot's processes take precedence.
            let _ = rustix::process::nice(10);
            for part in left_in(&folders, &runs, &present) {
                recover_one(&part, leave_bytes, &say);
            }
        })?;
        Ok(Self { news: Some(news) })
    }

    /// Events since the last call.
    pub fn new_events(&mut self) -> Vec<RecoveryEvent> {
        self.news.as_ref().map(|news| news.try_iter().collect()).unwrap_or_default()
    }

    /// Waits for the remaining events, at most for `patience`: the next start recovers the rest.
    pub fn finish(&mut self, patience: Duration) -> Vec<RecoveryEvent> {
        let (give_up, mut heard) = (Instant::now() + patience, Vec::new());
        let Some(news) = self.news.take() else { return heard };
        while let Ok(one) = news.recv_timeout(give_up.saturating_duration_since(Instant::now())) {
            heard.push(one);
        }
        heard
    }
}

fn recover_one(part: &Path, leave_bytes: u64, say: &Sender<RecoveryEvent>) {
    let fresh = |part: &Path| {
        let written = fs::metadata(part).and_then(|file| file.modified()).ok();
        // After a clock step backwards, a file from the future does not count as fresh.
        written.and_then(|at| SystemTime::now().duration_since(at).ok()).is_some_and(|age| age < FRESH)
    };
    // Once only: a file that stays fresh is that of another robot, whose recorder has locked it by then.
    if fresh(part) {
        std::thread::sleep(FRESH);
    }
    let tell = |news| {
        // The supervisor may have ended meanwhile.
        let _ = say.send(news);
    };
    let mut initial = false;
    let result = runlog::recover_leaving(part, leave_bytes, &mut |done, all| {
        // A small file completes in one step; its start is not reported.
        if done < all && !std::mem::replace(&mut initial, true) {
            tell(RecoveryEvent::Started(format!(
                "recovering {} ({:.0} MB), which was not closed",
                part.display(),
                all as f64 * 1e-6
            )));
        }
    });
    match result {
        Ok(recovery) => tell(RecoveryEvent::Recovered(format!(
            "{} was not closed by its recorder and has been recovered: {} samples",
            part.display(),
            recovery.messages
        ))),
        // A recorder is still writing to it.
        Err(RunError::Busy { .. }) => {}
        // Another process has recovered it.
        Err(_) if !part.exists() => {}
        Err(error) => tell(RecoveryEvent::Failed(format!(
            "{} could not be recovered: {error}; try again with `nims recover {}`",
            part.display(),
            part.parent().unwrap_or(Path::new(".")).display()
        ))),
    }
}

/// Run files that were not closed, the newest run first.
fn left_in(folders: &[PathBuf], runs: &[PathBuf], present: &Path) -> Vec<PathBuf> {
    let inside = |folder: &PathBuf| fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let whole = |path: PathBuf| path.canonicalize().ok();
    let all: BTreeSet<PathBuf> = folders
        .iter()
        .flat_map(inside)
        .chain(runs.iter().cloned())
        .filter(|path| path.is_dir())
        .filter_map(whole)
        .collect();
    all.iter().rev().filter(|run| *run != present).flat_map(|run| parts(run)).collect()
}

/// Run files of one run that were not closed.
pub fn parts(run: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(run).into_iter().flatten().flatten();
    let mut parts: Vec<PathBuf> =
        entries.map(|entry| entry.path()).filter(|path| path.to_string_lossy().ends_with(PART_ENDING)).collect();
    parts.sort();
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{Message, TruthNode};
    use runlog::{ChannelSpec, RunClock, RunWriter};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};

    /// A file as a power cut leaves it; while the returned writer lives, its recorder still runs.
    fn unfinished(run: &Path) -> RunWriter {
        fs::create_dir_all(run).unwrap();
        let mut writer = RunWriter::create(&run.join("run.mcap"), RunClock::now(), &Default::default(), &[]).unwrap();
        let channel = writer.add_channel(&ChannelSpec::for_type::<TruthNode>("truth/node")).unwrap();
        let mut sample = TruthNode::default();
        sample.header_mut().seq = 1;
        writer.write(channel, 1, 1, 1, bytemuck::bytes_of(&sample)).unwrap();
        writer.flush().unwrap();
        writer
    }

    #[test]
    fn runs_cut_off_by_a_power_failure_are_recovered_and_the_file_of_a_running_recorder_is_untouched() {
        let folder = tempfile::tempdir().unwrap();
        let runs = folder.path().canonicalize().unwrap();
        for name in ["first", "second"] {
            unfinished(&runs.join(name)).give_up();
        }
        // The newest run is that of another robot, whose recorder never stops writing.
        let (living, present) = (unfinished(&runs.join("z-living")), unfinished(&runs.join("present")));
        let (part, recording) = (runs.join("z-living/run.mcap.part"), Arc::new(AtomicBool::new(true)));
        let records = Arc::clone(&recording);
        let recorder = std::thread::spawn(move || {
            while records.load(Ordering::Relaxed) {
                fs::File::open(&part).unwrap().set_modified(SystemTime::now()).unwrap();
                std::thread::sleep(Duration::from_millis(100));
            }
        });
        fs::create_dir(runs.join("whole")).unwrap();
        fs::write(runs.join("whole/run.mcap"), "").unwrap();
        fs::write(runs.join("note.mcap.part"), "in no run").unwrap();

        let mut unfinished_runs =
            UnfinishedRuns::recover(vec![runs.clone()], vec![runs.join("first")], runs.join("present"), 1).unwrap();
        let mut recovered = Vec::new();
        for news in unfinished_runs.finish(Duration::from_secs(60)) {
            match news {
                RecoveryEvent::Started(_) => {}
                RecoveryEvent::Recovered(sentence) => recovered.push(sentence),
                RecoveryEvent::Failed(sentence) => panic!("{sentence}"),
            }
        }
        recording.store(false, Ordering::Relaxed);
        recorder.join().unwrap();
        assert_eq!(recovered.len(), 2, "{recovered:?}");
        for name in ["first", "second"] {
            assert!(!runs.join(name).join("run.mcap.part").exists());
            assert_eq!(runlog::read_channel::<TruthNode>(&runs.join(name), "truth/node").unwrap().len(), 1);
        }
        for (name, writer) in [("z-living", living), ("present", present)] {
            assert!(runs.join(name).join("run.mcap.part").exists(), "{name}");
            writer.finish(&Default::default()).unwrap();
        }
    }
}
