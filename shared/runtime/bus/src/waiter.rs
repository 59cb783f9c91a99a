//! Sleeping until a sample comes, a descriptor is ready, or a time is reached.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use arrayvec::ArrayVec;
use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::{FileDescriptorBased, ipc};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use rustix::time::Timespec;

use crate::clock::{SECOND_NS, now_ns};
use crate::{Bus, BusError};

/// Channels and descriptors of one waiter together.
const LIMIT: usize = 32;

/// Waits for any of several channels and descriptors.
#[derive(Debug)]
pub struct Waiter {
    listeners: ArrayVec<(String, Listener<ipc::Service>), LIMIT>,
    descriptors: ArrayVec<OwnedFd, LIMIT>,
}

/// What ended the wait; nothing set means that the time was reached or a signal came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Wake {
    channels: u32,
    descriptors: u32,
}

impl Wake {
    /// True if the channel at that place of the list given to [`Bus::waiter`] has something new.
    #[must_use]
    pub fn channel(&self, index: usize) -> bool {
        index < LIMIT && self.channels & (1 << index) != 0
    }

    /// True if the descriptor with that number (from [`Waiter::attach`]) can be read or has hung up.
    #[must_use]
    pub fn descriptor(&self, index: usize) -> bool {
        index < LIMIT && self.descriptors & (1 << index) != 0
    }

    /// True if something came: false means that the deadline was reached, or a signal ended the wait.
    #[must_use]
    pub fn woken(&self) -> bool {
        self.channels | self.descriptors != 0
    }
}

impl Bus {
    /// Waits for these channels (or for [`crate::CHANNELS_EVENT`]). A wake-up says only that something was published since the last one:
    /// drain the subscribers then.
    ///
    /// # Errors
    /// [`BusError::TooManyToWaitFor`] above 32 channels, and those of opening a channel.
    pub fn waiter(&self, channels: &[&str]) -> Result<Waiter, BusError> {
        let mut waiter = Waiter { listeners: ArrayVec::new(), descriptors: ArrayVec::new() };
        for channel in channels {
            waiter.add(self, channel)?;
        }
        Ok(waiter)
    }
}

impl Waiter {
    /// Adds a channel; returns its index for [`Wake::channel`].
    ///
    /// # Errors
    /// As [`Bus::waiter`].
    pub fn add(&mut self, bus: &Bus, channel: &str) -> Result<usize, BusError> {
        self.room()?;
        self.listeners.push((channel.to_owned(), bus.listener(channel)?));
        Ok(self.listeners.len() - 1)
    }

    /// Adds anything that becomes readable, e.g. a serial port or a signal's pipe; returns its index for [`Wake::descriptor`]. Reading it is the
    /// caller's: as long as there is something to read, no wait sleeps.
    ///
    /// # Errors
    /// [`BusError::TooManyToWaitFor`].
    pub fn attach(&mut self, descriptor: OwnedFd) -> Result<usize, BusError> {
        self.room()?;
        self.descriptors.push(descriptor);
        Ok(self.descriptors.len() - 1)
    }

    fn room(&self) -> Result<(), BusError> {
        if self.listeners.len() + self.descriptors.len() < LIMIT {
            Ok(())
        } else {
            Err(BusError::TooManyToWaitFor { limit: LIMIT })
        }
    }

    /// Sleeps until something comes or CLOCK_MONOTONIC shows `deadline_ns`; `None` waits for ever. A signal ends the wait too.
    ///
    /// Checks once even if the deadline has passed.
    ///
    /// # Errors
    /// [`BusError::Failed`] if a descriptor cannot be waited for.
    pub fn wait_until(&mut self, deadline_ns: Option<u64>) -> Result<Wake, BusError> {
        let timeout = deadline_ns.map(|deadline| {
            let rest = deadline.saturating_sub(now_ns());
            Timespec { tv_sec: (rest / SECOND_NS) as i64, tv_nsec: (rest % SECOND_NS) as i64 }
        });
        let mut wake = Wake::default();
        {
            let mut entries: ArrayVec<PollFd<'_>, LIMIT> = ArrayVec::new();
            for (_, listener) in &self.listeners {
                entries.push(PollFd::from_borrowed_fd(descriptor_of(listener), PollFlags::IN));
            }
            for descriptor in &self.descriptors {
                entries.push(PollFd::from_borrowed_fd(descriptor.as_fd(), PollFlags::IN));
            }
            match poll(&mut entries, timeout.as_ref()) {
                Ok(0) | Err(Errno::INTR) => return Ok(wake),
                Ok(_) => {}
                Err(error) => {
                    let channel = self.listeners.first().map_or("", |(name, _)| name).to_owned();
                    return Err(BusError::Failed { channel, what: "be waited for", why: error.to_string() });
                }
            }
            for (place, entry) in entries.iter().enumerate() {
                if !entry.revents().is_empty() {
                    match place.checked_sub(self.listeners.len()) {
                        None => wake.channels |= 1 << place,
                        Some(place) => wake.descriptors |= 1 << place,
                    }
                }
            }
        }
        for (place, (channel, listener)) in self.listeners.iter().enumerate() {
            if wake.channel(place) {
                listener.try_wait(|_| {}).map_err(|error| BusError::failed(channel, "be waited for", &error))?;
            }
        }
        Ok(wake)
    }
}

fn descriptor_of(listener: &Listener<ipc::Service>) -> BorrowedFd<'_> {
    // SAFETY: the listener owns its socket and keeps it open for its whole life, which the returned borrow does not outlive.
    #[allow(unsafe_code)]
    unsafe {
        BorrowedFd::borrow_raw(listener.file_descriptor().native_handle())
    }
}
