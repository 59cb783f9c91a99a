//! Makes a finished run file from an unfinished or damaged one.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::Writer;
use mcap::records::{MessageHeader, Metadata, Record};
use rustix::fs::{FlockOperation, flock};
use serde::Serialize;

use crate::folder::{FILE_ENDING, PART_ENDING, RECOVERED_ENDING, free_bytes, open_file, stem, sync_folder};
use crate::scan::{Item, Scanner};
use crate::write::{Attachment, CHANNELS_BEGINNING, ChannelDefinition, CountingWriter, attach, options};
use crate::{Damage, NotARunReason, RunError};

/// Name of the metadata record with the result of a recovery.
pub(crate) const RECOVERED: &str = "recovered";

/// Result of a recovery.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Recovery {
    /// The source file.
    pub source: PathBuf,
    /// The finished file.
    pub file: PathBuf,
    /// New name of the source if damage was found in it. An undamaged unfinished source is removed.
    pub kept: Option<PathBuf>,
    /// Samples in the finished file.
    pub messages: u64,
    /// Readable samples whose channel definition is lost.
    pub orphaned: u64,
    /// Unreadable places.
    pub damage: Vec<Damage>,
    /// Size of the source file.
    pub source_bytes: u64,
    /// Size of the finished file.
    pub bytes: u64,
}

impl std::fmt::Display for Recovery {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {} samples recovered to {}", self.source.display(), self.messages, self.file.display())?;
        for damage in &self.damage {
            write!(f, "\n  {} bytes at {} skipped: {}", damage.bytes, damage.offset, damage.why)?;
        }
        if self.orphaned > 0 {
            write!(f, "\n  {} samples left out: the file contains no definition of their channels", self.orphaned)?;
        }
        if let Some(kept) = &self.kept {
            write!(f, "\n  the damaged file is kept as {}", kept.display())?;
        }
        Ok(())
    }
}

/// Recovers one file: `NAME.mcap.part` becomes `NAME.mcap`; for a damaged `NAME.mcap`, a readable `NAME-recovered.mcap`
/// is made next to it.
///
/// Damaged chunks are left out; everything else is copied bit for bit. The source stays unchanged until the result is
/// on the disk. `progress` receives the bytes done and the bytes in total.
///
/// # Errors
/// The file is being recorded, is not a run file, or the result cannot be written.
pub fn recover(path: &Path, progress: &mut dyn FnMut(u64, u64)) -> Result<Recovery, RunError> {
    recover_leaving(path, 0, progress)
}

/// As [`recover`], only if `leave_bytes` stay free on the disk meanwhile, for a recorder that writes to it.
///
/// # Errors
/// As [`recover`], or the disk has less room than that.
pub fn recover_leaving(
    path: &Path,
    leave_bytes: u64,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Recovery, RunError> {
    let lock = open_file(path)?;
    if flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err() {
        return Err(RunError::Busy { path: path.to_owned() });
    }
    let unfinished = is_unfinished(path);
    let target = target_of(path)?;
    debug_assert!(target != path, "a recovery would overwrite its source {}", path.display());
    let mut temporary = OsString::from(target.as_os_str());
    temporary.push(".recovering");
    let temporary = PathBuf::from(temporary);

    // An interrupted recovery has left it. The lock of the source keeps others away.
    let _ = fs::remove_file(&temporary);
    check_room(path, leave_bytes)?;
    let copied = copy_whole(path, &temporary, progress).and_then(|copied| {
        fs::rename(&temporary, &target).map_err(RunError::io(&target, "rename the recovered file"))?;
        Ok(copied)
    });
    if copied.is_err() {
        let _ = fs::remove_file(&temporary);
    }
    let copied = copied?;
    sync_folder(&target)?;

    let damaged = copied.orphaned > 0 || copied.damage.iter().any(|damage| !damage.torn_end);
    let kept = match (unfinished, damaged) {
        (false, _) => Some(path.to_owned()),
        (true, false) => {
            fs::remove_file(path).map_err(RunError::io(path, "remove the recovered source"))?;
            None
        }
        (true, true) => {
            let kept = path.with_extension("damaged");
            fs::rename(path, &kept).map_err(RunError::io(&kept, "keep the damaged source"))?;
            Some(kept)
        }
    };
    let bytes = fs::metadata(&target).map_err(RunError::io(&target, "read the recovered file"))?.len();
    Ok(Recovery {
        source: path.to_owned(),
        file: target,
        kept,
        messages: copied.messages,
        orphaned: copied.orphaned,
        damage: copied.damage,
        source_bytes: copied.source_bytes,
        bytes,
    })
}

fn is_unfinished(path: &Path) -> bool {
    path.as_os_str().to_string_lossy().ends_with(PART_ENDING)
}

/// Checks that the disk has room for a copy of the file, and `leave_bytes` more.
fn check_room(path: &Path, leave_bytes: u64) -> Result<(), RunError> {
    let bytes = fs::metadata(path).map_err(RunError::io(path, "read the run file"))?.len();
    let (needed_bytes, free_bytes) = (bytes.saturating_add(leave_bytes), free_bytes(path)?);
    if free_bytes < needed_bytes {
        return Err(RunError::NoRoom { path: path.to_owned(), free_bytes, needed_bytes });
    }
    Ok(())
}

fn target_of(path: &Path) -> Result<PathBuf, RunError> {
    let stem = path.file_name().and_then(stem);
    let Some(stem) = stem else {
        return Err(RunError::not_a_run(path, NotARunReason::Name));
    };
    let plain = path.with_file_name(format!("{stem}{FILE_ENDING}"));
    if !plain.exists() {
        return Ok(plain);
    }
    let beside = path.with_file_name(format!("{stem}{RECOVERED_ENDING}{FILE_ENDING}"));
    if beside.exists() {
        return Err(RunError::not_a_run(path, NotARunReason::RecoveredBefore { beside }));
    }
    Ok(beside)
}

#[derive(Default)]
struct Copied {
    messages: u64,
    orphaned: u64,
    orphans: BTreeSet<u16>,
    damage: Vec<Damage>,
    definitions: Vec<ChannelDefinition>,
    source_bytes: u64,
}

struct Copy<'a> {
    writer: Writer<CountingWriter>,
    temporary: &'a Path,
    known: BTreeSet<u16>,
    schemas: BTreeMap<u16, (String, Vec<u8>)>,
    done: Copied,
}

/// Copies everything that can be read.
fn copy_whole(source: &Path, temporary: &Path, progress: &mut dyn FnMut(u64, u64)) -> Result<Copied, RunError> {
    let mut copied = copy(source, temporary, &[], progress)?;
    if copied.orphaned > 0 && !copied.orphans.is_disjoint(&copied.definitions.iter().map(|one| one.id).collect()) {
        // the first copy of the definitions was damaged; the intact one comes after the samples that need it
        let definitions = std::mem::take(&mut copied.definitions);
        copied = copy(source, temporary, &definitions, progress)?;
    }
    Ok(copied)
}

fn copy(
    source: &Path,
    temporary: &Path,
    definitions: &[ChannelDefinition],
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Copied, RunError> {
    // An unfinished file is a recorder's by its name, also if a power cut has emptied it.
    let mut scanner = if is_unfinished(source) { Scanner::open_any(source)? } else { Scanner::open(source)? };
    let file = File::create(temporary).map_err(RunError::io(temporary, "create the recovered file"))?;
    let counted = CountingWriter { inner: BufWriter::new(file), written: Arc::default() };
    let writer = options().create(counted).map_err(RunError::write(temporary))?;
    let done = Copied { source_bytes: scanner.length(), ..Copied::default() };
    let mut copy = Copy { writer, temporary, known: BTreeSet::new(), schemas: BTreeMap::new(), done };
    for definition in definitions {
        copy.define(definition)?;
    }
    let mut told = 0;
    loop {
        if scanner.position() - told >= 1 << 24 {
            told = scanner.position();
            progress(told, scanner.length());
        }
        match scanner.next()? {
            None => break,
            Some(Item::Damage(damage)) => copy.done.damage.push(damage),
            Some(Item::Message(message)) if copy.known.contains(&message.channel_id) => {
                let header = MessageHeader {
                    channel_id: message.channel_id,
                    sequence: message.sequence,
                    log_time: message.log_time,
                    publish_time: message.publish_time,
                };
                copy.writer.write_to_known_channel(&header, message.data).map_err(RunError::write(temporary))?;
                copy.done.messages += 1;
            }
            Some(Item::Message(message)) => {
                copy.done.orphans.insert(message.channel_id);
                copy.done.orphaned += 1;
            }
            Some(Item::Record(record)) => copy.record(record)?,
        }
    }
    progress(scanner.length(), scanner.length());
    copy.finish()
}

impl Copy<'_> {
    fn record(&mut self, record: Record<'_>) -> Result<(), RunError> {
        match record {
            Record::Schema { header, data } => {
                self.schemas.insert(header.id, (header.name, data.into_owned()));
                Ok(())
            }
            Record::Channel(channel) => {
                let (schema_name, schema) = match self.schemas.get(&channel.schema_id) {
                    Some((name, text)) => (name.clone(), String::from_utf8_lossy(text).into_owned()),
                    None => return Ok(()),
                };
                self.define(&ChannelDefinition {
                    id: channel.id,
                    schema_id: channel.schema_id,
                    topic: channel.topic,
                    schema_name,
                    schema,
                    metadata: channel.metadata,
                })
            }
            Record::Attachment { header, data, .. } => {
                if header.name.starts_with(CHANNELS_BEGINNING) {
                    for definition in serde_json::from_slice::<Vec<ChannelDefinition>>(&data).unwrap_or_default() {
                        self.define(&definition)?;
                    }
                }
                let attachment =
                    Attachment { name: header.name, media_type: header.media_type, data: data.into_owned() };
                attach(&mut self.writer, &attachment, header.log_time).map_err(RunError::write(self.temporary))
            }
            Record::Metadata(metadata) if metadata.name != RECOVERED => {
                self.writer.write_metadata(&metadata).map_err(RunError::write(self.temporary))
            }
            _ => Ok(()),
        }
    }

    /// Defines a channel with its original number; a second definition of the same number is ignored.
    fn define(&mut self, one: &ChannelDefinition) -> Result<(), RunError> {
        if !self.known.insert(one.id) {
            return Ok(());
        }
        let schema = self.writer.add_schema_with_id(one.schema_id, &one.schema_name, "ros2msg", one.schema.as_bytes());
        schema
            .and_then(|schema| self.writer.add_channel_with_id(one.id, schema, &one.topic, "cdr", &one.metadata))
            .map_err(RunError::write(self.temporary))?;
        self.done.definitions.push(one.clone());
        Ok(())
    }

    fn finish(self) -> Result<Copied, RunError> {
        let skipped: u64 = self.done.damage.iter().map(|damage| damage.bytes).sum();
        let metadata = BTreeMap::from([
            ("samples".to_owned(), self.done.messages.to_string()),
            ("orphaned".to_owned(), self.done.orphaned.to_string()),
            ("skipped_bytes".to_owned(), skipped.to_string()),
            ("skipped_places".to_owned(), self.done.damage.len().to_string()),
        ]);
        let mut writer = self.writer;
        writer
            .write_metadata(&Metadata { name: RECOVERED.into(), metadata })
            .and_then(|()| writer.finish())
            .map_err(RunError::write(self.temporary))?;
        let mut inner = writer.into_inner().inner;
        inner
            .flush()
            .and_then(|()| inner.get_ref().sync_all())
            .map_err(RunError::io(self.temporary, "synchronise the recovered file"))?;
        Ok(self.done)
    }
}
