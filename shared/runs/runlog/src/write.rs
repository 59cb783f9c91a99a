//! Writes run files.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, WriteOptions, Writer};
use rustix::fs::{FlockOperation, flock};
use serde::{Deserialize, Serialize};

use crate::clock::{BOOT_ID, boot_id};
use crate::definition::{ChannelSpec, Definitions};
use crate::folder::{part_of, sync_folder};
use crate::sync::{SyncReport, Syncer};
use crate::{RunClock, RunError};

/// Encapsulation header of CDR: plain, little endian, no options.
pub const CDR_HEADER: [u8; 4] = [0, 1, 0, 0];
/// Name of the metadata record with the clock of the run.
pub(crate) const RUN: &str = "run";
/// Name of the metadata record at the end of a finished file.
pub(crate) const RUN_END: &str = "run_end";
/// Name prefix of the attachments that repeat the channel definitions: `channels-1.json`, ...
pub(crate) const CHANNELS_BEGINNING: &str = "channels-";
/// Smaller chunks cost a quarter more processor time on small samples; larger ones gain nothing.
const CHUNK_BYTES: u64 = 1 << 20;
/// Overhead of a message record: opcode, length, channel, sequence number, two times.
const MESSAGE_BYTES: usize = 1 + 8 + 2 + 4 + 8 + 8;
/// Opcode at the start of a chunk.
const CHUNK: u8 = mcap::records::op::CHUNK;
/// Buffered because the records between chunks are small and many.
const BUFFER_BYTES: usize = 64 * 1024;

/// A file attached to the run file: a configuration, a calibration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Attachment {
    /// e.g. `system.toml`.
    pub name: String,
    /// e.g. `application/toml`.
    pub media_type: String,
    /// Content of the file.
    pub data: Vec<u8>,
}

/// A channel of one writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChannelId(usize);

/// A channel's definition, repeated in an attachment in case the chunk with the original is damaged.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct ChannelDefinition {
    pub id: u16,
    pub schema_id: u16,
    pub topic: String,
    pub schema_name: String,
    pub schema: String,
    pub metadata: BTreeMap<String, String>,
}

struct ChannelState {
    spec: ChannelSpec,
    repeated: ChannelDefinition,
}

/// Writes one run file; see the crate's documentation for its guarantees.
///
/// Not for the control path: a call can wait for the disk.
pub struct RunWriter {
    writer: Writer<CountingWriter>,
    written: Arc<AtomicU64>,
    syncer: Syncer,
    part: PathBuf,
    path: PathBuf,
    /// Device and inode number, which identify the file.
    identity: (u64, u64),
    clock: RunClock,
    definitions: Definitions,
    channels: Vec<ChannelState>,
    repeated: usize,
    repeats: usize,
    scratch: Vec<u8>,
    /// Bytes of the samples in the open chunk.
    open: u64,
    settled: u64,
    /// File offset at which the open chunk will begin.
    settled_bytes: u64,
}

impl RunWriter {
    /// Creates `path` with `.part` appended, locks it and writes the clock, `about` (origin, content, versions) and the
    /// attachments.
    ///
    /// # Errors
    /// The file already exists, finished or not, or cannot be written.
    pub fn create(
        path: &Path,
        clock: RunClock,
        about: &BTreeMap<String, String>,
        attachments: &[Attachment],
    ) -> Result<Self, RunError> {
        let part = part_of(path);
        let file = OpenOptions::new()
            .write(true)
            .create_new(true)
            .open(&part)
            .map_err(RunError::io(&part, "create the run file"))?;
        // Tested after the creation: a file that another thread finishes meanwhile always has one of the two names.
        let made = match path.try_exists() {
            Ok(false) => Self::begin(path, file, clock, about, attachments),
            Ok(true) => Err(RunError::io(path, "create the run file")(io::ErrorKind::AlreadyExists.into())),
            Err(error) => Err(RunError::io(path, "look for the run file")(error)),
        };
        if made.is_err() {
            // a full disk, or a finished file of this name: a file without a complete beginning is useless
            let _ = fs::remove_file(&part);
        }
        made
    }

    fn begin(
        path: &Path,
        file: File,
        clock: RunClock,
        about: &BTreeMap<String, String>,
        attachments: &[Attachment],
    ) -> Result<Self, RunError> {
        let part = part_of(path);
        flock(&file, FlockOperation::NonBlockingLockExclusive)
            .map_err(|error| RunError::io(&part, "lock the run file")(error.into()))?;
        let sync_file = file.try_clone().map_err(RunError::io(&part, "duplicate the run file's descriptor"))?;
        let meta = file.metadata().map_err(RunError::io(&part, "read the metadata of the run file"))?;
        let identity = (meta.dev(), meta.ino());
        let syncer = Syncer::start(sync_file).map_err(RunError::io(&part, "start the synchronising thread"))?;
        let written = Arc::new(AtomicU64::new(0));
        // chunks are closed explicitly, so that the content of each closed chunk is known
        let mut writer = options()
            .chunk_size(None)
            .create(CountingWriter {
                inner: BufWriter::with_capacity(BUFFER_BYTES, file),
                written: Arc::clone(&written),
            })
            .map_err(RunError::write(&part))?;

        let mut fields = about.clone();
        fields.insert("t0_unix_ns".into(), clock.t0_unix_ns.to_string());
        fields.insert("t0_mono_ns".into(), clock.t0_mono_ns.to_string());
        fields.insert(BOOT_ID.into(), boot_id());
        writer.write_metadata(&Metadata { name: RUN.into(), metadata: fields }).map_err(RunError::write(&part))?;
        if let Some(name) = about.get("system") {
            // Foxglove's own tools show this as the name of the device
            let metadata = BTreeMap::from([("deviceName".to_owned(), name.clone())]);
            let device = Metadata { name: "foxglove".into(), metadata };
            writer.write_metadata(&device).map_err(RunError::write(&part))?;
        }
        for attachment in attachments {
            attach(&mut writer, attachment, clock.t0_unix_ns).map_err(RunError::write(&part))?;
        }
        let mut this = Self {
            writer,
            written,
            syncer,
            part,
            path: path.to_owned(),
            identity,
            clock,
            definitions: Definitions::default(),
            channels: Vec::new(),
            repeated: 0,
            repeats: 0,
            scratch: Vec::new(),
            open: 0,
            settled: 0,
            settled_bytes: 0,
        };
        this.flush()?;
        sync_folder(&this.part)?;
        Ok(this)
    }

    /// Adds a channel. A definition that some reader could not decode is replaced by plain bytes;
    /// [`RunWriter::refusal`] gives the reason.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn add_channel(&mut self, spec: &ChannelSpec) -> Result<ChannelId, RunError> {
        let definition = self.definitions.definition_of(spec);
        let topic = format!("/{}", spec.name);
        let failed = RunError::write(&self.part);
        let schema_id = self.writer.add_schema(&definition.schema_name, "ros2msg", definition.text.as_bytes());
        let ids = schema_id
            .and_then(|schema| Ok((schema, self.writer.add_channel(schema, &topic, "cdr", &definition.metadata)?)));
        let (schema_id, id) = ids.map_err(failed)?;
        let repeated = ChannelDefinition {
            id,
            schema_id,
            topic,
            schema_name: definition.schema_name,
            schema: definition.text,
            metadata: definition.metadata,
        };
        self.channels.push(ChannelState { spec: spec.clone(), repeated });
        Ok(ChannelId(self.channels.len() - 1))
    }

    /// Why a channel is recorded as plain bytes; `None` if it is not.
    #[must_use]
    pub fn refusal(&self, channel: ChannelId) -> Option<&str> {
        self.channels.get(channel.0)?.repeated.metadata.get("refused").map(String::as_str)
    }

    /// Writes a sample. `logged_ns` is its publication time, `stamp_ns` the time at which its content was valid, both
    /// CLOCK_MONOTONIC.
    ///
    /// # Errors
    /// The sample does not have the channel's size (nothing is written then), or the file cannot be written: see
    /// [`RunWriter::give_up`].
    pub fn write(
        &mut self,
        channel: ChannelId,
        seq: u64,
        logged_ns: u64,
        stamp_ns: u64,
        sample: &[u8],
    ) -> Result<(), RunError> {
        let Some(row) = self.channels.get(channel.0).filter(|row| row.spec.accepts(sample.len())) else {
            let row = self.channels.get(channel.0);
            return Err(RunError::Size {
                channel: row.map_or_else(String::new, |row| row.spec.name.clone()),
                got: sample.len(),
                expected: row.map_or(0, |row| row.spec.size),
            });
        };
        let header = MessageHeader {
            channel_id: row.repeated.id,
            sequence: seq as u32,
            log_time: self.clock.unix_of(logged_ns),
            publish_time: self.clock.unix_of(stamp_ns),
        };
        self.scratch.clear();
        self.scratch.extend_from_slice(&CDR_HEADER);
        self.scratch.extend_from_slice(sample);
        self.writer.write_to_known_channel(&header, &self.scratch).map_err(RunError::write(&self.part))?;
        debug_assert!(self.open <= CHUNK_BYTES, "a chunk with {} bytes was not closed", self.open);
        self.open += (MESSAGE_BYTES + self.scratch.len()) as u64;
        if self.open > CHUNK_BYTES { self.close_chunk() } else { Ok(()) }
    }

    fn close_chunk(&mut self) -> Result<(), RunError> {
        self.writer.flush().map_err(RunError::write(&self.part))?;
        self.open = 0;
        self.settled += 1;
        let bytes = self.bytes();
        debug_assert!(bytes >= self.settled_bytes, "the file offset went back from {} to {bytes}", self.settled_bytes);
        self.settled_bytes = bytes;
        Ok(())
    }

    /// Increases when all samples written so far are in the file as complete chunks, so that no later error can lose
    /// them.
    #[must_use]
    pub fn settled(&self) -> u64 {
        self.settled
    }

    /// Leaves the file as it is after an error; it can be recovered. Returns true if the file nevertheless contains
    /// everything written since it last [settled](RunWriter::settled), including the sample whose write failed: a disk
    /// can fill up just after the chunk.
    pub fn give_up(self) -> bool {
        let Self { writer, part, settled_bytes, .. } = self;
        // buffered data must not reach the file after the check below
        drop(writer.into_inner().inner.into_parts());
        has_chunk(&part, settled_bytes).is_ok_and(|whole| whole)
    }

    /// Closes the open chunk, so that everything written so far survives the death of this process, and requests
    /// synchronisation to the disk.
    ///
    /// Call it twice a second. It does not wait for the disk.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn flush(&mut self) -> Result<(), RunError> {
        debug_assert!(self.repeated <= self.channels.len(), "more channels are repeated than defined");
        if self.repeated < self.channels.len() {
            self.repeats += 1;
            let all: Vec<&ChannelDefinition> = self.channels.iter().map(|row| &row.repeated).collect();
            let attachment = Attachment {
                name: format!("{CHANNELS_BEGINNING}{}.json", self.repeats),
                media_type: "application/json".into(),
                data: serde_json::to_vec(&all).unwrap_or_default(),
            };
            attach(&mut self.writer, &attachment, self.clock.t0_unix_ns).map_err(RunError::write(&self.part))?;
            self.repeated = self.channels.len();
        }
        self.close_chunk()?;
        self.syncer.ask(self.bytes());
        Ok(())
    }

    /// Attaches a file. This closes the open chunk, so call it rarely, not every second.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn attach(&mut self, attachment: &Attachment) -> Result<(), RunError> {
        self.close_chunk()?;
        attach(&mut self.writer, attachment, self.clock.t0_unix_ns).map_err(RunError::write(&self.part))
    }

    /// Discards and removes the file.
    pub fn abandon(self) {
        let _ = fs::remove_file(&self.part);
    }

    /// Bytes in the file so far, without the open chunk.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }

    /// True if the file still exists under its name. A removed file accepts writes, but its content is lost.
    ///
    /// # Errors
    /// The metadata cannot be read, so it is unknown whether the file exists.
    pub fn exists(&self) -> io::Result<bool> {
        match fs::metadata(&self.part) {
            Ok(meta) => Ok((meta.dev(), meta.ino()) == self.identity),
            // NotADirectory: a component of the path is not a folder.
            Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// The name the file will have when it is finished.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Statistics of the synchronisation.
    #[must_use]
    pub fn sync_report(&self) -> SyncReport {
        self.syncer.report()
    }

    /// Writes `summary` (reason of the end, losses) and the index, synchronises the file to the disk and gives it its
    /// final name.
    ///
    /// # Errors
    /// The file cannot be written; it then keeps `.part` in its name and can be recovered.
    pub fn finish(mut self, summary: &BTreeMap<String, String>) -> Result<PathBuf, RunError> {
        self.flush()?;
        let mut metadata = summary.clone();
        let syncs = self.syncer.report();
        metadata.insert("worst_sync_ns".into(), syncs.worst_ns.to_string());
        metadata.insert("failed_syncs".into(), syncs.failed.to_string());
        let end = Metadata { name: RUN_END.into(), metadata };
        let Self { mut writer, part, path, syncer, .. } = self;
        drop(syncer);
        writer.write_metadata(&end).and_then(|()| writer.finish()).map_err(RunError::write(&part))?;
        let mut inner = writer.into_inner().inner;
        inner.flush().map_err(RunError::io(&part, "write the end of the run file"))?;
        inner.get_ref().sync_all().map_err(RunError::io(&part, "synchronise the run file"))?;
        fs::rename(&part, &path).map_err(RunError::io(&path, "rename the finished run file"))?;
        sync_folder(&path)?;
        Ok(path)
    }
}

/// True if the file contains the complete chunk that begins at `begin`.
fn has_chunk(part: &Path, begin: u64) -> io::Result<bool> {
    let mut file = File::open(part)?;
    file.seek(SeekFrom::Start(begin))?;
    let mut head = [0_u8; 9];
    file.read_exact(&mut head)?;
    let [opcode, length @ ..] = head;
    let end = begin.saturating_add(head.len() as u64).saturating_add(u64::from_le_bytes(length));
    Ok(opcode == CHUNK && file.metadata()?.len() >= end)
}

/// Options with which every run file is written.
pub(crate) fn options() -> WriteOptions {
    WriteOptions::new()
        .profile("ros2")
        .compression(Some(Compression::Zstd))
        // level 1 is both faster and smaller than the default on this kind of data
        .compression_level(1)
        .compression_threads(0)
        .chunk_size(Some(CHUNK_BYTES))
        // each chunk is written as a whole: a kill leaves the file at a chunk boundary
        .disable_seeking(true)
        .calculate_data_section_crc(false)
}

pub(crate) fn attach<W: Write + Seek>(
    writer: &mut Writer<W>,
    attachment: &Attachment,
    time: u64,
) -> mcap::McapResult<()> {
    writer.attach(&mcap::Attachment {
        log_time: time,
        create_time: time,
        name: attachment.name.clone(),
        media_type: attachment.media_type.clone(),
        data: attachment.data.as_slice().into(),
    })
}

/// A writer of a new file, which is written from its beginning to its end, that counts the bytes written.
pub(crate) struct CountingWriter {
    pub inner: BufWriter<File>,
    pub written: Arc<AtomicU64>,
}

impl Write for CountingWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.inner.write(bytes)?;
        self.written.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

impl Seek for CountingWriter {
    /// # Errors
    /// Always: the writer of MCAP files is told not to seek, and the count is the position.
    fn seek(&mut self, _to: SeekFrom) -> io::Result<u64> {
        Err(io::Error::from(io::ErrorKind::NotSeekable))
    }

    /// The writer of MCAP files asks for it once for each channel of a chunk. That of a [`BufWriter`] writes its buffer
    /// each time.
    fn stream_position(&mut self) -> io::Result<u64> {
        Ok(self.written.load(Ordering::Relaxed))
    }
}
