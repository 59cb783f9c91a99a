//! Nobody but the user who runs a robot reads its memory or speaks in it.
//!
//! The folder of a domain can only be entered by its owner, and so can everything in it. What lies outside of it is looked at here: shared
//! memory is flat, and the ports of a virtual motor box are terminals of the machine.

use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::Mode;
use rustix::process::{geteuid, umask};

use crate::Domain;
use crate::domain::SHARED_MEMORY;

/// Bits of a mode that let others in: group and everybody.
const OTHERS: u32 = 0o077;

/// From here on, files and folders that this process makes, and those of the processes that it starts, are its user's alone.
pub fn make_private() {
    umask(Mode::from_raw_mode(OTHERS));
}

impl Domain {
    /// Everything of this domain that another user could read, write or enter: nothing, if all is well.
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

    /// Folders of this user's domains that others may enter; such a domain cannot be used, see [`Domain::new`].
    #[must_use]
    pub fn open_folders() -> Vec<PathBuf> {
        let beginning = format!("nims-{}-", geteuid().as_raw());
        let ours = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&beginning));
        entries(Path::new(SHARED_MEMORY)).filter(|path| ours(path) && path.is_dir() && is_open(path)).collect()
    }

    /// One object of iceoryx2, a count of processes, is made for all users of a machine; a domain has one user.
    pub(crate) fn shut(&self) {
        for path in self.in_shared_memory() {
            let Ok(found) = fs::symlink_metadata(&path) else { continue };
            if found.mode() & OTHERS != 0 && found.uid() == geteuid().as_raw() {
                // Somebody else of this domain may just have done it, or have removed it.
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

/// Whether others may do anything with it; what is not there is not open.
fn is_open(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|found| found.mode() & OTHERS != 0)
}
