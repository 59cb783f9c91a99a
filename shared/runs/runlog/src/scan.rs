//! Scans a run file, finished or not, record by record, and continues after damage.
//!
//! A chunk is handed on only as a whole, after its checksum was verified. After an invalid record, the scan continues
//! at the next offset where every field of a chunk header is plausible.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use mcap::MAGIC;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use serde::Serialize;

use crate::error::cause_text;
use crate::folder::open_file;
use crate::{NotARunReason, RunError};

/// Largest accepted chunk or record, bytes. Chunks have about 1 MiB; this bounds the allocation that a damaged length
/// causes.
const RECORD_BYTES: u64 = 256 << 20;
/// Opcode and length in front of each record, bytes.
const HEAD: u64 = 9;
/// Fixed fields of a chunk before the name of its compression, bytes.
const CHUNK_BEFORE: u64 = 32;
/// Bytes read at once while searching for the next chunk.
const WINDOW: usize = 256 * 1024;
/// Fields of a message record before its data, bytes.
const MESSAGE_HEAD: usize = 22;

/// An unreadable section of the file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Damage {
    /// Start of the section.
    pub offset: u64,
    /// Length of the section.
    pub bytes: u64,
    /// What is wrong.
    pub why: String,
    /// The file ends inside a record, as after a kill or a power cut; the disk is not at fault.
    pub torn_end: bool,
}

/// One scanned item.
pub(crate) enum Item<'a> {
    /// A definition, metadata or an attachment.
    Record(Record<'a>),
    Message(MessageRecord<'a>),
    Damage(Damage),
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct MessageRecord<'a> {
    pub channel_id: u16,
    pub sequence: u32,
    pub log_time: u64,
    pub publish_time: u64,
    pub data: &'a [u8],
}

#[derive(Clone, Copy)]
enum Entry {
    Record { opcode: u8, begin: usize, end: usize },
    Damage(usize),
}

pub(crate) struct Scanner {
    path: PathBuf,
    file: File,
    length: u64,
    at: u64,
    /// End of the last record verified by a checksum. The length of any later record may be wrong.
    vouched: u64,
    /// The footer was reached: the file was finished.
    complete: bool,
    chunks: LinearReader,
    raw: Vec<u8>,
    bytes: Vec<u8>,
    entries: Vec<Entry>,
    next: usize,
    damage: Vec<Damage>,
    window: Vec<u8>,
}

fn chunk_reader() -> LinearReader {
    LinearReader::new_with_options(
        LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(RECORD_BYTES as usize),
    )
}

impl Scanner {
    /// Opens a file in which something can be found.
    pub(crate) fn open(path: &Path) -> Result<Self, RunError> {
        let (scanner, nothing) = Self::begin(path)?;
        match nothing {
            Some(what) => Err(RunError::not_a_run(path, what)),
            None => Ok(scanner),
        }
    }

    /// As [`Scanner::open`], but a file in which nothing can be found is one damaged place. A power cut leaves such
    /// files, empty or full of zeros, and the other files of their run are to be read nevertheless.
    pub(crate) fn open_any(path: &Path) -> Result<Self, RunError> {
        let (mut scanner, nothing) = Self::begin(path)?;
        if let Some(what) = nothing {
            let (bytes, torn_end) = (scanner.length, matches!(what, NotARunReason::Empty));
            scanner.push_damage(Damage { offset: 0, bytes, why: what.to_string(), torn_end });
            scanner.at = scanner.length;
        }
        Ok(scanner)
    }

    /// Opens a file; also returns why nothing can be found in it.
    fn begin(path: &Path) -> Result<(Self, Option<NotARunReason>), RunError> {
        let file = open_file(path)?;
        let meta = file.metadata().map_err(RunError::io(path, "read the run file"))?;
        let mut scanner = Self {
            path: path.to_owned(),
            file,
            length: meta.len(),
            at: 0,
            vouched: 0,
            complete: false,
            chunks: chunk_reader(),
            raw: Vec::new(),
            bytes: Vec::new(),
            entries: Vec::new(),
            next: 0,
            damage: Vec::new(),
            window: Vec::new(),
        };
        let mut magic = [0; MAGIC.len()];
        let wrong = scanner.length < MAGIC.len() as u64 || {
            scanner.read_at(0, &mut magic)?;
            magic != *MAGIC
        };
        if !wrong {
            scanner.at = MAGIC.len() as u64;
        } else if scanner.find_chunk(0)?.is_none() {
            let what = if scanner.length == 0 { NotARunReason::Empty } else { NotARunReason::NotMcap };
            return Ok((scanner, Some(what)));
        }
        Ok((scanner, None))
    }

    /// True if the file was finished properly; valid after the scan.
    pub(crate) fn complete(&self) -> bool {
        self.complete
    }

    pub(crate) fn length(&self) -> u64 {
        self.length
    }

    /// Bytes scanned.
    pub(crate) fn position(&self) -> u64 {
        self.at
    }

    /// The next item; `None` at the end.
    pub(crate) fn next(&mut self) -> Result<Option<Item<'_>>, RunError> {
        while self.next >= self.entries.len() {
            if !self.advance()? {
                return Ok(None);
            }
        }
        let entry = self.entries[self.next];
        self.next += 1;
        Ok(Some(match entry {
            Entry::Damage(index) => Item::Damage(self.damage[index].clone()),
            Entry::Record { opcode, begin, end } => {
                let body = &self.bytes[begin..end];
                match message(opcode, body) {
                    Some(message) => Item::Message(message),
                    None => match mcap::parse_record(opcode, body) {
                        Ok(record) => Item::Record(record),
                        Err(error) => Item::Damage(Damage {
                            offset: self.at,
                            bytes: (end - begin) as u64,
                            why: cause_text(&error),
                            torn_end: false,
                        }),
                    },
                }
            }
        }))
    }

    /// Reads the chunk at this offset alone; [`Scanner::rest`] returns its items.
    pub(crate) fn load(&mut self, offset: u64) -> Result<(), RunError> {
        (self.at, self.vouched, self.complete) = (offset, offset, false);
        self.advance().map(|_| ())
    }

    /// The next item of the chunk that was read last; `None` at its end.
    pub(crate) fn rest(&mut self) -> Result<Option<Item<'_>>, RunError> {
        if self.next >= self.entries.len() { Ok(None) } else { self.next() }
    }

    /// The records after the data of a finished file, without its chunks: definitions and indexes. `None` for a file
    /// that was not finished.
    pub(crate) fn summary(&mut self) -> Result<Option<Vec<Record<'static>>>, RunError> {
        const FOOTER: u64 = HEAD + 20;
        let Some(footer_at) = self.length.checked_sub(FOOTER + MAGIC.len() as u64) else { return Ok(None) };
        let mut footer = [0; FOOTER as usize + MAGIC.len()];
        self.read_at(footer_at, &mut footer)?;
        let (begin, magic) = (u64_at(&footer, HEAD as usize), &footer[FOOTER as usize..]);
        let begin = begin.filter(|begin| (1..footer_at).contains(begin) && footer[0] == op::FOOTER && magic == MAGIC);
        let Some(begin) = begin.filter(|begin| footer_at - begin <= RECORD_BYTES) else { return Ok(None) };
        let mut bytes = vec![0; (footer_at - begin) as usize];
        self.read_at(begin, &mut bytes)?;
        let (mut records, mut rest) = (Vec::new(), &bytes[..]);
        while let Some((head, body)) = rest.split_at_checked(HEAD as usize) {
            let length = u64_at(head, 1).and_then(|length| usize::try_from(length).ok());
            let Some((body, after)) = length.and_then(|length| body.split_at_checked(length)) else { return Ok(None) };
            match mcap::parse_record(head[0], body) {
                Ok(record) => records.push(record.into_owned()),
                Err(_) => return Ok(None),
            }
            rest = after;
        }
        Ok(Some(records))
    }

    /// The data of the message that [`Scanner::next`] returned last.
    pub(crate) fn last_data(&self) -> Option<&[u8]> {
        match *self.entries.get(self.next.checked_sub(1)?)? {
            Entry::Record { begin, end, .. } => self.bytes.get(begin + MESSAGE_HEAD..end),
            Entry::Damage(_) => None,
        }
    }

    /// Reads the next record of the file, or the whole next chunk; false at the end.
    fn advance(&mut self) -> Result<bool, RunError> {
        self.entries.clear();
        self.bytes.clear();
        self.next = 0;
        let begin = self.at;
        if begin >= self.length || self.complete {
            return Ok(false);
        }
        let mut head = [0_u8; HEAD as usize];
        if begin + HEAD > self.length {
            return match self.find_chunk(self.doubtful(begin))? {
                Some(_) => self.skip(begin, "less than a record header".into()),
                None => self.torn(begin),
            };
        }
        self.read_at(begin, &mut head)?;
        // a chunk is recognised by its header fields, in case its opcode is the damaged byte
        let opcode = if self.is_chunk(begin)? { op::CHUNK } else { head[0] };
        let mut wide = [0_u8; 8];
        wide.copy_from_slice(&head[1..]);
        let length = u64::from_le_bytes(wide);
        if let Err(why) = plausible(opcode, length) {
            return self.skip(begin, why);
        }
        let end = begin + HEAD + length;
        if end > self.length {
            return match self.find_chunk(self.doubtful(begin))? {
                Some(_) => self.skip(begin, "a record longer than the file".into()),
                None => self.torn(begin),
            };
        }
        match opcode {
            op::FOOTER => {
                self.complete = true;
                self.at = self.length;
                return Ok(false);
            }
            op::CHUNK => {
                if let Err(why) = self.read_chunk(begin, length)? {
                    self.chunks = chunk_reader();
                    self.entries.clear();
                    self.bytes.clear();
                    self.vouched = self.vouched.max(begin);
                    return self.skip(begin, why);
                }
                debug_assert!(end > self.vouched, "verified up to {}, then up to {end}", self.vouched);
                self.vouched = end;
            }
            op::HEADER | op::SCHEMA | op::CHANNEL | op::MESSAGE | op::ATTACHMENT | op::METADATA => {
                let mut body = std::mem::take(&mut self.bytes);
                body.resize(length as usize, 0);
                let read = self.read_at(begin + HEAD, &mut body);
                self.bytes = body;
                read?;
                if let Err(error) = mcap::parse_record(opcode, &self.bytes) {
                    return self.skip(begin, cause_text(&error));
                }
                if opcode == op::ATTACHMENT {
                    self.vouched = end;
                }
                self.entries.push(Entry::Record { opcode, begin: 0, end: length as usize });
            }
            // indexes, statistics and private records are not needed
            _ => {}
        }
        debug_assert!(begin < end && end <= self.length, "the scan moved from {begin} to {end} of {}", self.length);
        self.at = end;
        Ok(true)
    }

    /// Reads a chunk and queues its records; the inner error states why it is invalid.
    fn read_chunk(&mut self, begin: u64, length: u64) -> Result<Result<(), String>, RunError> {
        let mut raw = std::mem::take(&mut self.raw);
        raw.resize((HEAD + length) as usize, 0);
        let read = self.read_at(begin, &mut raw).map(|()| {
            raw[0] = op::CHUNK;
            self.unpack(&raw)
        });
        self.raw = raw;
        read
    }

    /// Decompresses and verifies a chunk, and queues its records.
    fn unpack(&mut self, raw: &[u8]) -> Result<(), String> {
        check_chunk_head(&raw[HEAD as usize..], raw.len() as u64 - HEAD)?;
        let mut rest = raw;
        while let Some(event) = self.chunks.next_event() {
            match event.map_err(|error| cause_text(&error))? {
                LinearReadEvent::ReadRequest(_) if rest.is_empty() => return Ok(()),
                LinearReadEvent::ReadRequest(need) => {
                    let count = need.min(rest.len());
                    self.chunks.insert(count)[..count].copy_from_slice(&rest[..count]);
                    self.chunks.notify_read(count);
                    rest = &rest[count..];
                }
                LinearReadEvent::Record { data, opcode } => {
                    let begin = self.bytes.len();
                    self.bytes.extend_from_slice(data);
                    self.entries.push(Entry::Record { opcode, begin, end: self.bytes.len() });
                }
            }
        }
        Ok(())
    }

    /// Records damage at `begin` and continues after it.
    fn skip(&mut self, begin: u64, why: String) -> Result<bool, RunError> {
        // the error may lie before the record at which it shows: a wrong length of an earlier record may have led here
        let end = self.find_chunk(self.doubtful(begin))?.unwrap_or(self.length);
        let begin = if end < begin { self.vouched } else { begin };
        debug_assert!(
            self.vouched <= begin && begin < end && end <= self.length,
            "damage from {begin} to {end}; verified up to {} of {}",
            self.vouched,
            self.length
        );
        self.push_damage(Damage { offset: begin, bytes: end - begin, why, torn_end: false });
        self.at = end;
        Ok(true)
    }

    /// Where the search for the next chunk starts if the record at `begin` is invalid.
    fn doubtful(&self, begin: u64) -> u64 {
        if self.vouched < begin { self.vouched.max(MAGIC.len() as u64) } else { begin + 1 }
    }

    fn torn(&mut self, begin: u64) -> Result<bool, RunError> {
        let bytes = self.length - begin;
        self.push_damage(Damage { offset: begin, bytes, why: "the file ends inside a record".into(), torn_end: true });
        self.at = self.length;
        Ok(true)
    }

    fn push_damage(&mut self, damage: Damage) {
        debug_assert!(damage.offset + damage.bytes <= self.length, "damage beyond the end of the file: {damage:?}");
        self.damage.push(damage);
        self.entries.push(Entry::Damage(self.damage.len() - 1));
    }

    /// The next offset from `from` where every field of a chunk header is plausible.
    fn find_chunk(&mut self, from: u64) -> Result<Option<u64>, RunError> {
        let mut window = std::mem::take(&mut self.window);
        let mut at = from;
        let mut found = None;
        while found.is_none() && at + HEAD + CHUNK_BEFORE < self.length {
            window.resize(WINDOW.min((self.length - at) as usize), 0);
            self.read_at(at, &mut window)?;
            for offset in window.iter().enumerate().filter(|(_, byte)| **byte == op::CHUNK).map(|(offset, _)| offset) {
                if self.is_chunk(at + offset as u64)? {
                    found = Some(at + offset as u64);
                    break;
                }
            }
            at += window.len() as u64;
        }
        self.window = window;
        Ok(found)
    }

    fn is_chunk(&self, at: u64) -> Result<bool, RunError> {
        let mut head = [0_u8; 64];
        let there = (self.length - at).min(head.len() as u64) as usize;
        if (there as u64) < HEAD + CHUNK_BEFORE + 8 {
            return Ok(false);
        }
        self.read_at(at, &mut head[..there])?;
        let mut wide = [0_u8; 8];
        wide.copy_from_slice(&head[1..HEAD as usize]);
        let length = u64::from_le_bytes(wide);
        Ok(at.checked_add(HEAD + length.min(RECORD_BYTES + 1)).is_some_and(|end| end <= self.length)
            && check_chunk_head(&head[HEAD as usize..there], length).is_ok())
    }

    fn read_at(&self, at: u64, into: &mut [u8]) -> Result<(), RunError> {
        let read = self.file.read_exact_at(into, at);
        read.map_err(|error: io::Error| RunError::io(&self.path, "read the run file")(error))
    }
}

fn message(opcode: u8, body: &[u8]) -> Option<MessageRecord<'_>> {
    if opcode != op::MESSAGE {
        return None;
    }
    let (head, data) = body.split_at_checked(MESSAGE_HEAD)?;
    Some(MessageRecord {
        channel_id: u16::from_le_bytes([head[0], head[1]]),
        sequence: u32::from_le_bytes([head[2], head[3], head[4], head[5]]),
        log_time: u64_at(head, 6)?,
        publish_time: u64_at(head, 14)?,
        data,
    })
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?))
}

/// Checks that a record's opcode and length are plausible.
fn plausible(opcode: u8, length: u64) -> Result<(), String> {
    let fits = match opcode {
        op::FOOTER => length == 20,
        op::DATA_END => length == 4,
        op::MESSAGE_INDEX => length >= 6 && (length - 6).is_multiple_of(16),
        0 => return Err("zeros in place of a record".into()),
        op::HEADER..=op::DATA_END | 0x80.. => true,
        _ => return Err(format!("unknown record opcode {opcode:#04x}")),
    };
    // attachments may be larger than a chunk; the length of the file bounds them
    match fits && (length <= RECORD_BYTES || opcode == op::ATTACHMENT) && length < i64::MAX as u64 {
        true => Ok(()),
        false => Err(format!("a record (opcode {opcode:#04x}) with the impossible length {length}")),
    }
}

/// Checks that the header fields of a chunk are consistent with each other and with the record's length.
fn check_chunk_head(body: &[u8], length: u64) -> Result<(), String> {
    let fields = || {
        let (start, end) = (u64_at(body, 0)?, u64_at(body, 8)?);
        let name_length = u32::from_le_bytes(body.get(28..32)?.try_into().ok()?) as usize;
        let name = body.get(32..32_usize.checked_add(name_length)?)?;
        let compressed = u64_at(body, 32 + name_length)?;
        let known = [&b""[..], b"zstd", b"lz4"].contains(&name);
        let whole = compressed.checked_add(CHUNK_BEFORE + 8 + name_length as u64)?;
        (known && start <= end && whole == length && length <= RECORD_BYTES).then_some(())
    };
    fields().ok_or_else(|| "a chunk with an inconsistent header".into())
}
