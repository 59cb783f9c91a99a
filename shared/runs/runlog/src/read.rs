//! The samples of a run, in the order in which they were recorded.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use mcap::records::Record;
use messages::Message;

use crate::dedup::Repeats;
use crate::recover::RECOVERED;
use crate::scan::{Item, Scanner};
use crate::write::{CDR_HEADER, CHANNELS_BEGINNING, RUN, RUN_END, Repeated};
use crate::{Attachment, Conversion, Damage, RunClock, RunError, segments};

/// A channel as the file describes it.
#[derive(Debug, Clone)]
pub struct RecordedChannel {
    /// e.g. `motor/state`.
    pub name: String,
    /// e.g. `nims_msgs/msg/MotorState`.
    pub schema_name: String,
    /// Complete definition, as every reader understands it.
    pub schema: String,
    /// e.g. `nims_msgs/MotorState/1a2b3c4d`; empty in files of other origin.
    pub type_name: String,
    /// Why it was recorded as plain bytes, if it was.
    pub refused: Option<String>,
    /// To the type of this build of the same name, once it was asked for.
    conversion: OnceLock<Option<Conversion>>,
}

impl PartialEq for RecordedChannel {
    fn eq(&self, other: &Self) -> bool {
        let all = |one: &Self| {
            let Self { name, schema_name, schema, type_name, refused, conversion: _ } = one.clone();
            (name, schema_name, schema, type_name, refused)
        };
        all(self) == all(other)
    }
}

/// One sample.
#[derive(Debug, Clone, Copy)]
pub struct Recorded<'a> {
    /// Where it travelled.
    pub channel: &'a Arc<RecordedChannel>,
    /// Where the channel stands in [`RunReader::channels`].
    pub index: usize,
    /// Its number, the lower 32 bits.
    pub sequence: u32,
    /// When it was published, UNIX time, ns.
    pub log_time_ns: u64,
    /// When its content was true, UNIX time, ns.
    pub publish_time_ns: u64,
    /// The bytes as they lay in memory.
    pub sample: &'a [u8],
}

impl RecordedChannel {
    /// How its samples become those of this build's type; `None` if it is of another type.
    #[must_use]
    pub fn conversion<T: Message>(&self) -> Option<&Conversion> {
        // Only the type of the same name can be meant, so that one place is enough for all types.
        if self.schema_name.rsplit('/').next() != Some(T::NAME) {
            return None;
        }
        self.conversion.get_or_init(|| Conversion::of::<T>(&self.type_name, &self.schema)).as_ref()
    }
}

impl Recorded<'_> {
    /// The sample as a type of this build; `None` if it is of another type. One that another build recorded is read by the names of its
    /// fields, and what is new is zero.
    #[must_use]
    pub fn to<T: Message>(&self) -> Option<T> {
        self.channel.conversion::<T>()?.take(self.sample)
    }
}

/// Reads a run file, or all files of a run folder one after the other as one; unfinished and damaged ones as far as they go.
///
/// A sample that a later file repeats comes once. What was recorded together comes together, but only nearly in the order of its time: a
/// late batch, or the seam between two files, may set it back by moments.
pub struct RunReader {
    files: std::vec::IntoIter<PathBuf>,
    bytes: u64,
    scanner: Option<Scanner>,
    path: PathBuf,
    /// By the number that a channel has in the file being read: where it stands in `all`.
    channels: HashMap<u16, usize>,
    /// One object per different channel of the run, so that equal channels of several files are the same.
    all: Vec<Arc<RecordedChannel>>,
    /// Only where there is more than one file.
    repeats: Option<Repeats>,
    schemas: HashMap<u16, (String, String)>,
    clock: Option<RunClock>,
    about: BTreeMap<String, String>,
    end: Vec<BTreeMap<String, String>>,
    attachments: Vec<Attachment>,
    damage: Vec<(PathBuf, Damage)>,
    finished: Vec<(PathBuf, bool, u64)>,
    recovered: Vec<(PathBuf, BTreeMap<String, String>)>,
    orphaned: u64,
}

impl RunReader {
    /// Opens a file or a folder.
    ///
    /// # Errors
    /// There is no run file.
    pub fn open(path: &Path) -> Result<Self, RunError> {
        let files = if path.is_dir() { segments(path)? } else { vec![path.to_owned()] };
        let bytes = files.iter().filter_map(|file| file.metadata().ok()).map(|meta| meta.len()).sum();
        let mut reader = Self {
            bytes,
            repeats: (files.len() > 1).then(Repeats::default),
            files: files.into_iter(),
            scanner: None,
            path: path.to_owned(),
            channels: HashMap::new(),
            all: Vec::new(),
            schemas: HashMap::new(),
            clock: None,
            about: BTreeMap::new(),
            end: Vec::new(),
            attachments: Vec::new(),
            damage: Vec::new(),
            finished: Vec::new(),
            recovered: Vec::new(),
            orphaned: 0,
        };
        reader.open_next()?;
        reader.about = first_about(&reader.path).unwrap_or_default();
        reader.clock = RunClock::of_about(&reader.about);
        Ok(reader)
    }

    fn open_next(&mut self) -> Result<bool, RunError> {
        if let Some(scanner) = self.scanner.take() {
            self.finished.push((self.path.clone(), scanner.complete(), scanner.length()));
        }
        let Some(path) = self.files.next() else { return Ok(false) };
        self.scanner = Some(Scanner::open(&path)?);
        self.path = path;
        self.channels.clear();
        self.schemas.clear();
        if let Some(repeats) = &mut self.repeats {
            repeats.next_file();
        }
        Ok(true)
    }

    /// The next sample; `None` at the end of the run.
    ///
    /// # Errors
    /// The file cannot be read. Damage is no error: see [`RunReader::damage`].
    pub fn next_sample(&mut self) -> Result<Option<Recorded<'_>>, RunError> {
        // the found message is taken apart and put together again outside of the loop, because a borrow of the scanner
        // cannot be returned from inside while the loop goes on with it
        let found = loop {
            let Some(scanner) = &mut self.scanner else { return Ok(None) };
            match scanner.next()? {
                None => {
                    self.open_next()?;
                }
                Some(Item::Damage(damage)) => self.damage.push((self.path.clone(), damage)),
                Some(Item::Message(message)) => match self.channels.get(&message.channel_id) {
                    Some(&index) => {
                        let (sequence, log_time, publish_time) =
                            (message.sequence, message.log_time, message.publish_time);
                        let repeats = self.repeats.as_mut();
                        if !repeats.is_some_and(|repeats| repeats.is_repeated(index, sequence, publish_time)) {
                            break (index, sequence, log_time, publish_time);
                        }
                    }
                    None => self.orphaned += 1,
                },
                Some(Item::Record(record)) => {
                    let record = record.into_owned();
                    self.record(record);
                }
            }
        };
        let (index, sequence, log_time_ns, publish_time_ns) = found;
        let sample = self.scanner.as_ref().and_then(Scanner::last_data).unwrap_or_default();
        let sample = sample.strip_prefix(&CDR_HEADER).unwrap_or(sample);
        Ok(self.all.get(index).map(|channel| Recorded {
            channel,
            index,
            sequence,
            log_time_ns,
            publish_time_ns,
            sample,
        }))
    }

    fn record(&mut self, record: Record<'static>) {
        match record {
            Record::Schema { header, data } => {
                self.schemas.insert(header.id, (header.name, String::from_utf8_lossy(&data).into_owned()));
            }
            Record::Channel(channel) => {
                let (schema_name, schema) = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                let (id, topic, metadata) = (channel.id, channel.topic, channel.metadata);
                self.define(Repeated { id, schema_id: channel.schema_id, topic, schema_name, schema, metadata });
            }
            Record::Metadata(metadata) if metadata.name == RUN => {
                self.clock = RunClock::of_about(&metadata.metadata).or(self.clock);
                self.about = metadata.metadata;
            }
            Record::Metadata(metadata) if metadata.name == RUN_END => self.end.push(metadata.metadata),
            Record::Metadata(metadata) if metadata.name == RECOVERED => {
                self.recovered.push((self.path.clone(), metadata.metadata));
            }
            Record::Attachment { header, data, .. } if header.name.starts_with(CHANNELS_BEGINNING) => {
                for one in serde_json::from_slice::<Vec<Repeated>>(&data).unwrap_or_default() {
                    self.define(one);
                }
            }
            Record::Attachment { header, data, .. } => {
                let (name, media_type) = (header.name, header.media_type);
                let attachment = Attachment { name, media_type, data: data.into_owned() };
                if !self.attachments.contains(&attachment) {
                    self.attachments.push(attachment);
                }
            }
            _ => {}
        }
    }

    fn define(&mut self, one: Repeated) {
        if self.channels.contains_key(&one.id) {
            return;
        }
        let channel = RecordedChannel {
            name: one.topic.strip_prefix('/').unwrap_or(&one.topic).to_owned(),
            schema_name: one.schema_name,
            schema: one.schema,
            type_name: one.metadata.get("type").cloned().unwrap_or_default(),
            refused: one.metadata.get("refused").cloned(),
            conversion: OnceLock::new(),
        };
        let index = self.all.iter().position(|known| **known == channel).unwrap_or_else(|| {
            self.all.push(Arc::new(channel));
            self.all.len() - 1
        });
        self.channels.insert(one.id, index);
    }

    /// The channels met so far; all of them after the last sample.
    #[must_use]
    pub fn channels(&self) -> &[Arc<RecordedChannel>] {
        &self.all
    }

    /// The clock of the run, if its files state one.
    #[must_use]
    pub fn clock(&self) -> Option<RunClock> {
        self.clock
    }

    /// Who, what, with which versions.
    #[must_use]
    pub fn about(&self) -> &BTreeMap<String, String> {
        &self.about
    }

    /// What each finished file says about its end.
    #[must_use]
    pub fn ends(&self) -> &[BTreeMap<String, String>] {
        &self.end
    }

    /// Files that were kept inside the run file.
    #[must_use]
    pub fn attachments(&self) -> &[Attachment] {
        &self.attachments
    }

    /// What could not be read so far, and in which file.
    #[must_use]
    pub fn damage(&self) -> &[(PathBuf, Damage)] {
        &self.damage
    }

    /// Samples met so far that no definition describes.
    #[must_use]
    pub fn orphaned(&self) -> u64 {
        self.orphaned
    }

    /// Samples left out so far because a file before had them already.
    #[must_use]
    pub fn repeated(&self) -> u64 {
        self.repeats.as_ref().map_or(0, Repeats::found)
    }

    /// The files read to their end: path, whether it was finished properly, bytes.
    #[must_use]
    pub fn files(&self) -> &[(PathBuf, bool, u64)] {
        &self.finished
    }

    /// The files met so far that were made by a recovery, with what it says about itself.
    #[must_use]
    pub fn recovered(&self) -> &[(PathBuf, BTreeMap<String, String>)] {
        &self.recovered
    }

    /// Bytes of all files of the run.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// How many of them have been read.
    #[must_use]
    pub fn position(&self) -> u64 {
        let finished: u64 = self.finished.iter().map(|(_, _, bytes)| bytes).sum();
        finished + self.scanner.as_ref().map_or(0, Scanner::position)
    }

    /// The file being read.
    #[must_use]
    pub fn file(&self) -> &Path {
        &self.path
    }
}

/// What a file says at its beginning about who, what, when; `None` if it says nothing.
pub(crate) fn first_about(file: &Path) -> Option<BTreeMap<String, String>> {
    let mut scanner = Scanner::open(file).ok()?;
    while let Ok(Some(item)) = scanner.next() {
        match item {
            Item::Record(Record::Metadata(metadata)) if metadata.name == RUN => return Some(metadata.metadata),
            Item::Message(_) => return None,
            _ => {}
        }
    }
    None
}

/// Every sample of one channel with the time it was published (UNIX time, ns).
///
/// # Errors
/// The run cannot be read, or the channel holds another type than `T`.
pub fn read_channel<T: Message>(path: &Path, channel: &str) -> Result<Vec<(u64, T)>, RunError> {
    let mut reader = RunReader::open(path)?;
    let mut found = Vec::new();
    while let Some(recorded) = reader.next_sample()? {
        if recorded.channel.name != channel {
            continue;
        }
        match recorded.to::<T>() {
            Some(sample) => found.push((recorded.log_time_ns, sample)),
            None => {
                return Err(RunError::Type {
                    channel: channel.to_owned(),
                    found: recorded.channel.type_name.clone(),
                    wanted: T::type_name().to_owned(),
                });
            }
        }
    }
    Ok(found)
}
