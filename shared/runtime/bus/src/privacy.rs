//! Restricts the objects of a domain to the user who runs it.
//!
//! Only its owner can enter the folder of a domain. This module also covers the objects outside of that folder: shared
//! memory has no folders, and the ports of a virtual motor box are terminals of the machine.

use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::Mode;
use rustix::process::{geteuid, umask};

use crate::Domain;
use crate::domain::SHARED_MEMORY;

/// Permission bits of the group and of other users.
const OTHERS: u32 = 0o077;

/// Sets the umask so that only this user can access files and folders that this process and its children create.
pub fn make_private() {
    umask(Mode::from_raw_mode(OTHERS));
}

impl Domain {
    /// Returns the objects of this domain that another user could read, write or enter; normally none.
    #[must_use]
    pub fn open_to_others(&self) -> Vec<PathBuf> {
        let mut open = Vec::new();
        if is_open(self.root()) {
            open.push(self.root().to_owned());
        }
        open.extend(self.in_shared_memory().filter(|path| is_open(path)));
        let links = entries(self.root()).filter(|path| path.is_symlink());
        open.extend(links.filter(|link| fs::metadata(link).is_ok_and(|port| port.mode() & OTHERS != 0)));
        open
    }

    /// Returns the folders of this user's domains that others may enter; such a domain cannot be used, see
    /// [`Domain::new`].
    #[must_use]
    pub fn open_folders() -> Vec<PathBuf> {
        let beginning = format!("nims-{}-", geteuid().as_raw());
        let ours = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&beginning));
        entries(Path::new(SHARED_MEMORY)).filter(|path| ours(path) && path.is_dir() && is_open(path)).collect()
    }

    /// Removes the permissions of other users. iceoryx2 creates one object, a count of processes, for all users.
    pub(crate) fn restrict_access(&self) {
        for path in self.in_shared_memory() {
            let Ok(found) = fs::symlink_metadata(&path) else { continue };
            if found.mode() & OTHERS != 0 && found.uid() == geteuid().as_raw() {
                // Fails if another process of this domain has just removed the object, which is no error.
                let _ = fs::set_permissions(&path, fs::Permissions::from_mode(found.mode() & 0o700));
            }
        }
    }

    pub(crate) fn in_shared_memory(&self) -> impl Iterator<Item = PathBuf> {
        let ours = |path: &PathBuf| {
            path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(self.prefix().as_bytes()))
        };
        entries(Path::new(SHARED_MEMORY)).filter(ours)
    }
}

fn entries(folder: &Path) -> impl Iterator<Item = PathBuf> + use<> {
    fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path())
}

/// Returns whether other users have any permission; false if the path does not exist.
fn is_open(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|found| found.mode() & OTHERS != 0)
}
