//! The newest samples of every channel at an instant: reads only the chunks that hold them, by the index of the file.

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::records::{ChunkIndex, Record};

use crate::read::{RecordedChannel, RecordedSample, RunReader};
use crate::scan::{Item, Scanner};
use crate::write::{CDR_HEADER, ChannelDefinition};
use crate::{RunError, segments};

/// Most samples of a channel that are kept: an answer names the cycle of its inputs, which is one of the last few.
pub const RECENT: usize = 8;

/// A sample with its channel, apart from the file.
#[derive(Debug, Clone)]
pub struct KeptSample {
    /// Channel of the sample.
    pub channel: Arc<RecordedChannel>,
    /// Sequence number, the lower 32 bits.
    pub sequence: u32,
    /// Publication time, UNIX time, ns. If the original is in no file that was read, this is the begin of a later file
    /// that repeats it.
    pub log_time_ns: u64,
    /// Time at which the content was valid, UNIX time, ns.
    pub publish_time_ns: u64,
    /// The bytes as they were in memory.
    pub sample: Vec<u8>,
}

/// The newest samples of every channel at an instant.
#[derive(Debug, Clone, Default)]
pub struct Instant {
    /// By channel name: the last samples that were published by then, the newest last; at most [`RECENT`].
    pub samples: BTreeMap<String, VecDeque<KeptSample>>,
    /// Log time of the last sample of the run, UNIX time, ns; 0 without samples.
    pub end_ns: u64,
    /// Chunks that were read.
    pub chunks: usize,
    /// Files that were read from their beginning, because they have no index: they were not finished.
    pub scanned: usize,
}

impl Instant {
    /// Reads the newest samples of a run at a UNIX time, ns.
    ///
    /// # Errors
    /// The run cannot be read.
    pub fn read(run: &Path, at_ns: u64) -> Result<Self, RunError> {
        let mut files = if run.is_dir() { segments(run)? } else { vec![run.to_owned()] };
        if files.len() > 1 {
            // A file that a power cut emptied keeps no other from being read.
            let is_empty = |file: &PathBuf| matches!(Scanner::open(file), Err(RunError::NotARun { .. }));
            files.retain(|file| !is_empty(file));
        }
        let mut instant = Self::default();
        // The newest file that has begun has the newest samples. Shortly after its begin it has few of them, and
        // earlier files have those before.
        for file in files.iter().rev() {
            let enough = instant.samples.iter().filter(|(_, found)| found.len() == RECENT);
            let enough: BTreeSet<String> = enough.map(|(name, _)| name.clone()).collect();
            let mut earlier = Self::default();
            match Index::read(file)? {
                Some(index) => earlier.by_index(file, &index, at_ns, &enough)?,
                None => earlier.by_scan(file, at_ns, &enough)?,
            }
            instant.fill_up(earlier);
        }
        Ok(instant)
    }

    /// Adds samples of an earlier file to channels that have too few.
    fn fill_up(&mut self, earlier: Self) {
        self.chunks += earlier.chunks;
        self.scanned += earlier.scanned;
        self.end_ns = self.end_ns.max(earlier.end_ns);
        for (name, mut all) in earlier.samples {
            let later = self.samples.remove(&name).unwrap_or_default();
            // A file begins with the last samples of silent channels. Leave out a repeated one: the original has the
            // time of its publication.
            let key = |kept: &KeptSample| (kept.sequence, kept.publish_time_ns);
            let originals: Vec<_> = all.iter().map(key).collect();
            all.extend(later.into_iter().filter(|kept| !originals.contains(&key(kept))));
            all.make_contiguous().sort_by_key(|kept| kept.log_time_ns);
            all.drain(..all.len().saturating_sub(RECENT));
            self.samples.insert(name, all);
        }
    }

    /// Adds the samples of a finished file, except of channels that have enough.
    fn by_index(&mut self, file: &Path, index: &Index, at_ns: u64, enough: &BTreeSet<String>) -> Result<(), RunError> {
        // The chunk that ends last is the first one.
        self.end_ns = index.chunks.first().map_or(0, |chunk| chunk.message_end_time);
        let mut scanner = Scanner::open(file)?;
        for chunk in index.chunks.iter().filter(|chunk| chunk.message_start_time <= at_ns) {
            // A channel needs this chunk if it may hold a newer sample than those found, or one more of them.
            let needs = |id: &u16| {
                let Some(channel) = index.channels.get(id).filter(|channel| !enough.contains(&channel.name)) else {
                    return false;
                };
                let oldest = self.samples.get(&channel.name).filter(|found| found.len() == RECENT);
                oldest.and_then(VecDeque::front).is_none_or(|oldest| oldest.log_time_ns < chunk.message_end_time)
            };
            if !chunk.message_index_offsets.keys().any(needs) {
                continue;
            }
            self.chunks += 1;
            scanner.load(chunk.chunk_start_offset)?;
            while let Some(item) = scanner.rest()? {
                let Item::Message(message) = item else { continue };
                let channel = index.channels.get(&message.channel_id).filter(|_| message.log_time <= at_ns);
                if let Some(channel) = channel.filter(|channel| !enough.contains(&channel.name)) {
                    self.keep(&RecordedSample {
                        channel,
                        index: usize::from(message.channel_id),
                        sequence: message.sequence,
                        log_time_ns: message.log_time,
                        publish_time_ns: message.publish_time,
                        sample: message.data.strip_prefix(&CDR_HEADER).unwrap_or(message.data),
                    });
                }
            }
        }
        Ok(())
    }

    /// Adds the samples of a file without an index, except of channels that have enough.
    fn by_scan(&mut self, file: &Path, at_ns: u64, enough: &BTreeSet<String>) -> Result<(), RunError> {
        let mut reader = RunReader::open(file)?;
        self.scanned += 1;
        while let Some(recorded) = reader.next_sample()? {
            self.end_ns = self.end_ns.max(recorded.log_time_ns);
            if recorded.log_time_ns <= at_ns && !enough.contains(&recorded.channel.name) {
                self.keep(&recorded);
            }
        }
        Ok(())
    }

    /// Keeps a sample if it is one of the newest of its channel.
    fn keep(&mut self, recorded: &RecordedSample<'_>) {
        let RecordedSample { channel, sequence, log_time_ns, publish_time_ns, sample, .. } = *recorded;
        let found = self.samples.entry(channel.name.clone()).or_default();
        let at = found.iter().rposition(|other| other.log_time_ns <= log_time_ns).map_or(0, |at| at + 1);
        if at == 0 && found.len() == RECENT {
            return;
        }
        let (channel, sample) = (Arc::clone(channel), sample.to_vec());
        found.insert(at, KeptSample { channel, sequence, log_time_ns, publish_time_ns, sample });
        if found.len() > RECENT {
            found.pop_front();
        }
    }
}

/// Index of a finished file.
struct Index {
    /// The chunks, those that end last first.
    chunks: Vec<ChunkIndex>,
    channels: HashMap<u16, Arc<RecordedChannel>>,
}

impl Index {
    /// Reads the index; `None` for a file that was not finished.
    fn read(file: &Path) -> Result<Option<Self>, RunError> {
        let Some(records) = Scanner::open(file)?.summary()? else { return Ok(None) };
        let (mut schemas, mut definitions, mut chunks) = (HashMap::new(), Vec::new(), Vec::new());
        for record in records {
            match record {
                Record::Schema { header, data } => {
                    schemas.insert(header.id, (header.name, String::from_utf8_lossy(&data).into_owned()));
                }
                Record::Channel(channel) => definitions.push(channel),
                Record::ChunkIndex(chunk) => chunks.push(chunk),
                _ => {}
            }
        }
        let defined = |one: mcap::records::Channel| {
            let (schema_name, schema) = schemas.get(&one.schema_id).cloned().unwrap_or_default();
            let (id, schema_id, topic, metadata) = (one.id, one.schema_id, one.topic, one.metadata);
            let definition = ChannelDefinition { id, schema_id, topic, schema_name, schema, metadata };
            (id, Arc::new(RecordedChannel::new(definition)))
        };
        let channels = definitions.into_iter().map(defined).collect();
        chunks.sort_by_key(|chunk| std::cmp::Reverse(chunk.message_end_time));
        let indexed = chunks.iter().any(|chunk| !chunk.message_index_offsets.is_empty());
        Ok(indexed.then_some(Self { chunks, channels }))
    }
}
