//! The number of processes for which a robot has places in shared memory.
//!
//! Each process announces its channels with [`crate::CHANNELS_EVENT`] and holds the schema texts of its types. iceoryx2
//! reserves every place of an event when the event is created. So the owner of a domain states the number in the
//! domain's folder before the first process joins, and each process reads it once, when it joins. A process that has
//! joined with another number opens what exists with as many places as that has.

use std::fs;

use rustix::fs::statvfs;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use crate::definition;
use crate::domain::{PROCESSES_FILE, SHARED_MEMORY};
use crate::{BusError, Domain};

/// Size of the event of new channels without its places, and of each place: a process and its notifier, bytes. Measured
/// with iceoryx2 0.10, as the next one; a test compares both.
const ANNOUNCEMENTS_BYTES: [u64; 2] = [8519, 160];
/// Size of a continuation of a schema text without its places, and of each place: a process, bytes.
const TEXT_BYTES: [u64; 2] = [583, 32];
/// Size of a page of memory if shared memory does not state it, bytes.
const PAGE_BYTES: u64 = 4096;

impl Domain {
    /// States for how many processes those that join from now on reserve places. Until it is stated, these are
    /// [`messages::PROCESSES`].
    ///
    /// # Errors
    /// [`BusError::DomainFolder`] if the folder cannot be written.
    pub fn set_processes(&self, processes: usize) -> Result<(), BusError> {
        self.put(PROCESSES_FILE, &processes.to_string())
    }

    /// Returns for how many processes a process that joins now reserves places.
    #[must_use]
    pub fn processes(&self) -> usize {
        let text = fs::read_to_string(self.root().join(PROCESSES_FILE)).ok();
        text.and_then(|text| text.trim_end().parse().ok()).unwrap_or(messages::PROCESSES)
    }
}

/// Returns the number of files that the recorder of so many processes opens at most: 5 for each channel, and 3 channels
/// for each process, and those of a robot without them.
#[must_use]
pub const fn recorder_files(processes: usize) -> u64 {
    5 * 3 * processes as u64 + 1024
}

/// Raises the limit of open descriptors, as far as the system permits, to what the recorder of so many processes opens.
/// The default limit of many systems is 1024.
pub(crate) fn raise_descriptor_limit(processes: usize) {
    let wanted = recorder_files(processes);
    let limit = getrlimit(Resource::Nofile);
    let wanted = limit.maximum.map_or(wanted, |most| most.min(wanted));
    if limit.current.is_some_and(|now| now < wanted) {
        let _ = setrlimit(Resource::Nofile, Rlimit { current: Some(wanted), maximum: limit.maximum });
    }
}

/// Returns the shared memory of a robot's places, bytes: the sizes of the files that iceoryx2 creates for the event of
/// new channels and for each continuation of a schema text of this build, in whole pages. A type of another program
/// with a long definition takes one continuation more.
#[must_use]
pub fn places_bytes(processes: usize) -> u64 {
    // A tmpfs states the page size of the machine: 16 kB on some ARM boards.
    let page = statvfs(SHARED_MEMORY).map_or(PAGE_BYTES, |found| found.f_frsize.max(1));
    let file = |[all, place]: [u64; 2]| (all + place * processes as u64).next_multiple_of(page);
    file(ANNOUNCEMENTS_BYTES) + definition::own_continuations() as u64 * file(TEXT_BYTES)
}
