//! Where a benchmark works: a domain of its own in shared memory, a folder of its own on the disk. Both bear the number of its process,
//! go when it ends, and are removed by the next one where it was killed.

use bus::{Claim, Domain};
use command::{Answer, Failure};
use rustix::process::getuid;
use std::fs;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

/// Where a domain has to lie.
const SHARED_MEMORY: &str = "/dev/shm";
/// What a folder on the disk begins with.
const ON_DISK: &str = ".nims-bench-";

/// What a folder in shared memory begins with. Not as those of robots do, so that no command takes it for one.
fn in_memory() -> String {
    format!("nimsbench-{}-", getuid().as_raw())
}

/// A private domain, removed when this is dropped.
pub struct PrivateDomain {
    domain: Domain,
    // last: until everything is removed, nobody else may begin with that
    claim: Option<Claim>,
}

impl PrivateDomain {
    /// That of this process.
    ///
    /// # Errors
    /// Shared memory cannot be used.
    pub fn make() -> Answer<Self> {
        Self::of(&Path::new(SHARED_MEMORY).join(format!("{}{}", in_memory(), std::process::id())))
    }

    fn of(folder: &Path) -> Answer<Self> {
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
        // Whoever still lives in it, although it was ended, is left to the next start.
        if self.domain.sweep().is_ok_and(|swept| swept.alive == 0) {
            let _ = fs::remove_dir_all(self.domain.root());
        }
        drop(self.claim.take());
    }
}

/// A folder on the disk, removed with what is in it when this is dropped.
pub struct Scratch {
    folder: PathBuf,
}

impl Scratch {
    /// That of this process.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn make(runs: &Path) -> Answer<Self> {
        let folder = runs.join(format!("{ON_DISK}{}", std::process::id()));
        let made = fs::DirBuilder::new().mode(0o700).create(&folder);
        made.map_err(|error| {
            Failure::NotNow(format!("{} cannot be made: {error}; choose another folder with --runs", folder.display()))
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

/// Removes what benchmarks that were killed have left in shared memory and, if it is given, in a folder of runs.
pub fn sweep(runs: Option<&Path>) {
    for folder in left_in(Path::new(SHARED_MEMORY), &in_memory()) {
        // Made again only to be removed; where somebody holds it, or lives in it, it stays.
        let _ = PrivateDomain::of(&folder);
    }
    for folder in runs.into_iter().flat_map(|runs| left_in(runs, ON_DISK)) {
        let _ = fs::remove_dir_all(folder);
    }
}

/// This user's folders with that beginning whose process is gone.
fn left_in(place: &Path, beginning: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(place).into_iter().flatten().flatten();
    let left = entries.filter(|entry| {
        let pid = entry.file_name().to_str().and_then(|name| name.strip_prefix(beginning)?.parse().ok());
        let ours = entry.metadata().is_ok_and(|found| found.is_dir() && found.uid() == getuid().as_raw());
        ours && pid.is_some_and(|pid: u32| !runs_this_program(pid))
    });
    left.map(|entry| entry.path()).collect()
}

/// Whether the process of that number is one of this program's: another one may have its number by now.
fn runs_this_program(pid: u32) -> bool {
    let name = |pid: &str| fs::read_to_string(format!("/proc/{pid}/comm")).ok();
    name(&pid.to_string()).is_some_and(|there| Some(there) == name("self"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bus::Bus;
    use messages::MotorState;

    /// A number that no process has.
    const NOBODY: u32 = u32::MAX / 2;

    fn names_in_shared_memory(prefix: &str) -> usize {
        let entries = fs::read_dir(SHARED_MEMORY).unwrap().flatten();
        entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix)).count()
    }

    #[test]
    fn nothing_is_left_of_a_domain() {
        let place = PrivateDomain::make().unwrap();
        let (root, prefix) = (place.domain().root().to_owned(), place.domain().prefix().to_owned());
        let bus = Bus::join(place.domain(), "test").unwrap();
        let states = bus.publisher::<MotorState>("motor/state").unwrap();
        assert!(root.is_dir() && names_in_shared_memory(&prefix) > 0);
        assert!(!Domain::all().iter().any(|domain| domain.root() == root), "it is taken for a robot's");
        drop((states, bus));
        drop(place);
        assert!(!root.exists());
        assert_eq!(names_in_shared_memory(&prefix), 0);
    }

    #[test]
    fn what_killed_ones_left_is_removed_and_the_living_are_not() {
        let runs = tempfile::tempdir().unwrap();
        let living = Scratch::make(runs.path()).unwrap();
        fs::write(living.folder().join("file"), "x").unwrap();
        let dead = runs.path().join(format!("{ON_DISK}{NOBODY}"));
        fs::create_dir(&dead).unwrap();
        fs::write(dead.join("file"), "x").unwrap();
        // not ours, whatever they are
        for name in [".nims-bench-", ".nims-bench-notes", "nims-bench-7"] {
            fs::create_dir(runs.path().join(name)).unwrap();
        }
        let folder = Path::new(SHARED_MEMORY).join(format!("{}{NOBODY}", in_memory()));
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
