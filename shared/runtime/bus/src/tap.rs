//! Lists channels, and subscribes to channels of any type as bytes.

use std::collections::HashMap;
use std::ffi::{CString, OsStr};
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use iceoryx2::port::ReceiveError;
use iceoryx2::prelude::{
    CallbackProgression, MessagingPattern, NodeState, PortFactory as _, Service, ServiceDetails, ServiceName, ipc,
};
use iceoryx2::service::marker::{CustomHeaderMarker, CustomPayloadMarker};
use iceoryx2::service::static_config::message_type_details::TypeVariant;
use iceoryx2::service::static_config::messaging_pattern::MessagingPattern as Pattern;
use messages::Header;
use messages::schema::Schema;
use rustix::fs::{Mode, OFlags, RawDir, open};

use crate::blob::BLOB_HEADER;
use crate::domain::info_of;
use crate::losses::Losses;
use crate::node::service_name;
use crate::places::collect_listed;
use crate::{Bus, BusError, Domain, NodeInfo, definition};

/// Properties of a channel in shared memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelInfo {
    /// Name, e.g. `motor/state`.
    pub name: String,
    /// Type name, e.g. `nims_msgs/MotorState/1a2b3c4d`.
    pub type_name: String,
    /// The schema text stored with the channel; `None` if it is missing or incomplete.
    pub schema: Option<String>,
    /// The stored hash of the schema text.
    pub schema_hash: Option<String>,
    /// Size of a sample, bytes; of blobs the largest size.
    pub size: usize,
    /// Whether the samples have different lengths, and their header beside them.
    pub is_blob: bool,
    /// Buffer of a deep subscriber, samples.
    pub buffer: usize,
    /// Number of samples stored for late subscribers.
    pub history: usize,
    /// The processes that have it open, as publisher or subscriber.
    pub holders: Vec<NodeInfo>,
}

/// One sample, as bytes.
#[derive(Debug, Clone, Copy)]
pub struct Raw<'a> {
    /// The whole sample, with its header unless it is a blob; a little-endian CDR body.
    pub bytes: &'a [u8],
    /// The header, if the sample has one ([`Tap::has_header`]); otherwise zeros.
    pub header: Header,
    /// Id of the publisher, unique even within a process.
    pub publisher: u128,
    /// Number of missing samples of this publisher before this one; 0 if the type has no header with sequence numbers.
    pub missing: u64,
}

type RawService = iceoryx2::service::port_factory::publish_subscribe::PortFactory<
    ipc::Service,
    [CustomPayloadMarker],
    CustomHeaderMarker,
>;
type RawPort = iceoryx2::port::subscriber::Subscriber<ipc::Service, [CustomPayloadMarker], CustomHeaderMarker>;

/// A subscriber for a channel of any type.
#[derive(Debug)]
pub struct Tap {
    port: RawPort,
    info: ChannelInfo,
    has_header: bool,
    losses: Losses,
    received: u64,
}

impl Bus {
    /// Lists the channels of the domain by name. Takes about 0.2 ms per channel, so do not use it in a control loop.
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

    /// Returns the properties of a channel, if it exists.
    ///
    /// # Errors
    /// [`BusError::ChannelName`], or [`BusError::Failed`] if it cannot be read.
    pub fn channel(&self, name: &str) -> Result<Option<ChannelInfo>, BusError> {
        let details =
            ipc::Service::details(&service_name(name)?, self.domain().config(), MessagingPattern::PublishSubscribe)
                .map_err(|error| BusError::failed(name, "be looked up", &error))?;
        Ok(details.and_then(|details| describe(self.domain(), &details)))
    }

    /// Returns the number of publishers and subscribers of a channel, including those of dead processes not yet
    /// removed.
    ///
    /// # Errors
    /// As [`Bus::tap`].
    pub fn ports(&self, name: &str) -> Result<(usize, usize), BusError> {
        let (service, _) = self.open_raw(name)?;
        let dynamic = service.dynamic_config();
        Ok((dynamic.number_of_publishers(), dynamic.number_of_subscribers()))
    }

    /// Returns the publishers of a channel: the id in their samples ([`Raw::publisher`]) and the process id.
    ///
    /// # Errors
    /// As [`Bus::tap`].
    pub fn publishers(&self, name: &str) -> Result<Vec<(u128, u32)>, BusError> {
        Ok(publishers_of(&self.open_raw(name)?.0))
    }

    /// Returns [`Bus::publishers`] of a channel, and the process id of each subscriber. Opens the channel once, which
    /// takes most of the time.
    ///
    /// # Errors
    /// As [`Bus::tap`].
    #[allow(clippy::type_complexity)]
    pub fn ends(&self, name: &str) -> Result<(Vec<(u128, u32)>, Vec<u32>), BusError> {
        let (service, _) = self.open_raw(name)?;
        Ok((publishers_of(&service), subscribers_of(&service)))
    }

    /// Subscribes to an existing channel of any type, with a buffer of [`messages::Quality::shallow`] samples and the
    /// history for late subscribers.
    ///
    /// # Errors
    /// [`BusError::NoChannel`] if it does not exist, [`BusError::Full`] if all its subscribers are taken, and others.
    pub fn tap(&self, name: &str) -> Result<Tap, BusError> {
        let quality = messages::quality_of(name);
        self.tap_with(name, quality.shallow(), quality.late)
    }

    /// As [`Bus::tap`], with the channel's whole buffer and whole history, for processes that need every sample, also
    /// those published before they subscribed. A channel has [`messages::Quality::DEEP_PLACES`] of these.
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
        let has_header = info.is_blob || layout.is_some_and(|layout| layout.has_header());
        Ok(Tap { port, info, has_header, losses: Losses::default(), received: 0 })
    }

    fn open_raw(&self, name: &str) -> Result<(RawService, ChannelInfo), BusError> {
        let absent = || BusError::NoChannel { channel: name.to_owned(), domain: self.domain().name().to_owned() };
        let service: ServiceName = service_name(name)?;
        let details = ipc::Service::details(&service, self.domain().config(), MessagingPattern::PublishSubscribe)
            .map_err(|error| BusError::failed(name, "be looked up", &error))?
            .ok_or_else(absent)?;
        let info = describe(self.domain(), &details).ok_or_else(absent)?;
        let types = details.static_details.publish_subscribe().message_type_details();
        // SAFETY: the type details are those of the channel itself, and `Tap` only reads the bytes of a sample, by its
        // length.
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

fn publishers_of(service: &RawService) -> Vec<(u128, u32)> {
    collect_listed(|note| {
        service.dynamic_config().list_publishers(|port| {
            if let Ok(pid) = port.node_id.pid::<ipc::Service>() {
                note((port.publisher_id.value(), pid.value().unsigned_abs()));
            }
            CallbackProgression::Continue
        });
    })
}

fn subscribers_of(service: &RawService) -> Vec<u32> {
    collect_listed(|note| {
        service.dynamic_config().list_subscribers(|port| {
            if let Ok(pid) = port.node_id.pid::<ipc::Service>() {
                note(pid.value().unsigned_abs());
            }
            CallbackProgression::Continue
        });
    })
}

impl Tap {
    /// Calls `read` with the oldest sample not yet received and returns its result; `None` if there is no sample.
    ///
    /// # Errors
    /// [`BusError::Failed`] only if shared memory is damaged.
    pub fn receive<R>(&mut self, read: impl FnOnce(Raw<'_>) -> R) -> Result<Option<R>, BusError> {
        let sample = match self.port.receive() {
            // Retry as in `Subscriber::receive`.
            Err(ReceiveError::ConnectionFailure(_)) => self.port.receive(),
            other => other,
        }
        .map_err(|error| BusError::failed(&self.info.name, "receive", &error))?;
        let Some(sample) = sample else { return Ok(None) };
        let payload = sample.payload();
        // SAFETY: `CustomPayloadMarker` is one byte wide (`repr(C)` over a u8), so the length of the slice is in bytes,
        // and a channel carries plain data only.
        #[allow(unsafe_code)]
        let bytes: &[u8] = unsafe { std::slice::from_raw_parts(payload.as_ptr().cast(), payload.len()) };
        let header = if self.info.is_blob {
            // SAFETY: the channel has the user header `BlobHeader`, by its name and size, which is a `Header`.
            #[allow(unsafe_code)]
            unsafe {
                std::ptr::from_ref(sample.user_header()).cast::<Header>().read_unaligned()
            }
        } else {
            let header = bytes.get(..size_of::<Header>()).filter(|_| self.has_header);
            header.map_or_else(Header::default, bytemuck::pod_read_unaligned)
        };
        let publisher = sample.header().publisher_id().value();
        let missing = if self.has_header { self.losses.record(publisher, header.seq) } else { 0 };
        self.received += 1;
        Ok(Some(read(Raw { bytes, header, publisher, missing })))
    }

    /// Returns the properties of the channel.
    #[must_use]
    pub fn info(&self) -> &ChannelInfo {
        &self.info
    }

    /// Returns whether the samples have a [`Header`], by the schema of the channel; only then can losses be counted.
    #[must_use]
    pub fn has_header(&self) -> bool {
        self.has_header
    }

    /// Returns the number of samples that were published and never arrived here, if they are numbered.
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
}

/// Finds new channels at low cost: lists a folder, and reads only the channels whose files in it are new.
#[derive(Debug, Default)]
pub struct ChannelWatch {
    /// Service files by inode. A channel that was removed and created again has another one.
    known: HashMap<u64, ServiceEntry>,
    /// Number of this search.
    search: u64,
}

/// A service file that was seen before.
#[derive(Debug)]
struct ServiceEntry {
    file: CString,
    /// Name and type of the channel; `None` for services of other kinds.
    channel: Option<(String, String)>,
    /// Number of the last search that has found it.
    search: u64,
}

/// Bytes of a listing that are read at once.
const LISTING_BYTES: usize = 32 << 10;

/// The service in a file of iceoryx2.
enum ServiceFile {
    Channel(String),
    /// An event or requests.
    Other,
    /// The file is gone or of another format.
    Unreadable,
}

impl ChannelWatch {
    /// Creates a watch that knows no channel.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns the channels created since the last call; all of them at the first call. A channel that was created
    /// again with another type is returned again.
    ///
    /// # Errors
    /// As [`Bus::channels`].
    pub fn new_channels(&mut self, bus: &Bus) -> Result<Vec<ChannelInfo>, BusError> {
        let folder = bus.domain().root().join("services");
        self.search += 1;
        let mut new = Vec::new();
        for (inode, file) in self.unknown_files(&folder) {
            let path = folder.join(OsStr::from_bytes(file.to_bytes()));
            // Incomplete files are writable and are skipped until they are complete.
            if !fs::metadata(&path).is_ok_and(|found| found.mode() & 0o200 == 0) {
                continue;
            }
            let channel = match service_in(&path) {
                ServiceFile::Channel(name) => {
                    // It may be removed before it is read.
                    let Some(info) = bus.channel(&name)? else { continue };
                    let channel = Some((info.name.clone(), info.type_name.clone()));
                    if !self.known.values().any(|known| known.channel == channel) {
                        new.push(info);
                    }
                    channel
                }
                ServiceFile::Other => None,
                ServiceFile::Unreadable => continue,
            };
            self.known.insert(inode, ServiceEntry { file, channel, search: self.search });
        }
        self.known.retain(|_, known| known.search == self.search);
        new.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(new)
    }

    /// Lists the folder; returns the files that are not known yet, by inode, and marks the others as found.
    fn unknown_files(&mut self, folder: &Path) -> Vec<(u64, CString)> {
        let mut unknown = Vec::new();
        let Ok(listed) = open(folder, OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC, Mode::empty()) else {
            return unknown;
        };
        // Without an allocation per entry, because there are thousands in a large robot.
        let mut buffer = Vec::with_capacity(LISTING_BYTES);
        let mut entries = RawDir::new(listed, buffer.spare_capacity_mut());
        while let Some(Ok(entry)) = entries.next() {
            match self.known.get_mut(&entry.ino()) {
                Some(known) if known.file.as_c_str() == entry.file_name() => known.search = self.search,
                _ if entry.file_name().to_bytes().starts_with(b".") => {}
                _ => unknown.push((entry.ino(), entry.file_name().to_owned())),
            }
        }
        unknown
    }
}

/// Reads the name of a service and whether it is a channel from its file, a TOML table of iceoryx2.
fn service_in(file: &Path) -> ServiceFile {
    let Ok(text) = fs::read_to_string(file) else { return ServiceFile::Unreadable };
    let name = text.lines().find_map(|line| line.strip_prefix("service_name = \"")?.strip_suffix('"'));
    match name {
        Some(name) if text.contains("\n[messaging_pattern.PublishSubscribe]\n") => {
            ServiceFile::Channel(name.to_owned())
        }
        Some(_) => ServiceFile::Other,
        None => ServiceFile::Unreadable,
    }
}

fn describe(domain: &Domain, details: &ServiceDetails<ipc::Service>) -> Option<ChannelInfo> {
    let statics = &details.static_details;
    let Pattern::PublishSubscribe(settings) = statics.messaging_pattern() else { return None };
    let types = settings.message_type_details();
    let payload = &types.payload;
    let header_name = types.user_header.type_name().to_string();
    let is_blob = payload.variant() == TypeVariant::Dynamic
        && payload.size() == 1
        && header_name == BLOB_HEADER
        && types.user_header.size() == size_of::<Header>();
    let type_name = payload.type_name().to_string();
    let (schema, schema_hash) = definition::read(domain, &type_name, statics.attributes());
    let alive = |state: &NodeState<ipc::Service>| match state {
        NodeState::Alive(node) => Some(info_of(node)),
        _ => None,
    };
    Some(ChannelInfo {
        name: statics.name().to_string(),
        type_name,
        schema,
        schema_hash,
        size: if is_blob { definition::limit(statics.attributes()) } else { payload.size() },
        is_blob,
        buffer: settings.subscriber_max_buffer_size(),
        history: settings.history_size(),
        holders: details.dynamic_details.iter().flat_map(|dynamic| &dynamic.nodes).filter_map(alive).collect(),
    })
}
