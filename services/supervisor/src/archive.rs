//! Writes into the run folder while the robot runs, on its own thread: a disk can block its writer for seconds.

use super::copies::SharedCopies;
use config::file::replace;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::time::{Duration, Instant};
use std::{fs, io};

/// Folder for copies of the missions of the run.
pub const MISSIONS: &str = runlog::ATTACHED_FOLDERS[0];
/// Folder for copies of the files that processes were started with.
pub const PROCESSES: &str = runlog::ATTACHED_FOLDERS[1];
/// Largest file that is copied, bytes; a larger one is not a configuration file.
const LARGEST: u64 = 1 << 20;
/// Most characters of a mission's name in the name of its copy.
const LONGEST_NAME: usize = 60;
/// Longest wait for the files of a request: less than the heartbeat timeout after which motor-io treats the supervisor
/// as dead.
pub const PATIENCE: Duration = Duration::from_millis(1500);

enum Job {
    /// Copies a file to `PLACE/NUMBER-NAME`.
    Copy { original: PathBuf, place: &'static str, name: String, always: bool },
    /// Copies a file that a process is about to read, and sends the path of the copy.
    CopyNow { original: PathBuf, name: String, copy: Sender<PathBuf> },
    /// Restores a run folder that was removed.
    Restore { manifest: (PathBuf, String) },
    /// Replaces files, each atomically, and sends why not; without a receiver that is reported.
    Write { files: Vec<(PathBuf, String)>, written: Option<SyncSender<Result<(), String>>> },
}

/// Carries out write jobs in the order in which they were queued.
pub struct Archive {
    jobs: Option<Sender<Job>>,
    troubles: Receiver<String>,
}

impl Archive {
    /// Starts the worker for that run folder, of which the supervisor holds these copies.
    ///
    /// # Errors
    /// No thread can be started.
    pub fn open(run: &Path, copies: SharedCopies) -> io::Result<Self> {
        let ((jobs, queue), (report, troubles)) = (channel(), channel());
        let mut shelf = ArchiveWorker { run: run.to_owned(), copies, ..ArchiveWorker::default() };
        let work = move || {
            for job in queue {
                if let Err(trouble) = shelf.carry_out(&job) {
                    // The supervisor may already have dropped the receiver.
                    let _ = report.send(trouble);
                }
            }
        };
        std::thread::Builder::new().name("archive".to_owned()).spawn(work)?;
        Ok(Self { jobs: Some(jobs), troubles })
    }

    /// Stores a copy of a mission that was started, under its name; one copy for each start.
    pub fn copy_mission(&self, mission: &str, original: PathBuf) {
        let letters = mission.chars().take(LONGEST_NAME);
        let plain: String = letters.map(|c| if c.is_alphanumeric() || "-_. ".contains(c) { c } else { '-' }).collect();
        let name = format!("{plain}.toml");
        self.send(Job::Copy { original, place: MISSIONS, name, always: true });
    }

    /// Stores a copy of a file that a process is started with; one copy as long as the file does not change.
    pub fn copy_process_file(&self, process: &str, original: PathBuf) {
        let name = format!("{process}-{}", name_of(&original));
        self.send(Job::Copy { original, place: PROCESSES, name, always: false });
    }

    /// When the caller stops to wait for copies that it requests now.
    #[must_use]
    pub fn deadline() -> Instant {
        Instant::now() + PATIENCE
    }

    /// The copy of a file that a process reads in place of the original; `None` if it could not be made in time.
    pub fn copy_for(&self, process: &str, original: PathBuf, give_up: Instant) -> Option<PathBuf> {
        let name = format!("{process}-{}", name_of(&original));
        let (copy, made) = channel();
        self.send(Job::CopyNow { original, name, copy });
        made.recv_timeout(give_up.saturating_duration_since(Instant::now())).ok()
    }

    /// Replaces files of the run folder, and its copies of them.
    ///
    /// # Errors
    /// Why they are not written, as a clause. After a timeout they may still be written later.
    pub fn write_in_time(&self, files: Vec<(PathBuf, String)>) -> Result<(), String> {
        // Without room for a result: the worker learns whether the change counts.
        let (written, result) = sync_channel(0);
        self.send(Job::Write { files, written: Some(written) });
        result.recv_timeout(PATIENCE).unwrap_or_else(|_| Err("the disk of the run does not answer".to_owned()))
    }

    /// Restores the run folder, if it was removed: the configuration, the copies, and then the manifest, whose presence
    /// marks a complete folder.
    pub fn restore(&self, manifest: (PathBuf, String)) {
        self.send(Job::Restore { manifest });
    }

    /// Replaces a file; its folder has to be there.
    pub fn write(&self, path: PathBuf, text: String) {
        self.send(Job::Write { files: vec![(path, text)], written: None });
    }

    fn send(&self, job: Job) {
        if let Some(jobs) = &self.jobs {
            // The worker runs until the queue is closed.
            let _ = jobs.send(job);
        }
    }

    /// What to report since the last call, in sentences: what could not be written, and a folder that was restored.
    pub fn take_reports(&self) -> Vec<String> {
        self.troubles.try_iter().collect()
    }

    /// Waits for that long until everything is written; returns what is left to report, and whether all was written.
    pub fn finish(&mut self, time: Duration) -> (Vec<String>, bool) {
        self.jobs = None;
        let (give_up, mut reports) = (Instant::now() + time, Vec::new());
        loop {
            match self.troubles.recv_timeout(give_up.saturating_duration_since(Instant::now())) {
                Ok(report) => reports.push(report),
                Err(RecvTimeoutError::Timeout) => return (reports, false),
                // The worker has nothing left.
                Err(RecvTimeoutError::Disconnected) => return (reports, true),
            }
        }
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

#[derive(Default)]
struct ArchiveWorker {
    run: PathBuf,
    copies: SharedCopies,
    /// Number of files in each place so far.
    numbers: BTreeMap<&'static str, usize>,
    /// The newest copy under each name.
    last: BTreeMap<(&'static str, String), PathBuf>,
    /// The content of each copy, because the run folder may be removed.
    contents: BTreeMap<PathBuf, Vec<u8>>,
}

impl ArchiveWorker {
    fn carry_out(&mut self, job: &Job) -> Result<(), String> {
        match job {
            Job::Copy { original, place, name, always } => self.copy(original, place, name, *always).map(|_| ()),
            Job::CopyNow { original, name, copy } => self.copy(original, PROCESSES, name, false).map(|path| {
                // The requester may have timed out.
                let _ = copy.send(path);
            }),
            Job::Restore { manifest } => self.restore(manifest),
            Job::Write { files, written } => self.write_all(files, written.as_ref()),
        }
    }

    fn write_all(
        &self,
        files: &[(PathBuf, String)],
        written: Option<&SyncSender<Result<(), String>>>,
    ) -> Result<(), String> {
        // Until the copies agree with the files, the start of a process must not compare them.
        let _alone = self.copies.alone();
        let result = files.iter().try_for_each(|(path, text)| write(path, text.as_bytes()));
        let Some(written) = written else { return result };
        let is_written = result.is_ok();
        // A requester that timed out does not make the change.
        if written.send(result).is_ok() && is_written {
            for (path, text) in files {
                self.copies.with(|copies| copies.add(&name_of(path), text.clone()));
            }
        }
        Ok(())
    }

    fn copy(&mut self, original: &Path, place: &'static str, name: &str, always: bool) -> Result<PathBuf, String> {
        self.try_copy(original, place, name, always)
            .map_err(|error| format!("{} cannot be copied to {}: {error}", original.display(), self.run.display()))
    }

    fn try_copy(&mut self, original: &Path, place: &'static str, name: &str, always: bool) -> io::Result<PathBuf> {
        if fs::metadata(original)?.len() > LARGEST {
            return Err(io::Error::other(format!("it has more than {LARGEST} bytes")));
        }
        let (bytes, key) = (fs::read(original)?, (place, name.to_owned()));
        if let Some(copy) = self.last.get(&key).filter(|copy| !always && self.contents.get(*copy) == Some(&bytes)) {
            return Ok(copy.clone());
        }
        let folder = self.run.join(place);
        fs::create_dir_all(&folder)?;
        let number = self.numbers.entry(place).or_default();
        let copy = folder.join(format!("{}-{name}", *number + 1));
        replace(&copy, &bytes)?;
        *number += 1;
        self.last.insert(key, copy.clone());
        self.contents.insert(copy.clone(), bytes);
        Ok(copy)
    }

    fn restore(&self, (manifest, text): &(PathBuf, String)) -> Result<(), String> {
        // A manifest that was written meanwhile makes no complete folder.
        if manifest.exists() && self.contents.keys().all(|copy| copy.exists()) {
            return Ok(());
        }
        let restored = self.copies.restore(&self.run);
        if restored.back.is_ok() {
            for (copy, bytes) in self.contents.iter().filter(|(copy, _)| !copy.exists()) {
                let folder = copy.parent().unwrap_or(self.run.as_path());
                fs::create_dir_all(folder).map_err(|error| format!("{} cannot be made: {error}", folder.display()))?;
                write(copy, bytes)?;
            }
            write(manifest, text.as_bytes())?;
        }
        restored.sentence(&self.run).map_or(Ok(()), Err)
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), String> {
    replace(path, bytes).map_err(|error| format!("{} cannot be written: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOON: Duration = Duration::from_secs(20);

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(folder).unwrap().map(|entry| name_of(&entry.unwrap().path())).collect();
        names.sort();
        names
    }

    #[test]
    fn each_start_of_a_mission_has_a_copy_and_an_unchanged_file_has_one() {
        let (run, given) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let file = given.path().join("wind.toml");
        let mut archive = Archive::open(run.path(), SharedCopies::default()).unwrap();
        // Once: the worker reads it meanwhile.
        fs::write(&file, "a = 1\n").unwrap();
        for _ in 0..2 {
            archive.copy_mission("wind", file.clone());
            archive.copy_process_file("wind", file.clone());
        }
        archive.copy_process_file("other", file.clone());
        archive.copy_process_file("gone", given.path().join("gone.toml"));
        archive.write(run.path().join("manifest.json"), "{}\n".to_owned());
        let (troubles, true) = archive.finish(SOON) else { panic!() };
        assert!(troubles.len() == 1 && troubles[0].contains("gone.toml"), "{troubles:?}");
        assert_eq!(names(&run.path().join(MISSIONS)), ["1-wind.toml", "2-wind.toml"]);
        assert_eq!(names(&run.path().join(PROCESSES)), ["1-wind-wind.toml", "2-other-wind.toml"]);
        assert_eq!(fs::read_to_string(run.path().join("manifest.json")).unwrap(), "{}\n");

        let mut archive = ArchiveWorker { run: run.path().to_owned(), ..ArchiveWorker::default() };
        for (text, expected) in [("b = 1", "1"), ("b = 1", "1"), ("b = 2", "2")] {
            fs::write(&file, text).unwrap();
            archive.copy(&file, PROCESSES, "again.toml", false).unwrap();
            let newest = run.path().join(PROCESSES).join(format!("{expected}-again.toml"));
            assert_eq!(fs::read_to_string(newest).unwrap(), text);
        }
    }

    #[test]
    fn a_disk_that_does_not_answer_delays_a_request_once() {
        let (run, given) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let copies = SharedCopies::default();
        let mut archive = Archive::open(run.path(), copies.clone()).unwrap();
        let kept = run.path().join("set.toml");
        archive.write_in_time(vec![(kept.clone(), "a = 1\n".to_owned())]).unwrap();
        drop(copies.alone());
        let text = || copies.with(|copies| copies.text("set.toml")).unwrap();
        assert_eq!(text(), "a = 1\n");
        assert_eq!(fs::read_to_string(&kept).unwrap(), "a = 1\n");
        let refused = archive.write_in_time(vec![(kept.join("x"), String::new())]).unwrap_err();
        assert!(refused.contains("set.toml"), "{refused}");
        // Nothing writes to the pipe, so the worker waits for its content.
        let pipe = given.path().join("wind.toml");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let (begun, give_up) = (Instant::now(), Archive::deadline());
        for process in ["wind", "soil", "rain"] {
            assert_eq!(archive.copy_for(process, pipe.clone(), give_up), None);
        }
        assert!(begun.elapsed() < 2 * PATIENCE, "{:?}", begun.elapsed());
        assert!(archive.write_in_time(vec![(kept, String::new())]).is_err());
        assert_eq!(archive.finish(Duration::from_millis(10)), (Vec::new(), false));
        let writer = fs::OpenOptions::new().write(true).open(&pipe).unwrap();
        fs::remove_file(&pipe).unwrap();
        drop(writer);
        let (troubles, true) = archive.finish(SOON) else { panic!() };
        assert_eq!(troubles.len(), 2, "the other two copies");
        assert_eq!(text(), "a = 1\n", "the change came too late");
    }

    #[test]
    fn copies_that_were_removed_with_the_folder_are_restored() {
        let (parent, given) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let (run, file) = (parent.path().join("run"), given.path().join("over.toml"));
        let copies = SharedCopies::default();
        copies.with(|copies| copies.add("robot.toml", "r = 1\n".to_owned()));
        let mut archive = Archive::open(&run, copies).unwrap();
        fs::write(&file, "w = 1\n").unwrap();
        let copy = archive.copy_for("wind", file.clone(), Archive::deadline()).unwrap();
        for text in ["a = 1\n", "a = 2\n"] {
            fs::write(&file, text).unwrap();
            archive.copy_mission("over", file.clone());
            // Jobs run in order: when this copy exists, the previous one does too.
            archive.copy_for(&text[4..5], file.clone(), Archive::deadline()).unwrap();
        }
        let manifest = (run.join("manifest.json"), "{}\n".to_owned());
        archive.restore((file.clone(), String::new()));
        archive.copy_for("last", file.clone(), Archive::deadline()).unwrap();
        fs::remove_dir_all(&run).unwrap();
        archive.restore(manifest.clone());
        let (reports, true) = archive.finish(SOON) else { panic!() };
        // Nothing of a folder whose manifest is there.
        assert!(reports.len() == 1 && reports[0].contains("robot.toml"), "{reports:?}");
        let read = |path: PathBuf| fs::read_to_string(path).unwrap();
        assert_eq!(read(copy), "w = 1\n");
        assert_eq!(read(run.join(MISSIONS).join("1-over.toml")), "a = 1\n");
        assert_eq!(read(run.join(MISSIONS).join("2-over.toml")), "a = 2\n");
        assert_eq!(read(run.join("robot.toml")), "r = 1\n");
        assert_eq!(read(manifest.0), manifest.1);
    }
}
