//! Publishers of types that this build does not contain: a program outside of the robot has declared them.

use std::mem::MaybeUninit;

use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::{PortFactory as _, ipc};
use iceoryx2::service::marker::{CustomHeaderMarker, CustomPayloadMarker};
use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
use messages::{Declaration, Header, Quality};

use crate::node::{Bus, LOANS, SampleType, service_name, shared, sized};
use crate::port::as_made;
use crate::{BusError, clock};

type RawPort = iceoryx2::port::publisher::Publisher<ipc::Service, [CustomPayloadMarker], CustomHeaderMarker>;

/// Sends samples of a declared type as bytes.
#[derive(Debug)]
pub struct DeclaredPublisher {
    port: RawPort,
    notifier: Notifier<ipc::Service>,
    channel: String,
    type_name: String,
    size: usize,
    seq: u64,
}

impl Bus {
    /// Creates a publisher of a declared type, and the channel with its definition if it does not exist. Peers that
    /// have the type as a struct, and those in other languages, see the same channel. `quality`: that of the channel if
    /// it is created here.
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    pub fn declared_publisher(
        &self,
        channel: &str,
        declared: &Declaration,
        quality: Quality,
    ) -> Result<DeclaredPublisher, BusError> {
        let name = service_name(channel)?;
        let (type_name, size) = (declared.type_name(), declared.size());
        self.need_for(channel, &quality, size)?;
        let unfit = |_| BusError::Schema { type_name: type_name.to_owned(), why: "its name is too long".to_owned() };
        // A sample begins with its header, whose numbers have eight bytes.
        let payload =
            TypeDetail::__internal_new_from_parts(TypeVariant::FixedSize, type_name, size, align_of::<Header>());
        let (payload, header) = (payload.map_err(unfit)?, TypeDetail::new::<()>(TypeVariant::FixedSize));
        let builder = || {
            let plain = self
                .node
                .service_builder(&name)
                .publish_subscribe::<[CustomPayloadMarker]>()
                .user_header::<CustomHeaderMarker>();
            // SAFETY: the details are those of a struct of the declared fields: its size has no hidden padding, and
            // every bit pattern is a value. `send` writes exactly that many bytes.
            #[allow(unsafe_code)]
            let typed = unsafe {
                plain.__internal_set_payload_type_details(&payload).__internal_set_user_header_type_details(&header)
            };
            shared(typed)
        };
        let service = self.open_or_create(
            channel,
            SampleType { name: type_name, schema: declared.definition(), quality },
            || builder().open(),
            |attributes| sized(builder(), &quality).create_with_attributes(attributes),
        )?;
        let made = as_made(quality, service.static_config());
        let samples = made.samples(service.static_config().subscriber_max_borrowed_samples(), LOANS);
        let make = || {
            service
                .publisher_builder()
                .initial_max_slice_len(1)
                .max_loaned_samples(LOANS)
                .override_sample_preallocation(move |_| samples)
                .name(&self.port_name)
                .create()
        };
        let port = self.take_publisher(channel, &made, make)?;
        let publisher = DeclaredPublisher {
            port,
            notifier: self.notifier(channel)?,
            channel: channel.to_owned(),
            type_name: type_name.to_owned(),
            size,
            seq: 0,
        };
        self.announce();
        Ok(publisher)
    }
}

impl DeclaredPublisher {
    /// Numbers the sample, publishes it and wakes the waiters. `header` replaces the first bytes of `sample`.
    ///
    /// # Errors
    /// [`BusError::Failed`] if the sample has another size than the type, or no sample is free.
    pub fn send(&mut self, mut header: Header, sample: &[u8]) -> Result<(), BusError> {
        let Some(fields) = sample.get(size_of::<Header>()..).filter(|_| sample.len() == self.size) else {
            let why = format!("it has {} bytes, and its type {}", sample.len(), self.size);
            return Err(BusError::failed(&self.channel, "take a sample", &why));
        };
        // SAFETY: the channel has a type of fixed size, so one element is loaned.
        #[allow(unsafe_code)]
        let loan = unsafe { self.port.loan_custom_payload(1) };
        let mut loan = loan.map_err(|error| BusError::failed(&self.channel, "lend a sample", &error))?;
        self.seq += 1;
        (header.seq, header.published_ns) = (self.seq, clock::now_ns());
        let payload: &mut [MaybeUninit<CustomPayloadMarker>] = loan.payload_mut();
        let bytes = bytemuck::bytes_of(&header).iter().chain(fields);
        // SAFETY: `CustomPayloadMarker` is one byte wide (`repr(C)` over a u8), and a payload of one element has as
        // many of them as the type has bytes. The slice is written whole before it is sent.
        #[allow(unsafe_code)]
        let into: &mut [MaybeUninit<u8>] =
            unsafe { std::slice::from_raw_parts_mut(payload.as_mut_ptr().cast(), payload.len()) };
        if into.len() != self.size {
            return Err(BusError::failed(&self.channel, "lend a sample", &"its size is not that of the type"));
        }
        for (into, byte) in into.iter_mut().zip(bytes) {
            into.write(*byte);
        }
        // SAFETY: every byte was written above.
        #[allow(unsafe_code)]
        let sample = unsafe { loan.assume_init() };
        sample.send().map_err(|error| BusError::failed(&self.channel, "send", &error))?;
        // As in `Publisher::send`.
        let _ = self.notifier.notify();
        Ok(())
    }

    /// Returns the type name of the channel.
    #[must_use]
    pub fn type_name(&self) -> &str {
        &self.type_name
    }
}
