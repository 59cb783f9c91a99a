//! Reservation of shared memory.
//!
//! All users of the machine share /dev/shm. iceoryx2 creates sparse files, whose pages are allocated on first access;
//! if no page is free then, the kernel ends the process with SIGBUS. iceoryx2 has no hook to prevent this, and
//! reserving a file after its creation leaves a race. So this module replaces the C library's `ftruncate` in the
//! programs that link this crate: it reserves all pages of a file in memory in the same call that sets its size, before
//! the file can be mapped. If there is not enough memory, the file is removed, and iceoryx2 reports an error.
//!
//! Limitations:
//! * Programs that do not link this crate create sparse files. `nims_sensor.py` reserves them at once; other programs
//!   may never do so, and a page fault then also ends their peers.
//! * With another C library than glibc nothing is reserved.

use std::cell::Cell;
use std::ffi::{c_int, c_long};
use std::fs;
use std::os::fd::{AsRawFd, BorrowedFd};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use rustix::fs::{FallocateFlags, fallocate, fstatfs, statvfs};
use rustix::io::Errno;

use crate::domain::{MEMORY_FILE_SYSTEMS, SHARED_MEMORY};
use crate::places::Participant;
use crate::{BusError, Domain};

/// Largest number of interruptions of one reservation by signals.
const INTERRUPTIONS: usize = 1000;
/// Upper bound of the memory of one connection, bytes.
pub(crate) const CONNECTION_BYTES: usize = 24 << 10;

thread_local! {
    /// Reservations of this thread for which there was no room.
    pub(crate) static SHORT: Cell<u64> = const { Cell::new(0) };
}

/// Shared memory of the machine, and its use by a domain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Memory {
    /// Size of /dev/shm, bytes; 0 if it has no limit.
    pub total: u64,
    /// Free memory of it, bytes.
    pub free: u64,
    /// Memory used by the channels of the domain, bytes.
    pub used: u64,
    /// Memory that their files may still allocate, because a program has created them without reserving it, bytes.
    pub unreserved: u64,
}

/// Number of checks that confirm that a domain uses another /dev/shm.
const ELSEWHERE_CHECKS: u32 = 10;
/// Time between two of these checks.
const ELSEWHERE_EVERY: std::time::Duration = std::time::Duration::from_millis(100);

impl Domain {
    /// Returns the size of shared memory and its use by this domain.
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
    /// Returns whether the processes of this domain use another /dev/shm, because they were started with their own.
    pub(crate) fn lies_elsewhere(&self) -> bool {
        // A robot that is starting or ending briefly has no memory either.
        let lasts = || {
            (0..ELSEWHERE_CHECKS).all(|_| {
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

pub(crate) fn need(bytes: usize, party: Participant, what: &str) -> Result<(), BusError> {
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

/// Replaces the C library's `ftruncate`, and allocates all pages of a file in memory.
///
/// All callers in the program use it. This suits the others too: files in memory are made to be mapped.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
// SAFETY: the symbol has the signature and the semantics of POSIX; it only fails, with an errno of `ftruncate`, where a
// later page fault would be fatal.
#[allow(unsafe_code)]
#[unsafe(no_mangle)]
extern "C" fn ftruncate(descriptor: c_int, length: c_long) -> c_int {
    if descriptor < 0 {
        return fail(Errno::BADF);
    }
    let Ok(length) = u64::try_from(length) else { return fail(Errno::INVAL) };
    // SAFETY: the caller keeps the descriptor open during its call; the borrow does not outlive the call.
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
    // SAFETY: glibc returns a valid address of this thread's errno.
    #[allow(unsafe_code)]
    unsafe {
        *__errno_location() = error.raw_os_error();
    }
    -1
}

/// Allocates all pages of a file in memory; removes the file if that fails.
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
        // A memory file system without reservation, such as ramfs, has no size limit.
        Ok(()) | Err(Errno::OPNOTSUPP | Errno::NOSYS) => Ok(()),
        Err(error) => {
            SHORT.set(SHORT.get() + 1);
            let _ = rustix::fs::ftruncate(file, 0);
            // Remove the file: every peer would wait for the completion of an incomplete one.
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
