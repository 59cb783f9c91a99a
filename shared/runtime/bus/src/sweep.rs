//! Cleaning up after processes that were killed.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use iceoryx2::prelude::{NodeBuilder, SignalHandlingMode, ipc};
use rustix::process::geteuid;

use crate::clock::{now_ns, sleep_until};
use crate::domain::SHARED_MEMORY;
use crate::error::Unfit;
use crate::{BusError, Domain};

/// Something is half made for a millisecond, and for as long as the machine stands still meanwhile; what is older was left by a killed process.
const HALF_MADE: Duration = Duration::from_secs(1);
/// Removing one dead process takes a millisecond; a cleaner that needs this long hangs.
const PATIENCE: Duration = Duration::from_secs(5);

/// What [`Domain::sweep`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Swept {
    /// Processes that live in the domain.
    pub alive: usize,
    /// Dead processes whose traces were removed.
    pub removed: u64,
    /// Dead processes whose traces could not be removed.
    pub failed: u64,
    /// Files removed: everything if nobody lives, otherwise half-made channels.
    pub files: usize,
}

impl Domain {
    /// Cleans up after killed processes: wipes the domain if no process lives in it, otherwise removes what the dead have left.
    ///
    /// For whoever runs the domain ([`Domain::claim`]), before it starts the first process and after one has died.
    ///
    /// # Errors
    /// [`BusError::DomainFolder`] if the cleaner itself hangs: then nothing helps but to end every process of the domain and to start again.
    pub fn sweep(&self) -> Result<Swept, BusError> {
        let (alive, dead) = self.nodes();
        if alive.is_empty() {
            return Ok(Swept { files: self.wipe(), ..Swept::default() });
        }
        let files = self.remove_half_made();
        let mut swept = Swept { alive: alive.len(), files, ..Swept::default() };
        if dead > 0 {
            self.before_cleaning();
            // In a thread of its own: a cleaner can hang on what a process killed in its first millisecond has left.
            let (config, (done, result)) = (self.config().clone(), std::sync::mpsc::sync_channel(1));
            let cleaner = std::thread::Builder::new().name("sweep".to_owned()).spawn(move || {
                let mut config = config;
                config.global.node.cleanup_dead_nodes_on_creation = false;
                let node = NodeBuilder::new()
                    .config(&config)
                    .signal_handling_mode(SignalHandlingMode::Disabled)
                    .create::<ipc::Service>();
                let _ = done.send(node.map(|node| node.try_cleanup_dead_nodes()).ok());
            });
            let hangs = |why| BusError::DomainFolder { path: self.root().to_owned(), why };
            cleaner.map_err(|error| hangs(Unfit::NoCleaner(error.to_string())))?;
            match result.recv_timeout(PATIENCE) {
                Ok(Some(state)) => (swept.removed, swept.failed) = (state.cleanups, state.failed_cleanups),
                Ok(None) => swept.failed = dead as u64,
                Err(_) => return Err(hangs(Unfit::CleanerHangs)),
            }
        }
        Ok(swept)
    }

    /// Removes what a process that was killed while it made something has left half made: nobody could ever open it, and iceoryx2 itself
    /// never removes it.
    pub(crate) fn remove_half_made(&self) -> usize {
        let (old, _) = self.half_made();
        old.iter().filter(|path| fs::remove_file(path).is_ok()).count()
    }

    /// To be called before iceoryx2 cleans up. Root can open what is half made in shared memory, and then waits for ever for the rest of it:
    /// so root waits here until it is finished or is certainly abandoned; not where nobody has died, and not for what the living begin
    /// meanwhile: at a start there is always something in the making.
    pub(crate) fn before_cleaning(&self) {
        self.remove_half_made();
        if !geteuid().is_root() || self.dead() == 0 {
            return;
        }
        let give_up = now_ns() + 2 * HALF_MADE.as_nanos() as u64;
        let (_, mut waited_for) = self.half_made();
        while !waited_for.is_empty() && now_ns() < give_up {
            sleep_until(now_ns() + 5_000_000);
            self.remove_half_made();
            let (old, young) = self.half_made();
            waited_for.retain(|path| old.contains(path) || young.contains(path));
        }
    }

    /// What is half made: the abandoned, and what may still be in the making.
    fn half_made(&self) -> (Vec<PathBuf>, Vec<PathBuf>) {
        let entries = |folder: &Path| fs::read_dir(folder).into_iter().flatten().flatten();
        let (mut old, mut young) = (Vec::new(), Vec::new());
        let mut note = |entry: &fs::DirEntry, unfinished: u32| {
            let Ok(found) = entry.metadata() else { return };
            if found.is_file() && found.mode() & 0o777 == unfinished {
                let age = found.modified().ok().and_then(|at| SystemTime::now().duration_since(at).ok());
                let abandoned = age.is_some_and(|age| age > HALF_MADE);
                if abandoned { &mut old } else { &mut young }.push(entry.path());
            }
        };
        // shared memory is write-only until its content is complete
        for entry in entries(Path::new(SHARED_MEMORY)) {
            if entry.file_name().as_encoded_bytes().starts_with(self.prefix().as_bytes()) {
                note(&entry, 0o200);
            }
        }
        // channels, and the notes of a process about its ports, are read-only once they are complete
        for entry in entries(&self.root().join("services")) {
            note(&entry, 0o600);
        }
        for node in entries(&self.root().join("nodes")) {
            for entry in entries(&node.path()) {
                if entry.file_name().as_encoded_bytes().ends_with(b"_tag") {
                    note(&entry, 0o600);
                }
            }
        }
        (old, young)
    }
}
