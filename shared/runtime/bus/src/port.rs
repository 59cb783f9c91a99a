//! Typed ports.

use iceoryx2::port::ReceiveError;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{
    CallbackProgression, IceoryxSend, MessagingPattern, PortFactory as _, PortName, ZeroCopySend, ipc,
};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use messages::ros::Payload;
use messages::{Quality, quality_for};
use std::fmt::Debug;

use crate::BusError;
use crate::error::PlaceKind;
use crate::losses::Losses;
use crate::memory::CONNECTION_BYTES;
use crate::node::{BORROWS, Bus, LOANS, PubSub};
use crate::places::{Refused, listed};
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
    /// A publisher; makes the channel if nobody has.
    ///
    /// # Errors
    /// [`BusError::Full`] if the channel has its publishers already, [`BusError::TypeMismatch`] if it carries another type, and others.
    pub fn publisher<T: Payload>(&self, channel: &str) -> Result<Publisher<T>, BusError> {
        let quality = quality_for(channel, size_of::<T>());
        let bytes = quality.samples(BORROWS, LOANS).saturating_mul(size_of::<T>());
        self.need(bytes.saturating_add(CONNECTION_BYTES * quality.subscribers), channel)?;
        let service: PubSub<ShmSample<T>> = self.open_typed(channel)?;
        // what another build, or a tunnel, has made it with
        let made = service.static_config();
        let quality = Quality {
            buffer: made.subscriber_max_buffer_size(),
            history: made.history_size(),
            subscribers: made.max_subscribers(),
            ..quality
        };
        let samples = quality.samples(made.subscriber_max_borrowed_samples(), LOANS);
        let make = || {
            service
                .publisher_builder()
                .max_loaned_samples(LOANS)
                .override_sample_preallocation(move |_| samples)
                .name(&self.port_name)
                .create()
        };
        let refused = |error| match error {
            PublisherCreateError::ExceedsMaxSupportedPublishers => {
                self.full(channel, MessagingPattern::PublishSubscribe, quality.publishers, PlaceKind::Publishers)
            }
            other => BusError::failed(channel, "be published on", &other),
        };
        let port = self.whole(channel, || make().or_else(|_| self.after_cleaning(make)).map_err(refused))?;
        let publisher = Publisher { port, notifier: self.notifier(channel)?, channel: channel.to_owned(), seq: 0 };
        self.announce();
        Ok(publisher)
    }

    /// A subscriber that can lag behind by [`Quality::SHALLOW`] samples, with the history that a late one gets; makes the channel if nobody
    /// has, so it may come first.
    ///
    /// # Errors
    /// [`BusError::Full`] if the channel has its subscribers already, [`BusError::TypeMismatch`] if it carries another type, and others.
    pub fn subscriber<T: Payload>(&self, channel: &str) -> Result<Subscriber<T>, BusError> {
        self.subscriber_with(channel, Quality::SHALLOW)
    }

    /// The same with the channel's whole buffer: for who has to hear every sample, of which a channel has [`Quality::DEEP_PLACES`].
    ///
    /// # Errors
    /// As [`Bus::subscriber`].
    pub fn deep_subscriber<T: Payload>(&self, channel: &str) -> Result<Subscriber<T>, BusError> {
        self.subscriber_with(channel, usize::MAX)
    }

    fn subscriber_with<T: Payload>(&self, channel: &str, depth: usize) -> Result<Subscriber<T>, BusError> {
        let service: PubSub<ShmSample<T>> = self.open_typed(channel)?;
        let late = quality_for(channel, size_of::<T>()).late;
        let made = service.static_config();
        let buffer = made.subscriber_max_buffer_size().min(depth);
        let history = late.min(made.history_size()).min(buffer);
        let port = self.attach(&service, channel, buffer, history)?;
        Ok(Subscriber { port, channel: channel.to_owned(), losses: Losses::default(), received: 0, broken: 0 })
    }

    /// Makes a subscriber where there is a place for it: one of its kind, and, with a buffer of more than [`Quality::SHALLOW`], a deep one.
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
            listed(|note| {
                service.dynamic_config().list_subscribers(|port| {
                    note((port.subscriber_name, port.buffer_size));
                    CallbackProgression::Continue
                });
            })
        };
        let limit = service.static_config().max_subscribers();
        let full = |limit, what| self.full(channel, MessagingPattern::PublishSubscribe, limit, what);
        let is_deep = |buffer: usize| buffer > Quality::SHALLOW;
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
        self.whole(channel, || self.take_place(limit, names, make).map_err(refused))
    }
}

impl<T: Payload> Publisher<T> {
    /// Numbers the sample, publishes it and wakes who waits for it; returns how many subscribers it went to.
    ///
    /// # Errors
    /// [`BusError::Failed`] if shared memory has no room, which the channel's settings exclude.
    pub fn send(&mut self, sample: &mut T) -> Result<usize, BusError> {
        self.seq += 1;
        sample.number(self.seq, crate::clock::now_ns());
        let recipients = self.publish(*sample)?;
        // A failure here means that the time between two notifications was long, or that a listener has just died; the sample is out.
        let _ = self.notifier.notify();
        Ok(recipients)
    }

    fn publish(&mut self, sample: T) -> Result<usize, BusError> {
        let loan = self.port.loan_uninit().map_err(|error| BusError::failed(&self.channel, "lend a sample", &error))?;
        loan.write_payload(ShmSample(sample)).send().map_err(|error| BusError::failed(&self.channel, "send", &error))
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
        .map_err(|error| BusError::failed(&self.channel, "receive", &error))?;
        Ok(sample.map(|sample| {
            let ShmSample(value) = *sample.payload();
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
