//! Writing into the run folder while the robot runs, beside the supervisor's own loop: a disk can make its writer wait for seconds.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;
use std::{fs, io};

/// Where the missions that were flown are kept.
pub const MISSIONS: &str = runlog::KEPT_FOLDERS[0];
/// Where the files are kept that processes were started with.
pub const PROCESSES: &str = runlog::KEPT_FOLDERS[1];
/// A larger file is no configuration, bytes.
const LARGEST: u64 = 1 << 20;
/// How long a process that is to be started waits for its copy of a file: less than what makes motor-io take the supervisor for dead.
const PATIENCE: Duration = Duration::from_millis(1500);

enum Job {
    /// Copies a file to `PLACE/NUMBER-NAME`.
    Keep { original: PathBuf, place: &'static str, name: String, always: bool },
    /// The same of a file that a process is about to read: where the copy is.
    KeepNow { original: PathBuf, name: String, copy: Sender<PathBuf> },
    /// Writes the copies again that are no longer there.
    PutBack,
    /// Replaces a file, whole or not at all.
    Write { path: PathBuf, text: String },
}

/// Writes what it is given, in the order in which it was given.
pub struct Archive {
    jobs: Option<Sender<Job>>,
    troubles: Receiver<String>,
    thread: Option<JoinHandle<()>>,
}

impl Archive {
    /// For that run folder.
    ///
    /// # Errors
    /// The system has no thread for it.
    pub fn open(run: &Path) -> io::Result<Self> {
        let ((jobs, wanted), (say, troubles)) = (channel(), channel());
        let mut shelf = ArchiveWorker { run: run.to_owned(), ..ArchiveWorker::default() };
        let work = move || {
            for job in wanted {
                if let Err(trouble) = shelf.carry_out(&job) {
                    // Without anyone to hear it, there is nobody to tell.
                    let _ = say.send(trouble);
                }
            }
        };
        let thread = std::thread::Builder::new().name("archive".to_owned()).spawn(work)?;
        Ok(Self { jobs: Some(jobs), troubles, thread: Some(thread) })
    }

    /// Keeps a copy of a mission that is flown; each flight has its own.
    pub fn copy_mission(&self, original: PathBuf) {
        let name = name_of(&original);
        self.send(Job::Keep { original, place: MISSIONS, name, always: true });
    }

    /// Keeps a copy of a file that a process is started with; once for as long as it stays the same.
    pub fn copy_process_file(&self, process: &str, original: PathBuf) {
        let name = format!("{process}-{}", name_of(&original));
        self.send(Job::Keep { original, place: PROCESSES, name, always: false });
    }

    /// The copy of a file that a process is to be started with, which it reads in place of the original; `None` if it could not be made in time.
    pub fn copy_for(&self, process: &str, original: PathBuf) -> Option<PathBuf> {
        let name = format!("{process}-{}", name_of(&original));
        let (copy, made) = channel();
        self.send(Job::KeepNow { original, name, copy });
        made.recv_timeout(PATIENCE).ok()
    }

    /// Writes the copies again that are no longer there, after the run folder was removed.
    pub fn put_back(&self) {
        self.send(Job::PutBack);
    }

    /// Replaces a file.
    pub fn write(&self, path: PathBuf, text: String) {
        self.send(Job::Write { path, text });
    }

    fn send(&self, job: Job) {
        if let Some(jobs) = &self.jobs {
            // It works until it is finished.
            let _ = jobs.send(job);
        }
    }

    /// What could not be written since the last time, in sentences.
    pub fn troubles(&self) -> Vec<String> {
        self.troubles.try_iter().collect()
    }

    /// Waits until all is written; what could not be.
    pub fn finish(&mut self) -> Vec<String> {
        self.jobs = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        self.troubles()
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

#[derive(Default)]
struct ArchiveWorker {
    run: PathBuf,
    /// Files in each place so far.
    numbers: BTreeMap<&'static str, usize>,
    /// The copy that was made last under each name.
    last: BTreeMap<(&'static str, String), PathBuf>,
    /// What is in each copy: the run folder may be removed.
    kept: BTreeMap<PathBuf, Vec<u8>>,
}

impl ArchiveWorker {
    fn carry_out(&mut self, job: &Job) -> Result<(), String> {
        match job {
            Job::Keep { original, place, name, always } => self.keep(original, place, name, *always).map(|_| ()),
            Job::KeepNow { original, name, copy } => self.keep(original, PROCESSES, name, false).map(|path| {
                // It may have been given up meanwhile.
                let _ = copy.send(path);
            }),
            Job::PutBack => self.put_back(),
            Job::Write { path, text } => {
                replace(path, text.as_bytes()).map_err(|error| format!("{} cannot be written: {error}", path.display()))
            }
        }
    }

    fn keep(&mut self, original: &Path, place: &'static str, name: &str, always: bool) -> Result<PathBuf, String> {
        self.try_to_keep(original, place, name, always).map_err(|error| {
            format!("no copy of {} could be kept in {}: {error}", original.display(), self.run.display())
        })
    }

    fn try_to_keep(&mut self, original: &Path, place: &'static str, name: &str, always: bool) -> io::Result<PathBuf> {
        if fs::metadata(original)?.len() > LARGEST {
            return Err(io::Error::other(format!("it has more than {LARGEST} bytes")));
        }
        let (bytes, key) = (fs::read(original)?, (place, name.to_owned()));
        if let Some(copy) = self.last.get(&key).filter(|copy| !always && self.kept.get(*copy) == Some(&bytes)) {
            return Ok(copy.clone());
        }
        let folder = self.run.join(place);
        fs::create_dir_all(&folder)?;
        let number = self.numbers.entry(place).or_default();
        let copy = folder.join(format!("{}-{name}", *number + 1));
        replace(&copy, &bytes)?;
        *number += 1;
        self.last.insert(key, copy.clone());
        self.kept.insert(copy.clone(), bytes);
        Ok(copy)
    }

    fn put_back(&self) -> Result<(), String> {
        for (copy, bytes) in self.kept.iter().filter(|(copy, _)| !copy.exists()) {
            let folder = copy.parent().unwrap_or(self.run.as_path());
            let written = fs::create_dir_all(folder).and_then(|()| replace(copy, bytes));
            written.map_err(|error| format!("{} cannot be written: {error}", copy.display()))?;
        }
        Ok(())
    }
}

/// Writes a file, whole or not at all: whoever reads it never sees half of it.
///
/// # Errors
/// Its folder cannot be written.
pub fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut fresh = path.as_os_str().to_owned();
    fresh.push(".new");
    fs::write(&fresh, bytes).and_then(|()| fs::rename(&fresh, path))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(folder).unwrap().map(|entry| name_of(&entry.unwrap().path())).collect();
        names.sort();
        names
    }

    #[test]
    fn each_flight_has_its_copy_and_a_file_that_stays_the_same_has_one() {
        let (run, given) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let file = given.path().join("wind.toml");
        let mut archive = Archive::open(run.path()).unwrap();
        for _ in 0..2 {
            fs::write(&file, "a = 1\n").unwrap();
            archive.copy_mission(file.clone());
            archive.copy_process_file("wind", file.clone());
        }
        archive.copy_process_file("other", file.clone());
        archive.copy_process_file("gone", given.path().join("gone.toml"));
        archive.write(run.path().join("manifest.json"), "{}\n".to_owned());
        let troubles = archive.finish();
        assert!(troubles.len() == 1 && troubles[0].contains("gone.toml"), "{troubles:?}");
        assert_eq!(names(&run.path().join(MISSIONS)), ["1-wind.toml", "2-wind.toml"]);
        assert_eq!(names(&run.path().join(PROCESSES)), ["1-wind-wind.toml", "2-other-wind.toml"]);
        assert_eq!(fs::read_to_string(run.path().join("manifest.json")).unwrap(), "{}\n");

        let mut archive = ArchiveWorker { run: run.path().to_owned(), ..ArchiveWorker::default() };
        for (text, expected) in [("b = 1", "1"), ("b = 1", "1"), ("b = 2", "2")] {
            fs::write(&file, text).unwrap();
            archive.keep(&file, PROCESSES, "again.toml", false).unwrap();
            let newest = run.path().join(PROCESSES).join(format!("{expected}-again.toml"));
            assert_eq!(fs::read_to_string(newest).unwrap(), text);
        }
    }

    #[test]
    fn copies_that_were_removed_with_the_folder_are_put_back() {
        let (parent, given) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let (run, file) = (parent.path().join("run"), given.path().join("over.toml"));
        let mut archive = Archive::open(&run).unwrap();
        fs::write(&file, "w = 1\n").unwrap();
        let copy = archive.copy_for("wind", file.clone()).unwrap();
        for text in ["a = 1\n", "a = 2\n"] {
            fs::write(&file, text).unwrap();
            archive.copy_mission(file.clone());
            // When this copy is made, the one before is made too.
            archive.copy_for(&text[4..5], file.clone()).unwrap();
        }
        fs::remove_dir_all(&run).unwrap();
        archive.put_back();
        assert!(archive.finish().is_empty());
        let read = |path: PathBuf| fs::read_to_string(path).unwrap();
        assert_eq!(read(copy), "w = 1\n");
        assert_eq!(read(run.join(MISSIONS).join("1-over.toml")), "a = 1\n");
        assert_eq!(read(run.join(MISSIONS).join("2-over.toml")), "a = 2\n");
    }
}
