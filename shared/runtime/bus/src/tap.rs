//! Channels of any type: finding them, and listening without knowing the type.

use std::collections::HashSet;
use std::fs;
use std::os::unix::fs::MetadataExt;

use iceoryx2::port::ReceiveError;
use iceoryx2::prelude::{
    CallbackProgression, MessagingPattern, NodeState, PortFactory as _, Service, ServiceDetails, ServiceName, ipc,
};
use iceoryx2::service::marker::{CustomHeaderMarker, CustomPayloadMarker};
use iceoryx2::service::static_config::messaging_pattern::MessagingPattern as Pattern;
use messages::schema::Schema;
use messages::{Header, Quality};

use crate::domain::info_of;
use crate::losses::Losses;
use crate::node::service_name;
use crate::places::listed;
use crate::{Bus, BusError, Domain, NodeInfo, definition};

/// A channel as it stands in shared memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelInfo {
    /// e.g. `motor/state`.
    pub name: String,
    /// e.g. `nims_msgs/MotorState/1a2b3c4d`.
    pub type_name: String,
    /// The schema text that travels with it; `None` if its maker gave none, or not all of it.
    pub schema: Option<String>,
    /// The hash of the schema text, as its maker gave it.
    pub schema_hash: Option<String>,
    /// Bytes of a sample.
    pub size: usize,
    /// Samples a deep subscriber can lag behind.
    pub buffer: usize,
    /// Samples a late subscriber gets.
    pub history: usize,
    /// The processes that hold it open, as publisher or as subscriber.
    pub holders: Vec<NodeInfo>,
}

/// One sample, as bytes.
#[derive(Debug, Clone, Copy)]
pub struct Raw<'a> {
    /// The whole sample, header included; a little-endian CDR body.
    pub bytes: &'a [u8],
    /// Its header, where the type has this header ([`Tap::has_header`]); otherwise zeros.
    pub header: Header,
    /// Tells publishers apart, also those of one process.
    pub publisher: u128,
    /// Samples of this publisher that are missing before this one; 0 where the type has no header, and so no numbers to tell by.
    pub missing: u64,
}

type RawPort = iceoryx2::port::subscriber::Subscriber<ipc::Service, [CustomPayloadMarker], CustomHeaderMarker>;

/// Listens to a channel of any type.
#[derive(Debug)]
pub struct Tap {
    port: RawPort,
    info: ChannelInfo,
    has_header: bool,
    losses: Losses,
    received: u64,
}

impl Bus {
    /// Every channel of the domain, by name. Costs about 0.2 ms per channel: not for a control loop.
    ///
    /// # Errors
    /// [`BusError::Failed`] if the folder cannot be read.
    pub fn channels(&self) -> Result<Vec<ChannelInfo>, BusError> {
        let mut channels = Vec::new();
        ipc::Service::list(self.domain().config(), |details| {
            channels.extend(describe(self.domain(), &details));
            CallbackProgression::Continue
        })
        .map_err(|error| BusError::failed("*", "be listed", &error))?;
        channels.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(channels)
    }

    /// One channel, if somebody has opened it.
    ///
    /// # Errors
    /// [`BusError::ChannelName`], or [`BusError::Failed`] if it cannot be read.
    pub fn channel(&self, name: &str) -> Result<Option<ChannelInfo>, BusError> {
        let details =
            ipc::Service::details(&service_name(name)?, self.domain().config(), MessagingPattern::PublishSubscribe)
                .map_err(|error| BusError::failed(name, "be looked up", &error))?;
        Ok(details.and_then(|details| describe(self.domain(), &details)))
    }

    /// How many publishers and subscribers a channel has, the dead that nobody has removed yet included.
    ///
    /// # Errors
    /// As [`Bus::tap`].
    pub fn ports(&self, name: &str) -> Result<(usize, usize), BusError> {
        let (service, _) = self.open_raw(name)?;
        let dynamic = service.dynamic_config();
        Ok((dynamic.number_of_publishers(), dynamic.number_of_subscribers()))
    }

    /// Who publishes on a channel: the number that its samples carry ([`Raw::publisher`]) and the process id.
    ///
    /// # Errors
    /// As [`Bus::tap`].
    pub fn publishers(&self, name: &str) -> Result<Vec<(u128, u32)>, BusError> {
        let (service, _) = self.open_raw(name)?;
        Ok(listed(|note| {
            service.dynamic_config().list_publishers(|port| {
                if let Ok(pid) = port.node_id.pid::<ipc::Service>() {
                    note((port.publisher_id.value(), pid.value().unsigned_abs()));
                }
                CallbackProgression::Continue
            });
        }))
    }

    /// Listens to a channel that exists, whatever it carries, with a buffer of [`Quality::SHALLOW`] samples, and as much of its history as any
    /// late subscriber gets.
    ///
    /// # Errors
    /// [`BusError::NoChannel`] if nobody has opened it, [`BusError::Full`] if it has its subscribers already, and others.
    pub fn tap(&self, name: &str) -> Result<Tap, BusError> {
        self.tap_with(name, Quality::SHALLOW, messages::quality_of(name).late)
    }

    /// The same with the channel's whole buffer and all that it has kept: for whoever must not miss anything, nor what was said before it
    /// came. A channel has [`Quality::DEEP_PLACES`] of these.
    ///
    /// # Errors
    /// As [`Bus::tap`].
    pub fn tap_with_history(&self, name: &str) -> Result<Tap, BusError> {
        self.tap_with(name, usize::MAX, usize::MAX)
    }

    fn tap_with(&self, name: &str, depth: usize, samples: usize) -> Result<Tap, BusError> {
        self.need(0, name)?;
        let (service, info) = self.open_raw(name)?;
        let buffer = info.buffer.min(depth);
        let history = info.history.min(samples).min(buffer);
        let port = self.attach(&service, name, buffer, history)?;
        let layout = info.schema.as_deref().and_then(|text| Schema::parse(text).ok());
        let has_header = layout.is_some_and(|layout| layout.has_header());
        Ok(Tap { port, info, has_header, losses: Losses::default(), received: 0 })
    }

    #[allow(clippy::type_complexity)]
    fn open_raw(
        &self,
        name: &str,
    ) -> Result<
        (
            iceoryx2::service::port_factory::publish_subscribe::PortFactory<
                ipc::Service,
                [CustomPayloadMarker],
                CustomHeaderMarker,
            >,
            ChannelInfo,
        ),
        BusError,
    > {
        let absent = || BusError::NoChannel { channel: name.to_owned(), domain: self.domain().name().to_owned() };
        let service: ServiceName = service_name(name)?;
        let details = ipc::Service::details(&service, self.domain().config(), MessagingPattern::PublishSubscribe)
            .map_err(|error| BusError::failed(name, "be looked up", &error))?
            .ok_or_else(absent)?;
        let info = describe(self.domain(), &details).ok_or_else(absent)?;
        let types = details.static_details.publish_subscribe().message_type_details();
        // SAFETY: the type details are those that the channel itself states, and `Tap` reads samples as bytes only, as many as it says.
        #[allow(unsafe_code)]
        let opened = unsafe {
            self.node
                .service_builder(&service)
                .publish_subscribe::<[CustomPayloadMarker]>()
                .user_header::<CustomHeaderMarker>()
                .__internal_set_payload_type_details(&types.payload)
                .__internal_set_user_header_type_details(&types.user_header)
                .open()
        };
        Ok((opened.map_err(|error| BusError::failed(name, "be opened", &error))?, info))
    }
}

impl Tap {
    /// Gives the oldest sample not yet received to `take`; `None` if there is none.
    ///
    /// # Errors
    /// [`BusError::Failed`] only if shared memory is damaged.
    pub fn receive<R>(&mut self, take: impl FnOnce(Raw<'_>) -> R) -> Result<Option<R>, BusError> {
        let sample = match self.port.receive() {
            // as in `Subscriber::receive`
            Err(ReceiveError::ConnectionFailure(_)) => self.port.receive(),
            other => other,
        }
        .map_err(|error| BusError::failed(&self.info.name, "receive", &error))?;
        let Some(sample) = sample else { return Ok(None) };
        let payload = sample.payload();
        // SAFETY: `CustomPayloadMarker` is one byte wide (`repr(C)` over a u8), the slice counts bytes, and a channel carries plain data only.
        #[allow(unsafe_code)]
        let bytes: &[u8] = unsafe { std::slice::from_raw_parts(payload.as_ptr().cast(), payload.len()) };
        let header = bytes.get(..size_of::<Header>()).filter(|_| self.has_header);
        let header = header.map_or_else(Header::default, bytemuck::pod_read_unaligned);
        let publisher = sample.header().publisher_id().value();
        let missing = if self.has_header { self.losses.note(publisher, header.seq) } else { 0 };
        self.received += 1;
        Ok(Some(take(Raw { bytes, header, publisher, missing })))
    }

    /// What is known of the channel.
    #[must_use]
    pub fn info(&self) -> &ChannelInfo {
        &self.info
    }

    /// Whether the channel's definition says that samples begin with [`Header`]: only then it is known which are missing.
    #[must_use]
    pub fn has_header(&self) -> bool {
        self.has_header
    }

    /// Samples that were published and never arrived here, as far as they are numbered.
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
}

/// Finds new channels cheaply: reads a folder, and looks closer only when a file in it is new.
#[derive(Debug, Default)]
pub struct ChannelWatch {
    /// Service files by name and inode: a channel that was removed and made again has another inode.
    files: HashSet<(std::ffi::OsString, u64)>,
    known: HashSet<(String, String)>,
}

impl ChannelWatch {
    /// Nothing known yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Channels that have appeared since the last call (all of them at first); one that was made again, perhaps with another type, appears again.
    ///
    /// # Errors
    /// As [`Bus::channels`].
    pub fn new_channels(&mut self, bus: &Bus) -> Result<Vec<ChannelInfo>, BusError> {
        let files: HashSet<_> = fs::read_dir(bus.domain().root().join("services"))
            .into_iter()
            .flatten()
            .flatten()
            .filter_map(|entry| {
                entry
                    .metadata()
                    .ok()
                    .filter(|found| found.mode() & 0o200 == 0)
                    .map(|found| (entry.file_name(), found.ino()))
            })
            .collect(); // half-made ones are writable: they count when they are finished
        if files == self.files {
            return Ok(Vec::new());
        }
        let channels = bus.channels()?;
        let new = channels
            .iter()
            .filter(|channel| !self.known.contains(&(channel.name.clone(), channel.type_name.clone())))
            .cloned()
            .collect();
        self.known = channels.into_iter().map(|channel| (channel.name, channel.type_name)).collect();
        self.files = files;
        Ok(new)
    }
}

fn describe(domain: &Domain, details: &ServiceDetails<ipc::Service>) -> Option<ChannelInfo> {
    let statics = &details.static_details;
    let Pattern::PublishSubscribe(settings) = statics.messaging_pattern() else { return None };
    let payload = &settings.message_type_details().payload;
    let (schema, schema_hash) = definition::read(domain, statics.attributes());
    let alive = |state: &NodeState<ipc::Service>| match state {
        NodeState::Alive(node) => Some(info_of(node)),
        _ => None,
    };
    Some(ChannelInfo {
        name: statics.name().to_string(),
        type_name: payload.type_name().to_string(),
        schema,
        schema_hash,
        size: payload.size(),
        buffer: settings.subscriber_max_buffer_size(),
        history: settings.history_size(),
        holders: details.dynamic_details.iter().flat_map(|dynamic| &dynamic.nodes).filter_map(alive).collect(),
    })
}
