//! A run file that grows.

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

/// What stands before a sample wherever it is read as CDR: plain, little endian, no options.
pub const CDR_HEADER: [u8; 4] = [0, 1, 0, 0];
/// Name of the metadata record with the clock of the run.
pub(crate) const RUN: &str = "run";
/// Name of the metadata record that a finished file ends with.
pub(crate) const RUN_END: &str = "run_end";
/// The attachments that repeat the definitions of channels are named `channels-1.json`, ...
pub(crate) const CHANNELS_BEGINNING: &str = "channels-";
/// Smaller chunks cost a quarter more processor time on small samples, larger ones gain nothing.
const CHUNK_BYTES: u64 = 1 << 20;
/// Of a message beside its data: opcode, length, channel, number, two times.
const MESSAGE_BYTES: usize = 1 + 8 + 2 + 4 + 8 + 8;
/// What a chunk begins with.
const CHUNK: u8 = mcap::records::op::CHUNK;
/// The records between chunks are small and many.
const BUFFER_BYTES: usize = 64 * 1024;

/// A file that belongs to the run and is kept inside it: its configuration, a calibration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Attachment {
    /// e.g. `box.toml`.
    pub name: String,
    /// e.g. `application/toml`.
    pub media_type: String,
    /// Its bytes.
    pub data: Vec<u8>,
}

/// A channel of one writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChannelId(usize);

/// What is needed to read a channel's samples if the chunk that defines it is damaged.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Repeated {
    pub id: u16,
    pub schema_id: u16,
    pub topic: String,
    pub schema_name: String,
    pub schema: String,
    pub metadata: BTreeMap<String, String>,
}

struct Row {
    name: String,
    size: usize,
    repeated: Repeated,
}

/// Writes one run file; see the crate's documentation for what it guarantees.
///
/// Not for the control path: a call can wait for the disk.
pub struct RunWriter {
    writer: Writer<Counted>,
    written: Arc<AtomicU64>,
    syncer: Syncer,
    part: PathBuf,
    path: PathBuf,
    /// Device and number of the file, by which it is known.
    identity: (u64, u64),
    clock: RunClock,
    definitions: Definitions,
    channels: Vec<Row>,
    repeated: usize,
    repeats: usize,
    scratch: Vec<u8>,
    /// Bytes of the samples in the open chunk.
    open: u64,
    settled: u64,
    /// Where the open chunk will begin in the file.
    settled_bytes: u64,
}

impl RunWriter {
    /// Opens `path` with `.part` behind it, locks it and writes the clock, `about` (who, what, with which versions) and the attachments.
    ///
    /// # Errors
    /// The file exists already, or cannot be written.
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
        let made = Self::begin(path, file, clock, about, attachments);
        if made.is_err() {
            // a full disk: no use for a file that has not even a beginning
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
        let theirs = file.try_clone().map_err(RunError::io(&part, "open the run file twice"))?;
        let meta = file.metadata().map_err(RunError::io(&part, "look at the run file"))?;
        let identity = (meta.dev(), meta.ino());
        let syncer = Syncer::start(theirs).map_err(RunError::io(&part, "start the thread that synchronises"))?;
        let written = Arc::new(AtomicU64::new(0));
        // chunks are closed here, so that it is known what is in a closed one
        let mut writer = options()
            .chunk_size(None)
            .create(Counted { inner: BufWriter::with_capacity(BUFFER_BYTES, file), written: Arc::clone(&written) })
            .map_err(RunError::write(&part))?;

        let mut fields = about.clone();
        fields.insert("t0_unix_ns".into(), clock.t0_unix_ns.to_string());
        fields.insert("t0_mono_ns".into(), clock.t0_mono_ns.to_string());
        fields.insert(BOOT_ID.into(), boot_id());
        writer.write_metadata(&Metadata { name: RUN.into(), metadata: fields }).map_err(RunError::write(&part))?;
        if let Some(name) = about.get("box") {
            // by this, Foxglove's own tools tell whose file it is
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

    /// Adds a channel. A definition that some reader could not read is replaced by plain bytes; [`RunWriter::refusal`] says why.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn add_channel(&mut self, spec: &ChannelSpec) -> Result<ChannelId, RunError> {
        let definition = self.definitions.of(spec);
        let topic = format!("/{}", spec.name);
        let failed = RunError::write(&self.part);
        let schema_id = self.writer.add_schema(&definition.schema_name, "ros2msg", definition.text.as_bytes());
        let ids = schema_id
            .and_then(|schema| Ok((schema, self.writer.add_channel(schema, &topic, "cdr", &definition.metadata)?)));
        let (schema_id, id) = ids.map_err(failed)?;
        let repeated = Repeated {
            id,
            schema_id,
            topic,
            schema_name: definition.schema_name,
            schema: definition.text,
            metadata: definition.metadata,
        };
        self.channels.push(Row { name: spec.name.clone(), size: spec.size, repeated });
        Ok(ChannelId(self.channels.len() - 1))
    }

    /// Why a channel is recorded as plain bytes, if it is.
    #[must_use]
    pub fn refusal(&self, channel: ChannelId) -> Option<&str> {
        self.channels.get(channel.0)?.repeated.metadata.get("refused").map(String::as_str)
    }

    /// Writes a sample. `logged_ns` is when it was published, `stamp_ns` when its content was true, both CLOCK_MONOTONIC.
    ///
    /// # Errors
    /// The sample has not the channel's size (nothing is written then), or the file cannot be written: see [`RunWriter::give_up`].
    pub fn write(
        &mut self,
        channel: ChannelId,
        seq: u64,
        logged_ns: u64,
        stamp_ns: u64,
        sample: &[u8],
    ) -> Result<(), RunError> {
        let Some(row) = self.channels.get(channel.0).filter(|row| row.size == sample.len()) else {
            let row = self.channels.get(channel.0);
            return Err(RunError::Size {
                channel: row.map_or_else(String::new, |row| row.name.clone()),
                got: sample.len(),
                expected: row.map_or(0, |row| row.size),
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
        self.open += (MESSAGE_BYTES + self.scratch.len()) as u64;
        if self.open > CHUNK_BYTES { self.close_chunk() } else { Ok(()) }
    }

    fn close_chunk(&mut self) -> Result<(), RunError> {
        self.writer.flush().map_err(RunError::write(&self.part))?;
        self.open = 0;
        self.settled += 1;
        self.settled_bytes = self.bytes();
        Ok(())
    }

    /// Grows whenever all that has been written so far stands in the file as a whole chunk, so that no later error can take it away.
    #[must_use]
    pub fn settled(&self) -> u64 {
        self.settled
    }

    /// Leaves the file as it is after an error; it can be recovered. True if all that was written since it last [settled](RunWriter::settled),
    /// up to and with the sample whose writing failed, is in it nevertheless: a disk can fill up just behind the chunk.
    pub fn give_up(self) -> bool {
        let Self { writer, part, settled_bytes, .. } = self;
        // what still waits in memory must not come into the file once that has been looked at
        drop(writer.into_inner().inner.into_parts());
        has_chunk(&part, settled_bytes).is_ok_and(|whole| whole)
    }

    /// Closes the open chunk, so that all written so far survives the death of this process, and asks the disk to keep it.
    ///
    /// Call it twice a second. It does not wait for the disk.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn flush(&mut self) -> Result<(), RunError> {
        if self.repeated < self.channels.len() {
            self.repeats += 1;
            let all: Vec<&Repeated> = self.channels.iter().map(|row| &row.repeated).collect();
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

    /// Keeps a file inside this one. It closes the open chunk: not for every second.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn attach(&mut self, attachment: &Attachment) -> Result<(), RunError> {
        self.close_chunk()?;
        attach(&mut self.writer, attachment, self.clock.t0_unix_ns).map_err(RunError::write(&self.part))
    }

    /// Gives the file up and removes it.
    pub fn abandon(self) {
        let _ = fs::remove_file(&self.part);
    }

    /// Bytes in the file so far, without the open chunk.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }

    /// Whether the file still stands where it was made. One that was removed takes everything that is written to it, and keeps nothing.
    ///
    /// # Errors
    /// It cannot be seen, which says nothing about the file.
    pub fn is_there(&self) -> io::Result<bool> {
        match fs::metadata(&self.part) {
            Ok(meta) => Ok((meta.dev(), meta.ino()) == self.identity),
            // The second: something that is no folder stands on the way.
            Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// The name the file will have when it is finished.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What synchronising has cost so far.
    #[must_use]
    pub fn sync_report(&self) -> SyncReport {
        self.syncer.report()
    }

    /// Writes `summary` (why it ended, what was lost) and the index, brings everything onto the disk and gives the file its final name.
    ///
    /// # Errors
    /// The file cannot be written; then it keeps `.part` in its name and can be recovered.
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
        fs::rename(&part, &path).map_err(RunError::io(&path, "give the run file its final name"))?;
        sync_folder(&path)?;
        Ok(path)
    }
}

/// Whether the file has the whole of the chunk that begins there.
fn has_chunk(part: &Path, begin: u64) -> io::Result<bool> {
    let mut file = File::open(part)?;
    file.seek(SeekFrom::Start(begin))?;
    let mut head = [0_u8; 9];
    file.read_exact(&mut head)?;
    let [opcode, length @ ..] = head;
    let end = begin.saturating_add(head.len() as u64).saturating_add(u64::from_le_bytes(length));
    Ok(opcode == CHUNK && file.metadata()?.len() >= end)
}

/// How every run file is written.
pub(crate) fn options() -> WriteOptions {
    WriteOptions::new()
        .profile("ros2")
        .compression(Some(Compression::Zstd))
        // level 1 is both faster and smaller than the default on this kind of data
        .compression_level(1)
        .compression_threads(0)
        .chunk_size(Some(CHUNK_BYTES))
        // a chunk goes to the file whole: a kill leaves the file at a chunk boundary
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

/// A file that knows how much has been written to it.
pub(crate) struct Counted {
    pub inner: BufWriter<File>,
    pub written: Arc<AtomicU64>,
}

impl Write for Counted {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.inner.write(bytes)?;
        self.written.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

impl Seek for Counted {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.inner.seek(to)
    }

    fn stream_position(&mut self) -> io::Result<u64> {
        self.inner.stream_position()
    }
}
