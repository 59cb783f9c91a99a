//! Work places of a benchmark: a private domain in shared memory and a private folder on the disk. Both names contain
//! the process id. They are removed at the end or, if the benchmark was killed, by the next one.

use bus::{Claim, Domain};
use command::{Answer, Failure};
use rustix::process::getuid;
use std::fs;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

/// Parent folder of domains.
const SHARED_MEMORY: &str = "/dev/shm";
/// Name prefix of a folder on the disk.
const DISK_PREFIX: &str = ".nims-bench-";

/// Returns the name prefix of a folder in shared memory; it differs from that of robots, so that no command mistakes it
/// for one.
fn memory_prefix() -> String {
    format!("nimsbench-{}-", getuid().as_raw())
}

/// A private domain, removed on drop.
pub struct PrivateDomain {
    domain: Domain,
    // Dropped last: no other process may claim the domain before everything is removed.
    claim: Option<Claim>,
}

impl PrivateDomain {
    /// Creates the domain of this process.
    ///
    /// # Errors
    /// Shared memory cannot be used.
    pub fn create() -> Answer<Self> {
        Self::open(&Path::new(SHARED_MEMORY).join(format!("{}{}", memory_prefix(), std::process::id())))
    }

    fn open(folder: &Path) -> Answer<Self> {
        let domain = Domain::from_root(folder)?;
        let claim = domain.claim()?;
        Ok(Self { domain, claim: Some(claim) })
    }

    /// The domain.
    #[must_use]
    pub fn domain(&self) -> &Domain {
        &self.domain
    }
}

impl Drop for PrivateDomain {
    fn drop(&mut self) {
        // If a process is still running in it, the next benchmark removes the domain.
        if self.domain.sweep().is_ok_and(|swept| swept.alive == 0) {
            let _ = fs::remove_dir_all(self.domain.root());
        }
        drop(self.claim.take());
    }
}

/// A folder on the disk, removed with its contents on drop.
pub struct Scratch {
    folder: PathBuf,
}

impl Scratch {
    /// Creates the folder of this process.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn create(runs: &Path) -> Answer<Self> {
        let folder = runs.join(format!("{DISK_PREFIX}{}", std::process::id()));
        let made = fs::DirBuilder::new().mode(0o700).create(&folder);
        made.map_err(|error| {
            Failure::NotNow(format!("{} cannot be created: {error}; give another folder with --runs", folder.display()))
        })?;
        Ok(Self { folder })
    }

    /// The folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// Removes the leftovers of killed benchmarks in shared memory and, if given, in a folder of runs.
pub fn sweep(runs: Option<&Path>) {
    for folder in leftovers(Path::new(SHARED_MEMORY), &memory_prefix()) {
        // Opened only to be removed on drop; it stays if another process claims it or runs in it.
        let _ = PrivateDomain::open(&folder);
    }
    for folder in runs.into_iter().flat_map(|runs| leftovers(runs, DISK_PREFIX)) {
        let _ = fs::remove_dir_all(folder);
    }
}

/// Returns this user's folders with this prefix whose process has ended.
fn leftovers(place: &Path, beginning: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(place).into_iter().flatten().flatten();
    let left = entries.filter(|entry| {
        let pid = entry.file_name().to_str().and_then(|name| name.strip_prefix(beginning)?.parse().ok());
        let ours = entry.metadata().is_ok_and(|found| found.is_dir() && found.uid() == getuid().as_raw());
        ours && pid.is_some_and(|pid: u32| !runs_this_program(pid))
    });
    left.map(|entry| entry.path()).collect()
}

/// Returns whether the process with this id runs this program; another program may have reused the id.
fn runs_this_program(pid: u32) -> bool {
    let name = |pid: &str| fs::read_to_string(format!("/proc/{pid}/comm")).ok();
    name(&pid.to_string()).is_some_and(|there| Some(there) == name("self"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bus::Bus;
    use messages::MotorState;

    /// An unused process id.
    const UNUSED_PID: u32 = u32::MAX / 2;

    fn names_in_shared_memory(prefix: &str) -> usize {
        let entries = fs::read_dir(SHARED_MEMORY).unwrap().flatten();
        entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix)).count()
    }

    #[test]
    fn a_private_domain_is_removed_completely() {
        let place = PrivateDomain::create().unwrap();
        let (root, prefix) = (place.domain().root().to_owned(), place.domain().prefix().to_owned());
        let bus = Bus::join(place.domain(), "test").unwrap();
        let states = bus.publisher::<MotorState>("motor/state").unwrap();
        assert!(root.is_dir() && names_in_shared_memory(&prefix) > 0);
        assert!(!Domain::all().iter().any(|domain| domain.root() == root), "it is mistaken for the domain of a robot");
        drop((states, bus));
        drop(place);
        assert!(!root.exists());
        assert_eq!(names_in_shared_memory(&prefix), 0);
    }

    #[test]
    fn leftovers_of_killed_benchmarks_are_removed() {
        let runs = tempfile::tempdir().unwrap();
        let living = Scratch::create(runs.path()).unwrap();
        fs::write(living.folder().join("file"), "x").unwrap();
        let dead = runs.path().join(format!("{DISK_PREFIX}{UNUSED_PID}"));
        fs::create_dir(&dead).unwrap();
        fs::write(dead.join("file"), "x").unwrap();
        // Names of a different form.
        for name in [".nims-bench-", ".nims-bench-notes", "nims-bench-7"] {
            fs::create_dir(runs.path().join(name)).unwrap();
        }
        let folder = Path::new(SHARED_MEMORY).join(format!("{}{UNUSED_PID}", memory_prefix()));
        let left = Domain::from_root(&folder).unwrap();
        let shared = Path::new(SHARED_MEMORY).join(format!("{}left", left.prefix()));
        fs::write(&shared, "x").unwrap();
        sweep(Some(runs.path()));
        assert!(!dead.exists() && !folder.exists() && !shared.exists());
        assert!(living.folder().join("file").exists());
        for name in [".nims-bench-", ".nims-bench-notes", "nims-bench-7"] {
            assert!(runs.path().join(name).exists(), "{name}");
        }
        let folder = living.folder().to_owned();
        drop(living);
        assert!(!folder.exists());
    }
}
