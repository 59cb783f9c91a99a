//! Publishers of types that this build does not contain: a program outside of the robot has declared them.

use std::mem::MaybeUninit;

use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::ipc;
use iceoryx2::service::marker::CustomPayloadMarker;
use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
use messages::{Declaration, Header, Quality};

use crate::node::{Bus, SampleType};
use crate::untyped::{Layout, UntypedPort};
use crate::{BusError, clock};

/// Sends samples of a declared type as bytes.
#[derive(Debug)]
pub struct DeclaredPublisher {
    port: UntypedPort,
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
        let (type_name, size) = (declared.type_name(), declared.size());
        let layout = Layout {
            variant: TypeVariant::FixedSize,
            // A sample begins with its header, whose numbers have eight bytes.
            element: [size, align_of::<Header>()],
            most: 1,
            header: TypeDetail::new::<()>(TypeVariant::FixedSize),
        };
        let sample = SampleType { name: type_name, schema: declared.definition(), quality };
        let (port, notifier) = self.untyped_publisher(channel, sample, &layout, |_| None)?;
        let (channel, type_name) = (channel.to_owned(), type_name.to_owned());
        Ok(DeclaredPublisher { port, notifier, channel, type_name, size, seq: 0 })
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
