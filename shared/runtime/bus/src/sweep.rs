//! Removes the objects of processes that were killed.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use iceoryx2::prelude::{NodeBuilder, SignalHandlingMode, ipc};
use rustix::process::geteuid;

use crate::clock::{now_ns, sleep_until};
use crate::domain::{CLAIM_FILE, PROCESSES_FILE, SHARED_MEMORY};
use crate::error::UnusableFolder;
use crate::{BusError, Domain};

/// Age from which an incomplete object is abandoned. Creating one takes a millisecond, plus the stalls of the machine.
const HALF_MADE: Duration = Duration::from_secs(1);
/// Time after which a cleaner hangs; removing one dead process takes a millisecond.
const CLEANER_TIMEOUT: Duration = Duration::from_secs(5);

/// Result of [`Domain::sweep`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SweepReport {
    /// Number of running processes in the domain.
    pub alive: usize,
    /// Number of dead processes whose objects were removed.
    pub removed: u64,
    /// Number of dead processes whose objects could not be removed.
    pub failed: u64,
    /// Number of files removed: all files if no process runs, otherwise incomplete objects.
    pub files: usize,
}

impl Domain {
    /// Cleans up after killed processes: wipes the domain if no process runs in it, otherwise removes the objects of
    /// dead processes. What [`Domain::set_processes`] has stated remains, for a process that joins meanwhile.
    ///
    /// The owner of the domain ([`Domain::claim`]) calls it before it starts the first process, after one has died, and
    /// now and then, because processes that it has not started die too.
    ///
    /// # Errors
    /// [`BusError::DomainFolder`] if the cleaner hangs. Then every process of the domain must be ended and started
    /// again.
    pub fn sweep(&self) -> Result<SweepReport, BusError> {
        let nodes = self.nodes();
        if !nodes.may_live() {
            let files = self.wipe_except(&[PROCESSES_FILE]);
            return Ok(SweepReport { files, ..SweepReport::default() });
        }
        let files = self.remove_half_made();
        let mut swept = SweepReport { alive: nodes.alive.len(), files, ..SweepReport::default() };
        if nodes.dead > 0 {
            self.before_cleaning();
            // Runs in a thread, because the cleaner can hang on the objects of a process killed in its first
            // millisecond.
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
            cleaner.map_err(|error| hangs(UnusableFolder::NoCleaner(error.to_string())))?;
            match result.recv_timeout(CLEANER_TIMEOUT) {
                Ok(Some(state)) => (swept.removed, swept.failed) = (state.cleanups, state.failed_cleanups),
                Ok(None) => swept.failed = nodes.dead as u64,
                Err(_) => return Err(hangs(UnusableFolder::CleanerHangs)),
            }
        }
        Ok(swept)
    }

    /// Returns whether another living process owns the domain. It sweeps, so a joining process need not look at all
    /// others: among hundreds that would take most of the time of a start. If the owner hangs, or is killed meanwhile,
    /// the places of dead processes are freed when they are needed.
    pub(crate) fn has_other_owner(&self) -> bool {
        // The kernel's list states who holds the lock. Trying the lock could refuse it to the owner that just starts.
        let Ok(claim) = fs::metadata(self.root().join(CLAIM_FILE)) else { return false };
        let locks = fs::read_to_string("/proc/locks").unwrap_or_default();
        locks.lines().any(|line| {
            let (holder, inode) = lock_in(line).unwrap_or_default();
            inode == claim.ino() && holder != i64::from(std::process::id())
        })
    }

    /// Removes incomplete objects of processes that were killed while they created them. No process can open these, and
    /// iceoryx2 never removes them.
    pub(crate) fn remove_half_made(&self) -> usize {
        let (old, _) = self.half_made();
        old.iter().filter(|path| fs::remove_file(path).is_ok()).count()
    }

    /// Prepares a clean-up by iceoryx2. As root, iceoryx2 can open incomplete objects in shared memory and then waits
    /// for their completion for ever. So root waits here until the present ones are complete or abandoned. It does not
    /// wait if no process has died, nor for objects created meanwhile: during a start there are always some.
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

    /// Returns the incomplete objects: the abandoned ones, and those that a process may still be creating.
    fn half_made(&self) -> (Vec<PathBuf>, Vec<PathBuf>) {
        let entries = |folder: &Path| fs::read_dir(folder).into_iter().flatten().flatten();
        let (mut old, mut young) = (Vec::new(), Vec::new());
        let mut record = |entry: &fs::DirEntry, unfinished: u32| {
            let Ok(found) = entry.metadata() else { return };
            if found.is_file() && found.mode() & 0o777 == unfinished {
                let age = found.modified().ok().and_then(|at| SystemTime::now().duration_since(at).ok());
                let abandoned = age.is_some_and(|age| age > HALF_MADE);
                if abandoned { &mut old } else { &mut young }.push(entry.path());
            }
        };
        // An object in shared memory is write-only until its content is complete.
        for entry in entries(Path::new(SHARED_MEMORY)) {
            if entry.file_name().as_encoded_bytes().starts_with(self.prefix().as_bytes()) {
                record(&entry, 0o200);
            }
        }
        // The files of channels, and a process's tags for its ports, are read-only once they are complete.
        for entry in entries(&self.root().join("services")) {
            record(&entry, 0o600);
        }
        for node in entries(&self.root().join("nodes")) {
            for entry in entries(&node.path()) {
                if entry.file_name().as_encoded_bytes().ends_with(b"_tag") {
                    record(&entry, 0o600);
                }
            }
        }
        (old, young)
    }
}

/// Process and inode of a lock by `flock` in a line of `/proc/locks`:
/// `12: FLOCK  ADVISORY  WRITE 4711 00:1b:1234 0 EOF`.
fn lock_in(line: &str) -> Option<(i64, u64)> {
    let mut fields = line.split_ascii_whitespace().skip(1);
    (fields.next()? == "FLOCK").then_some(())?;
    let holder = fields.nth(2)?.parse().ok()?;
    Some((holder, fields.next()?.rsplit(':').next()?.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lock_states_its_process_and_its_file() {
        assert_eq!(lock_in("12: FLOCK  ADVISORY  WRITE 4711 00:1b:1234 0 EOF"), Some((4711, 1234)));
        assert_eq!(lock_in("13: POSIX  ADVISORY  WRITE 4711 00:1b:1234 0 EOF"), None);
        assert_eq!(lock_in("14: -> FLOCK  ADVISORY  WRITE 4711 00:1b:1234 0 EOF"), None);
        assert_eq!(lock_in("broken"), None);
    }
}
