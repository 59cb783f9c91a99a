//! The newest samples of every channel at an instant: reads only the chunks that hold them, by the index of the file.

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};
use std::path::Path;
use std::sync::Arc;

use mcap::records::{ChunkIndex, Record};

use crate::read::{RecordedChannel, RunReader};
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
    /// Publication time, UNIX time, ns.
    pub log_time_ns: u64,
    /// The bytes as they were in memory.
    pub sample: Vec<u8>,
}

/// The newest samples of every channel at an instant.
#[derive(Debug, Clone, Default)]
pub struct Instant {
    /// By channel name: the last samples that were published by then, the newest last; at most [`RECENT`].
    pub samples: BTreeMap<String, VecDeque<KeptSample>>,
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
        let files = if run.is_dir() { segments(run)? } else { vec![run.to_owned()] };
        let mut instant = Self::default();
        // Each file begins with the last samples of silent channels, and the newest file that has begun has the newest
        // samples. Earlier files have those of channels that ended.
        for file in files.iter().rev() {
            let ended: BTreeSet<String> = instant.samples.keys().cloned().collect();
            match Index::read(file)? {
                Some(index) => instant.by_index(file, &index, at_ns, &ended)?,
                None => instant.by_scan(file, at_ns, &ended)?,
            }
        }
        Ok(instant)
    }

    /// Adds the samples of a finished file, of channels that no later file had.
    fn by_index(&mut self, file: &Path, index: &Index, at_ns: u64, had: &BTreeSet<String>) -> Result<(), RunError> {
        let mut scanner = Scanner::open(file)?;
        for chunk in index.chunks.iter().filter(|chunk| chunk.message_start_time <= at_ns) {
            // A channel needs this chunk if it may hold a newer sample than those found, or one more of them.
            let needs = |id: &u16| {
                let Some(channel) = index.channels.get(id).filter(|channel| !had.contains(&channel.name)) else {
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
                if let Some(channel) = channel.filter(|channel| !had.contains(&channel.name)) {
                    self.keep(channel, message.log_time, message.data);
                }
            }
        }
        Ok(())
    }

    /// Adds the samples of a file without an index, of channels that no later file had.
    fn by_scan(&mut self, file: &Path, at_ns: u64, had: &BTreeSet<String>) -> Result<(), RunError> {
        let mut reader = RunReader::open(file)?;
        self.scanned += 1;
        while let Some(recorded) = reader.next_sample()? {
            if recorded.log_time_ns <= at_ns && !had.contains(&recorded.channel.name) {
                let (channel, log_time_ns) = (Arc::clone(recorded.channel), recorded.log_time_ns);
                self.keep(&channel, log_time_ns, recorded.sample);
            }
        }
        Ok(())
    }

    /// Keeps a sample if it is one of the newest of its channel.
    fn keep(&mut self, channel: &Arc<RecordedChannel>, log_time_ns: u64, data: &[u8]) {
        let found = self.samples.entry(channel.name.clone()).or_default();
        let at = found.iter().rposition(|other| other.log_time_ns <= log_time_ns).map_or(0, |at| at + 1);
        if at == 0 && found.len() == RECENT {
            return;
        }
        let sample = data.strip_prefix(&CDR_HEADER).unwrap_or(data).to_vec();
        found.insert(at, KeptSample { channel: Arc::clone(channel), log_time_ns, sample });
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
