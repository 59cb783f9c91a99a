//! The newest sample of a channel, for processes that look at it less often than it is published.

use messages::ros::Payload;

use crate::{Bus, BusError, Subscriber};

/// Receives the newest sample of a channel. It has room for one sample, which the next one overwrites: a look costs the
/// same however many were published since the last one. It counts no losses, because none of these was awaited.
#[derive(Debug)]
pub struct Newest<T: Payload>(Subscriber<T>);

impl Bus {
    /// Creates a subscriber that only receives the newest sample. Creates the channel if it does not exist.
    ///
    /// # Errors
    /// As [`Bus::subscriber`].
    pub fn newest<T: Payload>(&self, channel: &str) -> Result<Newest<T>, BusError> {
        self.subscriber_with(channel, 1).map(Newest)
    }
}

impl<T: Payload> Newest<T> {
    /// Returns the newest sample, if any arrived since the last call. Where a publisher has just been replaced, the
    /// last sample of each may arrive, in any order: see [`Subscriber::receive`].
    ///
    /// # Errors
    /// As [`Subscriber::receive`].
    pub fn latest(&mut self) -> Result<Option<T>, BusError> {
        self.0.latest()
    }
}
