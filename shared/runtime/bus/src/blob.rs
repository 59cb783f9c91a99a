//! Publishers of blobs: samples of different lengths, with the header of every sample beside them.

use std::mem::MaybeUninit;

use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::{ZeroCopySend, ipc};
use iceoryx2::service::marker::CustomPayloadMarker;
use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
use messages::blob::BlobType;
use messages::{Header, quality_of_blobs};

use crate::node::{Bus, SampleType};
use crate::untyped::{Layout, UntypedPort};
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

/// Sends blobs of one type.
#[derive(Debug)]
pub struct BlobPublisher {
    port: UntypedPort,
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
        let quality = quality_of_blobs(most_bytes).at_rate(rate_hz);
        let layout = Layout {
            variant: TypeVariant::Dynamic,
            element: [1, 1],
            most: most_bytes,
            header: TypeDetail::new::<BlobHeader>(TypeVariant::FixedSize),
        };
        let sample = SampleType { name: kind.type_name(), schema: kind.schema(), quality };
        let limited = |attributes: &_| definition::with_limit(attributes, most_bytes);
        let (port, notifier) = self.untyped_publisher(channel, sample, &layout, limited)?;
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
