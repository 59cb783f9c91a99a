//! Publishers of blobs: samples of different lengths, with the header of every sample beside them.

use std::mem::MaybeUninit;

use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::{PortFactory as _, ZeroCopySend, ipc};
use iceoryx2::service::marker::{CustomHeaderMarker, CustomPayloadMarker};
use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
use messages::blob::BlobType;
use messages::{Header, quality_of_blobs};

use crate::memory::CONNECTION_BYTES;
use crate::node::{BORROWS, Bus, LOANS, SampleType, service_name, shared, sized};
use crate::port::as_made;
use crate::{BusError, clock, definition};

/// The header of a blob, beside its payload in shared memory.
#[repr(transparent)]
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct BlobHeader(pub(crate) Header);

/// Type name of [`BlobHeader`].
pub(crate) const BLOB_HEADER: &str = "nims_msgs/Header/1";

// SAFETY: a `Header` is `Pod`: no pointers, no padding, and every bit pattern is valid at any address.
#[allow(unsafe_code)]
unsafe impl ZeroCopySend for BlobHeader {
    unsafe fn type_name() -> &'static str {
        BLOB_HEADER
    }
}

type RawPort = iceoryx2::port::publisher::Publisher<ipc::Service, [CustomPayloadMarker], CustomHeaderMarker>;

/// Sends blobs of one type.
#[derive(Debug)]
pub struct BlobPublisher {
    port: RawPort,
    notifier: Notifier<ipc::Service>,
    channel: String,
    most_bytes: usize,
    seq: u64,
}

impl Bus {
    /// Creates a publisher of blobs of at most `most_bytes` bytes, up to `rate_hz` times a second, and the channel
    /// `blob/NAME` if it does not exist. All its memory is reserved now.
    ///
    /// # Errors
    /// [`BusError::NoMemory`] if there is not enough shared memory for them, and others as [`Bus::publisher`].
    pub fn blob_publisher(
        &self,
        channel: &str,
        kind: BlobType,
        most_bytes: usize,
        rate_hz: f64,
    ) -> Result<BlobPublisher, BusError> {
        if !channel.starts_with("blob/") || most_bytes == 0 {
            let why = "blobs have channels blob/NAME, and at least one byte";
            return Err(BusError::failed(channel, "be published on", &why));
        }
        let name = service_name(channel)?;
        let quality = quality_of_blobs(most_bytes).at_rate(rate_hz);
        let bytes = quality.samples(BORROWS, LOANS).saturating_mul(most_bytes);
        self.need(bytes.saturating_add(CONNECTION_BYTES * quality.subscribers), channel)?;
        let unfit = |why: &str| BusError::Schema { type_name: kind.type_name().to_owned(), why: why.to_owned() };
        let payload = TypeDetail::__internal_new_from_parts(TypeVariant::Dynamic, kind.type_name(), 1, 1)
            .map_err(|_| unfit("its name is too long"))?;
        let header = TypeDetail::new::<BlobHeader>(TypeVariant::FixedSize);
        let builder = || {
            let plain = self
                .node
                .service_builder(&name)
                .publish_subscribe::<[CustomPayloadMarker]>()
                .user_header::<CustomHeaderMarker>();
            // SAFETY: an element of the payload is one byte, and every bit pattern of it and of the header is a value.
            // `send` writes as many bytes as it loans, and the header.
            #[allow(unsafe_code)]
            let typed = unsafe {
                plain.__internal_set_payload_type_details(&payload).__internal_set_user_header_type_details(&header)
            };
            shared(typed)
        };
        let service = self.open_or_create(
            channel,
            SampleType { name: kind.type_name(), schema: kind.schema(), quality },
            || builder().open(),
            |attributes| {
                let limited = definition::with_limit(attributes, most_bytes);
                sized(builder(), &quality).create_with_attributes(limited.as_ref().unwrap_or(attributes))
            },
        )?;
        let made = as_made(quality, service.static_config());
        let samples = made.samples(service.static_config().subscriber_max_borrowed_samples(), LOANS);
        let make = || {
            service
                .publisher_builder()
                .initial_max_slice_len(most_bytes)
                .max_loaned_samples(LOANS)
                .override_sample_preallocation(move |_| samples)
                .name(&self.port_name)
                .create()
        };
        let port = self.take_publisher(channel, &made, make)?;
        let notifier = self.notifier(channel)?;
        self.announce();
        Ok(BlobPublisher { port, notifier, channel: channel.to_owned(), most_bytes, seq: 0 })
    }
}

impl BlobPublisher {
    /// Numbers the sample, publishes it and wakes the waiters.
    ///
    /// # Errors
    /// [`BusError::Failed`] if the body is longer than the publisher was created for, or empty; nothing is sent then.
    pub fn send(&mut self, mut header: Header, body: &[u8]) -> Result<(), BusError> {
        if body.is_empty() || body.len() > self.most_bytes {
            let why = format!("it has {} bytes; accepted: 1 to {}", body.len(), self.most_bytes);
            return Err(BusError::failed(&self.channel, "take a blob", &why));
        }
        // SAFETY: an element of the payload is one byte.
        #[allow(unsafe_code)]
        let loan = unsafe { self.port.loan_custom_payload(body.len()) };
        let mut loan = loan.map_err(|error| BusError::failed(&self.channel, "lend a blob", &error))?;
        self.seq += 1;
        (header.seq, header.published_ns) = (self.seq, clock::now_ns());
        // SAFETY: the channel has the user header `BlobHeader`, set above, which is a `Header`.
        #[allow(unsafe_code)]
        unsafe {
            std::ptr::from_mut(loan.user_header_mut()).cast::<Header>().write_unaligned(header);
        }
        let payload: &mut [MaybeUninit<CustomPayloadMarker>] = loan.payload_mut();
        if payload.len() != body.len() {
            return Err(BusError::failed(&self.channel, "lend a blob", &"its length is another one"));
        }
        // SAFETY: `CustomPayloadMarker` is one byte wide (`repr(C)` over a u8), both have the same length, and the loan
        // is memory of its own.
        #[allow(unsafe_code)]
        unsafe {
            std::ptr::copy_nonoverlapping(body.as_ptr(), payload.as_mut_ptr().cast(), body.len());
        }
        // SAFETY: every byte was written above.
        #[allow(unsafe_code)]
        let sample = unsafe { loan.assume_init() };
        sample.send().map_err(|error| BusError::failed(&self.channel, "send", &error))?;
        // As in `Publisher::send`.
        let _ = self.notifier.notify();
        Ok(())
    }

    /// Returns the name of the channel.
    #[must_use]
    pub fn channel(&self) -> &str {
        &self.channel
    }
}
