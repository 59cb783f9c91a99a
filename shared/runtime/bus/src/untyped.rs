//! Publishers of types that this build has no struct for: of a declared type, and of blobs.

use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::{AttributeSpecifier, PortFactory as _, ipc};
use iceoryx2::service::marker::{CustomHeaderMarker, CustomPayloadMarker};
use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};

use crate::BusError;
use crate::node::{Bus, LOANS, SampleType, service_name, shared, sized};
use crate::port::as_made;

pub(crate) type UntypedPort =
    iceoryx2::port::publisher::Publisher<ipc::Service, [CustomPayloadMarker], CustomHeaderMarker>;

/// The layout of the samples in shared memory. Every bit pattern is a value of both parts.
pub(crate) struct Layout {
    /// Whether the payload is one element or several.
    pub variant: TypeVariant,
    /// Size and alignment of an element of the payload, bytes.
    pub element: [usize; 2],
    /// Most elements of a payload.
    pub most: usize,
    /// The header beside the payload.
    pub header: TypeDetail,
}

impl Bus {
    /// Creates a publisher, and the channel with its definition if it does not exist. All its memory is reserved now.
    /// `extended` may add to the attributes of the channel.
    pub(crate) fn untyped_publisher(
        &self,
        channel: &str,
        sample: SampleType<'_>,
        layout: &Layout,
        extended: impl Fn(&AttributeSpecifier) -> Option<AttributeSpecifier>,
    ) -> Result<(UntypedPort, Notifier<ipc::Service>), BusError> {
        let name = service_name(channel)?;
        let (quality, [size, align]) = (sample.quality, layout.element);
        self.need_for(channel, &quality, size.saturating_mul(layout.most))?;
        let payload =
            TypeDetail::__internal_new_from_parts(layout.variant, sample.name, size, align).map_err(|_| {
                BusError::Schema { type_name: sample.name.to_owned(), why: "its name is too long".to_owned() }
            })?;
        let builder = || {
            let plain = self
                .node
                .service_builder(&name)
                .publish_subscribe::<[CustomPayloadMarker]>()
                .user_header::<CustomHeaderMarker>();
            // SAFETY: every bit pattern of payload and header is a value, as `Layout` demands. The publishers write
            // every byte that they loan.
            #[allow(unsafe_code)]
            let typed = unsafe {
                plain
                    .__internal_set_payload_type_details(&payload)
                    .__internal_set_user_header_type_details(&layout.header)
            };
            shared(typed)
        };
        let service = self.open_or_create(
            channel,
            sample,
            || builder().open(),
            |attributes| {
                let more = extended(attributes);
                sized(builder(), &quality).create_with_attributes(more.as_ref().unwrap_or(attributes))
            },
        )?;
        let made = as_made(quality, service.static_config());
        let samples = made.samples(service.static_config().subscriber_max_borrowed_samples(), LOANS);
        let make = || {
            service
                .publisher_builder()
                .initial_max_slice_len(layout.most)
                .max_loaned_samples(LOANS)
                .override_sample_preallocation(move |_| samples)
                .name(&self.port_name)
                .create()
        };
        let port = self.take_publisher(channel, &made, make)?;
        let notifier = self.notifier(channel)?;
        self.announce();
        Ok((port, notifier))
    }
}
