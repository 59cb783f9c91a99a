//! Waits until a sample arrives, a descriptor is ready, or a deadline is reached.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use arrayvec::ArrayVec;
use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::{FileDescriptorBased, ipc};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use rustix::time::Timespec;

use crate::clock::{SECOND_NS, now_ns};
use crate::{Bus, BusError, CHANNELS_EVENT};

/// Largest number of channels plus descriptors of one waiter.
const LIMIT: usize = 32;

/// Waits for any of several channels and descriptors.
#[derive(Debug)]
pub struct Waiter {
    /// `None`: there was no place for a listener of new channels.
    listeners: ArrayVec<(String, Option<Listener<ipc::Service>>), LIMIT>,
    descriptors: ArrayVec<OwnedFd, LIMIT>,
    deaf: Option<BusError>,
}

/// Result of a wait. Nothing is set if the deadline was reached or a signal arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Wake {
    channels: u32,
    descriptors: u32,
}

impl Wake {
    /// Returns whether the channel with this index in the list given to [`Bus::waiter`] has a new sample.
    #[must_use]
    pub fn channel(&self, index: usize) -> bool {
        index < LIMIT && self.channels & (1 << index) != 0
    }

    /// Returns whether the descriptor with this index (from [`Waiter::attach`]) can be read or has hung up.
    #[must_use]
    pub fn descriptor(&self, index: usize) -> bool {
        index < LIMIT && self.descriptors & (1 << index) != 0
    }

    /// Returns whether a channel or descriptor ended the wait; false if the deadline was reached or a signal arrived.
    #[must_use]
    pub fn woken(&self) -> bool {
        self.channels | self.descriptors != 0
    }
}

impl Bus {
    /// Creates a waiter for these channels or for [`CHANNELS_EVENT`]. A wake-up means that at least one sample
    /// was published since the last one, so receive from the subscribers until they are empty.
    ///
    /// # Errors
    /// [`BusError::TooManyToWaitFor`] above 32 channels, and those of opening a channel.
    pub fn waiter(&self, channels: &[&str]) -> Result<Waiter, BusError> {
        let mut waiter = Waiter { listeners: ArrayVec::new(), descriptors: ArrayVec::new(), deaf: None };
        for channel in channels {
            waiter.add(self, channel)?;
        }
        Ok(waiter)
    }
}

impl Waiter {
    /// Adds a channel; returns its index for [`Wake::channel`]. If [`CHANNELS_EVENT`] has no free place, it goes
    /// without ([`Waiter::deaf`]): a process that looks for channels also does so once a second.
    ///
    /// # Errors
    /// As [`Bus::waiter`].
    pub fn add(&mut self, bus: &Bus, channel: &str) -> Result<usize, BusError> {
        self.room()?;
        let listener = match bus.listener(channel) {
            Ok(listener) => Some(listener),
            Err(full @ BusError::Full { .. }) if channel == CHANNELS_EVENT => {
                self.deaf = Some(full);
                None
            }
            Err(error) => return Err(error),
        };
        self.listeners.push((channel.to_owned(), listener));
        Ok(self.listeners.len() - 1)
    }

    /// Returns why new channels do not end a wait, if so: the robot has as many processes as it has places for.
    #[must_use]
    pub fn deaf(&self) -> Option<&BusError> {
        self.deaf.as_ref()
    }

    /// Adds a descriptor, e.g. of a serial port or a signal's pipe; returns its index for [`Wake::descriptor`]. The
    /// caller must read from it: a wait returns at once as long as it is readable.
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

    /// Waits until a channel or descriptor is ready or CLOCK_MONOTONIC reaches `deadline_ns`; `None` means no deadline.
    /// A signal ends the wait too.
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
            let mut places: ArrayVec<usize, LIMIT> = ArrayVec::new();
            let listeners = self.listeners.iter().map(|(_, listener)| listener.as_ref().map(descriptor_of));
            let descriptors = self.descriptors.iter().map(|descriptor| Some(descriptor.as_fd()));
            for (place, descriptor) in listeners.chain(descriptors).enumerate() {
                if let Some(descriptor) = descriptor {
                    entries.push(PollFd::from_borrowed_fd(descriptor, PollFlags::IN));
                    places.push(place);
                }
            }
            match poll(&mut entries, timeout.as_ref()) {
                Ok(0) | Err(Errno::INTR) => return Ok(wake),
                Ok(_) => {}
                Err(error) => {
                    let channel = self.listeners.first().map_or("", |(name, _)| name).to_owned();
                    return Err(BusError::Failed { channel, what: "be waited for", why: error.to_string() });
                }
            }
            for (place, entry) in places.into_iter().zip(&entries) {
                if !entry.revents().is_empty() {
                    match place.checked_sub(self.listeners.len()) {
                        None => wake.channels |= 1 << place,
                        Some(place) => wake.descriptors |= 1 << place,
                    }
                }
            }
        }
        for (place, (channel, listener)) in self.listeners.iter().enumerate() {
            if let Some(listener) = listener
                && wake.channel(place)
            {
                listener.try_wait(|_| {}).map_err(|error| BusError::failed(channel, "be waited for", &error))?;
            }
        }
        Ok(wake)
    }
}

fn descriptor_of(listener: &Listener<ipc::Service>) -> BorrowedFd<'_> {
    // SAFETY: the listener owns its socket and keeps it open as long as it exists; the returned borrow does not outlive
    // it.
    #[allow(unsafe_code)]
    unsafe {
        BorrowedFd::borrow_raw(listener.file_descriptor().native_handle())
    }
}
