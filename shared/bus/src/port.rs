//! Typed ports.

use iceoryx2::port::ReceiveError;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::ipc;
use messages::quality_of;
use messages::ros::Payload;

use crate::BusError;
use crate::losses::Losses;
use crate::node::{Bus, LOANS, PubSub, failed};
use crate::wire::Wire;

/// Sends samples of one type on one channel.
#[derive(Debug)]
pub struct Publisher<T: Payload> {
    port: iceoryx2::port::publisher::Publisher<ipc::Service, Wire<T>, ()>,
    notifier: Notifier<ipc::Service>,
    channel: String,
    seq: u64,
}

/// Receives samples of one type from one channel.
#[derive(Debug)]
pub struct Subscriber<T: Payload> {
    port: iceoryx2::port::subscriber::Subscriber<ipc::Service, Wire<T>, ()>,
    channel: String,
    losses: Losses,
    received: u64,
    broken: u64,
}

impl Bus {
    /// A publisher; makes the channel if nobody has.
    ///
    /// # Errors
    /// [`BusError::Full`] if the channel has its publishers already, [`BusError::TypeMismatch`] if it carries another type, and others.
    pub fn publisher<T: Payload>(&self, channel: &str) -> Result<Publisher<T>, BusError> {
        let service: PubSub<Wire<T>> = self.open_typed(channel)?;
        let make = || service.publisher_builder().max_loaned_samples(LOANS).name(&self.port_name).create();
        let port = make().or_else(|_| self.after_cleaning(make)).map_err(|error| match error {
            PublisherCreateError::ExceedsMaxSupportedPublishers => BusError::Full {
                channel: channel.to_owned(),
                limit: quality_of(channel).publishers,
                what: "publisher(s)",
                holders: self.held_by(channel).1,
            },
            other => failed(channel, "be published on", &other),
        })?;
        let publisher = Publisher { port, notifier: self.notifier(channel)?, channel: channel.to_owned(), seq: 0 };
        self.announce();
        Ok(publisher)
    }

    /// A subscriber with the channel's whole buffer and the history that a late one gets; makes the channel if nobody has, so it may come first.
    ///
    /// # Errors
    /// [`BusError::Full`] if the channel has its subscribers already, [`BusError::TypeMismatch`] if it carries another type, and others.
    pub fn subscriber<T: Payload>(&self, channel: &str) -> Result<Subscriber<T>, BusError> {
        let service: PubSub<Wire<T>> = self.open_typed(channel)?;
        let quality = quality_of(channel);
        let make = || {
            service
                .subscriber_builder()
                .buffer_size(quality.buffer)
                .history_request(quality.late)
                .name(&self.port_name)
                .create()
        };
        let port = make().or_else(|_| self.after_cleaning(make)).map_err(|error| match error {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => BusError::Full {
                channel: channel.to_owned(),
                limit: quality.subscribers,
                what: "subscribers",
                holders: self.held_by(channel).1,
            },
            other => failed(channel, "be subscribed to", &other),
        })?;
        Ok(Subscriber { port, channel: channel.to_owned(), losses: Losses::default(), received: 0, broken: 0 })
    }
}

impl<T: Payload> Publisher<T> {
    /// Numbers the sample, publishes it and wakes who waits for it; returns how many subscribers it went to.
    ///
    /// # Errors
    /// [`BusError::Failed`] if shared memory has no room, which the channel's settings exclude.
    pub fn send(&mut self, sample: &mut T) -> Result<usize, BusError> {
        self.seq += 1;
        sample.number(self.seq);
        let recipients = self.publish(*sample)?;
        // A failure here means that the time between two notifications was long, or that a listener has just died; the sample is out.
        let _ = self.notifier.notify();
        Ok(recipients)
    }

    fn publish(&mut self, sample: T) -> Result<usize, BusError> {
        let loan = self.port.loan_uninit().map_err(|error| failed(&self.channel, "lend a sample", &error))?;
        loan.write_payload(Wire(sample)).send().map_err(|error| failed(&self.channel, "send", &error))
    }

    /// Connects to subscribers that came since the last [`Publisher::send`], and gives them the history.
    ///
    /// For publishers that rarely send: without this a late subscriber gets the history with the next sample.
    pub fn update_connections(&mut self) {
        // a subscriber that cannot be connected to has just died
        let _ = self.port.update_connections();
    }

    /// Sequence number of the last sample sent; 0: none yet.
    #[must_use]
    pub fn seq(&self) -> u64 {
        self.seq
    }

    /// The channel's name.
    #[must_use]
    pub fn channel(&self) -> &str {
        &self.channel
    }
}

impl<T: Payload> Subscriber<T> {
    /// The oldest sample not yet received, if there is one.
    ///
    /// Samples of a publisher that has gone come before those of its successor: decide by epoch, incarnation and cycle, never by arrival.
    ///
    /// # Errors
    /// [`BusError::Failed`] only if shared memory is damaged.
    pub fn receive(&mut self) -> Result<Option<T>, BusError> {
        let sample = match self.port.receive() {
            Err(ReceiveError::ConnectionFailure(_)) => {
                // one publisher could not be connected to, most likely because it was killed just now; the others can be heard
                self.broken += 1;
                self.port.receive()
            }
            other => other,
        }
        .map_err(|error| failed(&self.channel, "receive", &error))?;
        Ok(sample.map(|sample| {
            let Wire(value) = *sample.payload();
            self.losses.note(sample.header().publisher_id().value(), value.seq());
            self.received += 1;
            value
        }))
    }

    /// The newest sample, if any came since the last call; the older ones are taken and dropped (they do not count as lost).
    ///
    /// # Errors
    /// As [`Subscriber::receive`].
    pub fn latest(&mut self) -> Result<Option<T>, BusError> {
        let mut newest = None;
        while let Some(sample) = self.receive()? {
            newest = Some(sample);
        }
        Ok(newest)
    }

    /// Samples that were published and never arrived here.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.losses.lost
    }

    /// How often some were missing.
    #[must_use]
    pub fn gaps(&self) -> u64 {
        self.losses.gaps
    }

    /// Samples received.
    #[must_use]
    pub fn received(&self) -> u64 {
        self.received
    }

    /// How often a publisher could not be connected to.
    #[must_use]
    pub fn broken(&self) -> u64 {
        self.broken
    }

    /// The channel's name.
    #[must_use]
    pub fn channel(&self) -> &str {
        &self.channel
    }
}
