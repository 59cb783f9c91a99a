//! Run files that no recorder closed, because it was killed or the power went: found in all runs beside the present
//! one, whatever shared memory still knows of them, and closed beside the supervisor's own loop.

use runlog::{PART_ENDING, RunError};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant, SystemTime};

/// A file that somebody wrote to a moment ago may be one that is just being made, and not locked yet.
const FRESH: Duration = Duration::from_secs(1);

/// What became of a file.
pub enum RecoveryEvent {
    /// It is being recovered.
    Started(String),
    /// It is whole again.
    Recovered(String),
    /// It is not.
    Failed(String),
}

/// Recovers what was left.
#[derive(Default)]
pub struct UnfinishedRuns {
    news: Option<Receiver<RecoveryEvent>>,
}

impl UnfinishedRuns {
    /// Begins with every run in these folders, and with these runs, but not with the `present` one, whose recorder
    /// looks after itself.
    ///
    /// # Errors
    /// The system has no thread for it.
    pub fn recover(folders: Vec<PathBuf>, runs: Vec<PathBuf>, present: PathBuf) -> std::io::Result<Self> {
        let (say, news) = channel();
        std::thread::Builder::new().name("recover".to_owned()).spawn(move || {
            // On Linux this is the thread's own niceness: the robot goes first.
            let _ = rustix::process::nice(10);
            for part in left_in(&folders, &runs, &present) {
                recover_one(&part, &say);
            }
        })?;
        Ok(Self { news: Some(news) })
    }

    /// What has come of it since the last time.
    pub fn news(&mut self) -> Vec<RecoveryEvent> {
        self.news.as_ref().map(|news| news.try_iter().collect()).unwrap_or_default()
    }

    /// Waits for the rest, at most as long as said: what is not done by then is done by the next start.
    pub fn finish(&mut self, patience: Duration) -> Vec<RecoveryEvent> {
        let (give_up, mut heard) = (Instant::now() + patience, Vec::new());
        let Some(news) = self.news.take() else { return heard };
        while let Ok(one) = news.recv_timeout(give_up.saturating_duration_since(Instant::now())) {
            heard.push(one);
        }
        heard
    }
}

fn recover_one(part: &Path, say: &Sender<RecoveryEvent>) {
    let fresh = |part: &Path| {
        let written = fs::metadata(part).and_then(|file| file.modified()).ok();
        // A clock that was set back makes nothing fresh.
        written.and_then(|at| SystemTime::now().duration_since(at).ok()).is_some_and(|age| age < FRESH)
    };
    while fresh(part) {
        std::thread::sleep(FRESH);
    }
    let tell = |news| {
        // The run may have ended meanwhile.
        let _ = say.send(news);
    };
    let mut initial = false;
    let result = runlog::recover(part, &mut |done, all| {
        // Of a small one, the end is news enough.
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
        // A recorder is still there.
        Err(RunError::Busy { .. }) => {}
        // Somebody else was faster.
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

    /// A file as a power cut leaves it, or (given back) with its recorder alive.
    fn unfinished(run: &Path) -> RunWriter {
        fs::create_dir_all(run).unwrap();
        let mut writer = RunWriter::create(&run.join("run.mcap"), RunClock::now(), &Default::default(), &[]).unwrap();
        let channel = writer.add_channel(&ChannelSpec::of::<TruthNode>("truth/node")).unwrap();
        let mut sample = TruthNode::default();
        sample.header_mut().seq = 1;
        writer.write(channel, 1, 1, 1, bytemuck::bytes_of(&sample)).unwrap();
        writer.flush().unwrap();
        writer
    }

    #[test]
    fn what_a_power_cut_left_in_any_run_is_recovered_and_a_living_recorder_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let runs = folder.path().canonicalize().unwrap();
        for name in ["first", "second"] {
            unfinished(&runs.join(name)).give_up();
        }
        let (living, present) = (unfinished(&runs.join("living")), unfinished(&runs.join("present")));
        fs::create_dir(runs.join("whole")).unwrap();
        fs::write(runs.join("whole/run.mcap"), "").unwrap();
        fs::write(runs.join("note.mcap.part"), "in no run").unwrap();

        let mut unfinished_runs =
            UnfinishedRuns::recover(vec![runs.clone()], vec![runs.join("first")], runs.join("present")).unwrap();
        let mut recovered = Vec::new();
        for news in unfinished_runs.finish(Duration::from_secs(60)) {
            match news {
                RecoveryEvent::Started(_) => {}
                RecoveryEvent::Recovered(sentence) => recovered.push(sentence),
                RecoveryEvent::Failed(sentence) => panic!("{sentence}"),
            }
        }
        assert_eq!(recovered.len(), 2, "{recovered:?}");
        for name in ["first", "second"] {
            assert!(!runs.join(name).join("run.mcap.part").exists());
            assert_eq!(runlog::read_channel::<TruthNode>(&runs.join(name), "truth/node").unwrap().len(), 1);
        }
        for (name, writer) in [("living", living), ("present", present)] {
            assert!(runs.join(name).join("run.mcap.part").exists(), "{name}");
            writer.finish(&Default::default()).unwrap();
        }
    }
}
