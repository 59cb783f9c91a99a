//! Typed publishers and subscribers.

use iceoryx2::port::ReceiveError;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{
    CallbackProgression, IceoryxSend, MessagingPattern, PortFactory as _, PortName, ZeroCopySend, ipc,
};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use iceoryx2::service::static_config::publish_subscribe::StaticConfig;
use messages::ros::Payload;
use messages::{Quality, quality_for};
use std::fmt::Debug;

use crate::BusError;
use crate::error::PlaceKind;
use crate::losses::Losses;
use crate::memory::CONNECTION_BYTES;
use crate::node::{BORROWS, Bus, LOANS, PubSub};
use crate::places::{Refused, collect_listed};
use crate::shm_sample::ShmSample;

/// Sends samples of one type on one channel.
#[derive(Debug)]
pub struct Publisher<T: Payload> {
    port: iceoryx2::port::publisher::Publisher<ipc::Service, ShmSample<T>, ()>,
    notifier: Notifier<ipc::Service>,
    channel: String,
    seq: u64,
}

/// Receives samples of one type from one channel.
#[derive(Debug)]
pub struct Subscriber<T: Payload> {
    port: iceoryx2::port::subscriber::Subscriber<ipc::Service, ShmSample<T>, ()>,
    channel: String,
    losses: Losses,
    received: u64,
    broken: u64,
}

impl Bus {
    /// Creates a publisher, and the channel if it does not exist.
    ///
    /// # Errors
    /// [`BusError::Full`] if all publishers of the channel are taken, [`BusError::TypeMismatch`] if it carries another
    /// type, and others.
    pub fn publisher<T: Payload>(&self, channel: &str) -> Result<Publisher<T>, BusError> {
        let quality = quality_for(channel, size_of::<T>());
        self.need_for(channel, &quality, size_of::<T>())?;
        let service: PubSub<ShmSample<T>> = self.open_typed(channel)?;
        let made = as_made(quality, service.static_config());
        let samples = made.samples(service.static_config().subscriber_max_borrowed_samples(), LOANS);
        let make = || {
            service
                .publisher_builder()
                .max_loaned_samples(LOANS)
                .override_sample_preallocation(move |_| samples)
                .name(&self.port_name)
                .create()
        };
        let port = self.take_publisher(channel, &made, make)?;
        let publisher = Publisher { port, notifier: self.notifier(channel)?, channel: channel.to_owned(), seq: 0 };
        self.announce();
        Ok(publisher)
    }

    /// Refuses a publisher for whose samples there is not enough shared memory.
    pub(crate) fn need_for(&self, channel: &str, quality: &Quality, size: usize) -> Result<(), BusError> {
        let bytes = quality.samples(BORROWS, LOANS).saturating_mul(size);
        self.need(bytes.saturating_add(CONNECTION_BYTES * quality.subscribers), channel)
    }

    /// Creates the port of a publisher, after a clean-up if all places are taken.
    pub(crate) fn take_publisher<P>(
        &self,
        channel: &str,
        quality: &Quality,
        make: impl Fn() -> Result<P, PublisherCreateError>,
    ) -> Result<P, BusError> {
        let refused = |error| match error {
            PublisherCreateError::ExceedsMaxSupportedPublishers => {
                self.full(channel, MessagingPattern::PublishSubscribe, quality.publishers, PlaceKind::Publishers)
            }
            other => BusError::failed(channel, "be published on", &other),
        };
        self.make_complete(channel, || make().or_else(|_| self.after_cleaning(&make)).map_err(refused))
    }

    /// Creates a subscriber with a buffer of [`Quality::shallow`] samples that receives the history for late
    /// subscribers. Creates the channel if it does not exist, so a subscriber can be created before the publisher.
    ///
    /// # Errors
    /// [`BusError::Full`] if all subscribers of the channel are taken, [`BusError::TypeMismatch`] if it carries another
    /// type, and others.
    pub fn subscriber<T: Payload>(&self, channel: &str) -> Result<Subscriber<T>, BusError> {
        self.subscriber_with(channel, messages::quality_of(channel).shallow())
    }

    /// Creates a subscriber with the channel's whole buffer, for processes that need every sample. A channel has
    /// [`Quality::DEEP_PLACES`] of these.
    ///
    /// # Errors
    /// As [`Bus::subscriber`].
    pub fn deep_subscriber<T: Payload>(&self, channel: &str) -> Result<Subscriber<T>, BusError> {
        self.subscriber_with(channel, usize::MAX)
    }

    pub(crate) fn subscriber_with<T: Payload>(&self, channel: &str, depth: usize) -> Result<Subscriber<T>, BusError> {
        let service: PubSub<ShmSample<T>> = self.open_typed(channel)?;
        let late = quality_for(channel, size_of::<T>()).late;
        let made = service.static_config();
        let buffer = made.subscriber_max_buffer_size().min(depth);
        let history = late.min(made.history_size()).min(buffer);
        let port = self.attach(&service, channel, buffer, history)?;
        Ok(Subscriber { port, channel: channel.to_owned(), losses: Losses::default(), received: 0, broken: 0 })
    }

    /// Creates a subscriber if there is a place for its kind and, with a buffer of more than [`Quality::shallow`], a
    /// deep place.
    pub(crate) fn attach<P: IceoryxSend + Debug + ?Sized, H: ZeroCopySend + Debug>(
        &self,
        service: &PortFactory<ipc::Service, P, H>,
        channel: &str,
        buffer: usize,
        history: usize,
    ) -> Result<iceoryx2::port::subscriber::Subscriber<ipc::Service, P, H>, BusError> {
        let make =
            || service.subscriber_builder().buffer_size(buffer).history_request(history).name(&self.port_name).create();
        let taken = || {
            collect_listed(|note| {
                service.dynamic_config().list_subscribers(|port| {
                    note((port.subscriber_name, port.buffer_size));
                    CallbackProgression::Continue
                });
            })
        };
        let limit = service.static_config().max_subscribers();
        let full = |limit, what| self.full(channel, MessagingPattern::PublishSubscribe, limit, what);
        let shallow = messages::quality_of(channel).shallow();
        let is_deep = |buffer: usize| buffer > shallow;
        let all_deep = || taken().iter().filter(|(_, buffer)| is_deep(*buffer)).count() >= Quality::DEEP_PLACES;
        if is_deep(buffer) && all_deep() {
            self.clean();
            if all_deep() {
                return Err(full(Quality::DEEP_PLACES, PlaceKind::DeepSubscribers));
            }
        }
        let names = || taken().into_iter().map(|(name, _): (PortName, usize)| name).collect();
        let refused = |refused| match refused {
            Refused::NoPlace(limit) => full(limit, PlaceKind::SubscribersOfParty),
            Refused::Error(SubscriberCreateError::ExceedsMaxSupportedSubscribers) => {
                full(limit, PlaceKind::Subscribers)
            }
            Refused::Error(other) => BusError::failed(channel, "be subscribed to", &other),
        };
        self.make_complete(channel, || self.take_place(limit, names, make).map_err(refused))
    }
}

/// The quality of service with which a channel exists: another build or a tunnel may have created it with other
/// settings.
pub(crate) fn as_made(quality: Quality, made: &StaticConfig) -> Quality {
    Quality {
        buffer: made.subscriber_max_buffer_size(),
        history: made.history_size(),
        subscribers: made.max_subscribers(),
        ..quality
    }
}

impl<T: Payload> Publisher<T> {
    /// Numbers the sample, publishes it and wakes the waiters; returns the number of subscribers.
    ///
    /// # Errors
    /// [`BusError::Failed`] if no sample is free, which the channel's settings exclude.
    pub fn send(&mut self, sample: &mut T) -> Result<usize, BusError> {
        self.seq += 1;
        sample.number(self.seq, crate::clock::now_ns());
        let recipients = self.publish(sample)?;
        // A failure means that the time since the last notification was long or that a listener has just died; the
        // sample is published anyway.
        let _ = self.notifier.notify();
        Ok(recipients)
    }

    fn publish(&mut self, sample: &T) -> Result<usize, BusError> {
        let loan = self.port.loan_uninit().map_err(|error| BusError::failed(&self.channel, "lend a sample", &error))?;
        loan.write_payload(ShmSample(*sample)).send().map_err(|error| BusError::failed(&self.channel, "send", &error))
    }

    /// Connects to subscribers created since the last [`Publisher::send`], and sends them the history.
    ///
    /// For publishers that rarely send: otherwise a late subscriber receives the history with the next sample.
    pub fn update_connections(&mut self) {
        // A connection fails only if its subscriber has just died.
        let _ = self.port.update_connections();
    }

    /// Returns the sequence number of the last sample sent; 0 if none was sent.
    #[must_use]
    pub fn seq(&self) -> u64 {
        self.seq
    }

    /// Returns the name of the channel.
    #[must_use]
    pub fn channel(&self) -> &str {
        &self.channel
    }
}

impl<T: Payload> Subscriber<T> {
    /// Returns the oldest sample not yet received, if there is one.
    ///
    /// Samples of an ended publisher may arrive after its successor has started: order them by epoch, incarnation and
    /// cycle, not by arrival.
    ///
    /// # Errors
    /// [`BusError::Failed`] only if shared memory is damaged.
    pub fn receive(&mut self) -> Result<Option<T>, BusError> {
        let sample = match self.port.receive() {
            Err(ReceiveError::ConnectionFailure(_)) => {
                // The connection to one publisher failed, probably because it was just killed; the others still work.
                self.broken += 1;
                self.port.receive()
            }
            other => other,
        }
        .map_err(|error| BusError::failed(&self.channel, "receive", &error))?;
        Ok(sample.map(|sample| {
            let ShmSample(value) = *sample.payload();
            self.losses.record(sample.header().publisher_id().value(), value.seq());
            self.received += 1;
            value
        }))
    }

    /// Returns the newest sample, if any arrived since the last call. Older samples are dropped and do not count as
    /// lost.
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

    /// Returns the number of samples that were published and never arrived here.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.losses.lost
    }

    /// Returns the number of gaps in the sequence numbers.
    #[must_use]
    pub fn gaps(&self) -> u64 {
        self.losses.gaps
    }

    /// Returns the number of samples received.
    #[must_use]
    pub fn received(&self) -> u64 {
        self.received
    }

    /// Returns the number of failed connections to publishers.
    #[must_use]
    pub fn broken(&self) -> u64 {
        self.broken
    }

    /// Returns the name of the channel.
    #[must_use]
    pub fn channel(&self) -> &str {
        &self.channel
    }
}
