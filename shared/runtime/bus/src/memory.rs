//! Memory that cannot be taken away.
//!
//! Shared memory has no owner: whatever a user of the machine puts into /dev/shm is missing there for all others. iceoryx2 makes its files
//! sparse, so that a page is taken when it is first touched; where none is left then, the kernel ends the process with SIGBUS. There is no
//! hook in iceoryx2 for this, and a file that is reserved after it was made has been open to the race for that long. So this module stands
//! where every file gets its size: it takes the place of the C library's `ftruncate` in the programs that link this crate, and reserves all
//! pages of a file in memory in the same call, before anything can map it. A file without room is removed again, and iceoryx2 reports an error.
//!
//! What remains:
//! * Programs that do not link this crate make sparse files, for as long as they take to reserve them: `nims_bus.py` does so at once, a
//!   foreign program perhaps never. The peers of such a file touch it too.
//! * Under another C library than glibc nothing is reserved.

use std::cell::Cell;
use std::ffi::{c_int, c_long};
use std::fs;
use std::os::fd::{AsRawFd, BorrowedFd};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use rustix::fs::{FallocateFlags, fallocate, fstatfs, statvfs};
use rustix::io::Errno;

use crate::domain::{MEMORY_FILE_SYSTEMS, SHARED_MEMORY};
use crate::places::Party;
use crate::{BusError, Domain};

/// A signal interrupts a reservation; more often than this in one call it does not.
const INTERRUPTIONS: usize = 1000;
/// Bytes that one connection takes, rounded up.
pub(crate) const CONNECTION_BYTES: usize = 24 << 10;

thread_local! {
    /// Reservations of this thread for which there was no room.
    pub(crate) static SHORT: Cell<u64> = const { Cell::new(0) };
}

/// Shared memory of the machine, and what of it belongs to a domain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Memory {
    /// Size of /dev/shm, bytes; 0: it has no limit.
    pub total: u64,
    /// What is left of it.
    pub free: u64,
    /// What the channels of the domain have taken.
    pub used: u64,
    /// What they could still take, because something has made files without reserving them.
    pub unreserved: u64,
}

/// How often, and how long apart, a domain that seems to lie elsewhere is looked at again.
const ELSEWHERE_LOOKS: u32 = 10;
/// See [`ELSEWHERE_LOOKS`].
const ELSEWHERE_EVERY: std::time::Duration = std::time::Duration::from_millis(100);

impl Domain {
    /// How much shared memory there is, and how much of it this domain has.
    #[must_use]
    pub fn memory(&self) -> Memory {
        let (total, free) = room().unwrap_or_default();
        let (mut used, mut unreserved) = (0, 0);
        for path in self.in_shared_memory() {
            let Ok(found) = fs::symlink_metadata(&path) else { continue };
            let taken = found.blocks() * 512;
            used += taken;
            unreserved += found.size().saturating_sub(taken);
        }
        Memory { total, free, used, unreserved }
    }
}

impl Domain {
    /// Whether processes live here whose memory is not in this /dev/shm: they were started with one of their own.
    pub(crate) fn lies_elsewhere(&self) -> bool {
        // A robot that is just starting, or ending, looks like that for a moment.
        let lasts = || {
            (0..ELSEWHERE_LOOKS).all(|_| {
                std::thread::sleep(ELSEWHERE_EVERY);
                self.has_no_memory_here()
            })
        };
        self.has_no_memory_here() && lasts()
    }

    fn has_no_memory_here(&self) -> bool {
        let made = fs::read_dir(self.root().join("services")).is_ok_and(|mut services| services.next().is_some());
        let is_dynamic = |path: &Path| path.extension().is_some_and(|ending| ending == "dynamic");
        made && !self.in_shared_memory().any(|path| is_dynamic(&path)) && !self.alive().is_empty()
    }
}

pub(crate) fn need(bytes: usize, party: Party, what: &str) -> Result<(), BusError> {
    let Some((total, free)) = room() else { return Ok(()) };
    let needed = bytes as u64 + party.margin();
    if total == 0 || free >= needed {
        return Ok(());
    }
    Err(BusError::NoMemory { what: what.to_owned(), needed, free })
}

/// Size and free bytes of shared memory; `None` if it cannot be asked.
pub(crate) fn room() -> Option<(u64, u64)> {
    let found = statvfs(SHARED_MEMORY).ok()?;
    Some((found.f_blocks.saturating_mul(found.f_frsize), found.f_bavail.saturating_mul(found.f_frsize)))
}

/// The C library's `ftruncate`, but a file in memory that it makes longer has all its pages afterwards.
///
/// Stands in for every caller in the program. That is right for them too: a file in memory is there to be mapped.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
// SAFETY: the symbol has the signature and the meaning of POSIX, and only refuses, with an errno of `ftruncate`, what would be fatal later.
#[allow(unsafe_code)]
#[unsafe(no_mangle)]
extern "C" fn ftruncate(descriptor: c_int, length: c_long) -> c_int {
    if descriptor < 0 {
        return fail(Errno::BADF);
    }
    let Ok(length) = u64::try_from(length) else { return fail(Errno::INVAL) };
    // SAFETY: the caller keeps the descriptor open for the time of its call, which the borrow does not outlive.
    #[allow(unsafe_code)]
    let file = unsafe { BorrowedFd::borrow_raw(descriptor) };
    match rustix::fs::ftruncate(file, length).and_then(|()| reserve(file, length)) {
        Ok(()) => 0,
        Err(error) => fail(error),
    }
}

fn fail(error: Errno) -> c_int {
    #[allow(unsafe_code)]
    unsafe extern "C" {
        fn __errno_location() -> *mut c_int;
    }
    // SAFETY: glibc gives a valid place of this thread.
    #[allow(unsafe_code)]
    unsafe {
        *__errno_location() = error.raw_os_error();
    }
    -1
}

/// Takes all pages of a file in memory, or removes it.
fn reserve(file: BorrowedFd<'_>, length: u64) -> Result<(), Errno> {
    let in_memory = fstatfs(file).is_ok_and(|found| MEMORY_FILE_SYSTEMS.contains(&(found.f_type as u32)));
    if length == 0 || !in_memory {
        return Ok(());
    }
    let mut result = Err(Errno::INTR);
    for _ in 0..INTERRUPTIONS {
        result = fallocate(file, FallocateFlags::empty(), 0, length);
        if result != Err(Errno::INTR) {
            break;
        }
    }
    match result {
        // a file system of memory that cannot reserve, such as ramfs, has no limit either
        Ok(()) | Err(Errno::OPNOTSUPP | Errno::NOSYS) => Ok(()),
        Err(error) => {
            SHORT.set(SHORT.get() + 1);
            let _ = rustix::fs::ftruncate(file, 0);
            // What is left half made would be waited for by each peer that comes across it.
            let name = fs::read_link(format!("/proc/self/fd/{}", file.as_raw_fd()));
            if let Ok(name) = name.as_deref()
                && name.parent() == Some(Path::new(SHARED_MEMORY))
                && name.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"nims"))
            {
                let _ = fs::remove_file(name);
            }
            Err(error)
        }
    }
}
