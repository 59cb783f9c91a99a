//! Reads the samples of a run in the order of recording.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use mcap::records::Record;
use messages::Message;

use crate::clock::{BOOT_ID, boot_id};
use crate::dedup::Duplicates;
use crate::recover::RECOVERED;
use crate::scan::{Item, Scanner};
use crate::write::{CDR_HEADER, CHANNELS_BEGINNING, ChannelDefinition, RUN, RUN_END};
use crate::{Attachment, Conversion, Damage, RunClock, RunError, segments};

/// A channel as described in the file.
#[derive(Debug, Clone)]
pub struct RecordedChannel {
    /// e.g. `motor/state`.
    pub name: String,
    /// e.g. `nims_msgs/msg/MotorState`.
    pub schema_name: String,
    /// Complete definition in the form that every reader decodes.
    pub schema: String,
    /// e.g. `nims_msgs/MotorState/1a2b3c4d`; empty in files that other programs wrote.
    pub type_name: String,
    /// Why the channel was recorded as plain bytes; `None` if it was not.
    pub refused: Option<String>,
    /// Conversion to this build's type of the same name, created on first use.
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

/// One recorded sample.
#[derive(Debug, Clone, Copy)]
pub struct RecordedSample<'a> {
    /// Channel of the sample.
    pub channel: &'a Arc<RecordedChannel>,
    /// Index of the channel in [`RunReader::channels`].
    pub index: usize,
    /// Sequence number, the lower 32 bits.
    pub sequence: u32,
    /// Publication time, UNIX time, ns.
    pub log_time_ns: u64,
    /// Time at which the content was valid, UNIX time, ns.
    pub publish_time_ns: u64,
    /// The bytes as they were in memory.
    pub sample: &'a [u8],
}

impl RecordedChannel {
    pub(crate) fn new(one: ChannelDefinition) -> Self {
        Self {
            name: one.topic.strip_prefix('/').unwrap_or(&one.topic).to_owned(),
            schema_name: one.schema_name,
            schema: one.schema,
            type_name: one.metadata.get("type").cloned().unwrap_or_default(),
            refused: one.metadata.get("refused").cloned(),
            conversion: OnceLock::new(),
        }
    }

    /// Conversion of its samples to this build's type; `None` if the channel has another type.
    #[must_use]
    pub fn conversion<T: Message>(&self) -> Option<&Conversion> {
        // only the type of the same name can match, so one conversion per channel suffices
        if self.schema_name.rsplit('/').next() != Some(T::NAME) {
            return None;
        }
        self.conversion.get_or_init(|| Conversion::new::<T>(&self.type_name, &self.schema)).as_ref()
    }
}

impl RecordedSample<'_> {
    /// The sample as this build's type; `None` if it has another type. Samples of another build are converted by field
    /// name; new fields are zero.
    #[must_use]
    pub fn decode<T: Message>(&self) -> Option<T> {
        self.channel.conversion::<T>()?.apply(self.sample)
    }
}

/// Reads a run file, or all files of a run folder as one; unfinished and damaged files as far as possible.
///
/// A sample that a later file repeats is returned once. Samples come only nearly in the order of time: a late batch, or
/// the boundary between two files, may set it back briefly.
pub struct RunReader {
    files: std::vec::IntoIter<PathBuf>,
    bytes: u64,
    scanner: Option<Scanner>,
    path: PathBuf,
    /// Index in `all` by the channel's number in the current file.
    channels: HashMap<u16, usize>,
    /// One object per distinct channel of the run; equal channels of several files share it.
    all: Vec<Arc<RecordedChannel>>,
    /// Only for runs of more than one file.
    repeats: Option<Duplicates>,
    /// Whether a file in which nothing can be found is damage and no error, because the run has others.
    skips: bool,
    schemas: HashMap<u16, (String, String)>,
    clock: Option<RunClock>,
    begin_ns: Option<u64>,
    about: BTreeMap<String, String>,
    end: Vec<BTreeMap<String, String>>,
    attachments: Vec<Attachment>,
    damage: Vec<(PathBuf, Damage)>,
    finished: Vec<(PathBuf, bool, u64)>,
    recovered: Vec<(PathBuf, BTreeMap<String, String>)>,
    orphaned: u64,
}

impl RunReader {
    /// Opens a file or a folder. A file of a folder in which nothing can be found is damage if there is another one.
    ///
    /// # Errors
    /// There is no run file.
    pub fn open(path: &Path) -> Result<Self, RunError> {
        let files = if path.is_dir() { segments(path)? } else { vec![path.to_owned()] };
        let bytes = files.iter().filter_map(|file| file.metadata().ok()).map(|meta| meta.len()).sum();
        // A file that a power cut emptied, or its recovery, has none.
        let about = files.iter().find_map(|file| first_about(file)).unwrap_or_default();
        let mut reader = Self {
            bytes,
            repeats: (files.len() > 1).then(Duplicates::default),
            skips: files.len() > 1 && files.iter().any(|file| Scanner::open(file).is_ok()),
            files: files.into_iter(),
            scanner: None,
            path: path.to_owned(),
            channels: HashMap::new(),
            all: Vec::new(),
            schemas: HashMap::new(),
            clock: None,
            begin_ns: None,
            about,
            end: Vec::new(),
            attachments: Vec::new(),
            damage: Vec::new(),
            finished: Vec::new(),
            recovered: Vec::new(),
            orphaned: 0,
        };
        reader.open_next()?;
        reader.clock = RunClock::from_about(&reader.about);
        reader.begin_ns = reader.clock.map(|clock| clock.t0_unix_ns);
        Ok(reader)
    }

    fn open_next(&mut self) -> Result<bool, RunError> {
        if let Some(scanner) = self.scanner.take() {
            self.finished.push((self.path.clone(), scanner.complete(), scanner.length()));
        }
        let Some(path) = self.files.next() else { return Ok(false) };
        self.scanner = Some(if self.skips { Scanner::open_any(&path)? } else { Scanner::open(&path)? });
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
    /// The file cannot be read. Damage is not an error: see [`RunReader::damage`].
    pub fn next_sample(&mut self) -> Result<Option<RecordedSample<'_>>, RunError> {
        // the message is returned by its parts and borrowed again after the loop, because a borrow of the scanner
        // cannot be returned from inside a loop that continues to use it
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
        self.begin_ns.get_or_insert(log_time_ns);
        let sample = self.scanner.as_ref().and_then(Scanner::last_data).unwrap_or_default();
        let sample = sample.strip_prefix(&CDR_HEADER).unwrap_or(sample);
        Ok(self.all.get(index).map(|channel| RecordedSample {
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
                self.define(ChannelDefinition {
                    id,
                    schema_id: channel.schema_id,
                    topic,
                    schema_name,
                    schema,
                    metadata,
                });
            }
            Record::Metadata(metadata) if metadata.name == RUN => {
                self.clock = RunClock::from_about(&metadata.metadata).or(self.clock);
                self.about = metadata.metadata;
            }
            Record::Metadata(metadata) if metadata.name == RUN_END => self.end.push(metadata.metadata),
            Record::Metadata(metadata) if metadata.name == RECOVERED => {
                self.recovered.push((self.path.clone(), metadata.metadata));
            }
            Record::Attachment { header, data, .. } if header.name.starts_with(CHANNELS_BEGINNING) => {
                for one in serde_json::from_slice::<Vec<ChannelDefinition>>(&data).unwrap_or_default() {
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

    fn define(&mut self, one: ChannelDefinition) {
        if self.channels.contains_key(&one.id) {
            return;
        }
        let id = one.id;
        let channel = RecordedChannel::new(one);
        let index = self.all.iter().position(|known| **known == channel).unwrap_or_else(|| {
            self.all.push(Arc::new(channel));
            self.all.len() - 1
        });
        self.channels.insert(id, index);
    }

    /// The channels read so far; all of them after the last sample.
    #[must_use]
    pub fn channels(&self) -> &[Arc<RecordedChannel>] {
        &self.all
    }

    /// The clock of the run, if its files contain one.
    #[must_use]
    pub fn clock(&self) -> Option<RunClock> {
        self.clock
    }

    /// UNIX time from which every output counts the seconds of the run, ns: `t0_unix_ns` of its first file, so that a
    /// file read alone has the same seconds as in its run. Without a clock it is the log time of the first sample;
    /// `None` before that.
    #[must_use]
    pub fn begin_ns(&self) -> Option<u64> {
        self.begin_ns
    }

    /// Metadata of the run: origin, content, versions.
    #[must_use]
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.about
    }

    /// Closing metadata of each finished file.
    #[must_use]
    pub fn ends(&self) -> &[BTreeMap<String, String>] {
        &self.end
    }

    /// Files attached to the run files.
    #[must_use]
    pub fn attachments(&self) -> &[Attachment] {
        &self.attachments
    }

    /// Unreadable places so far, with their files.
    #[must_use]
    pub fn damage(&self) -> &[(PathBuf, Damage)] {
        &self.damage
    }

    /// Samples so far whose channel has no definition.
    #[must_use]
    pub fn orphaned(&self) -> u64 {
        self.orphaned
    }

    /// Samples left out so far because an earlier file contained them.
    #[must_use]
    pub fn repeated(&self) -> u64 {
        self.repeats.as_ref().map_or(0, Duplicates::found)
    }

    /// Files read to their end: path, whether it was finished properly, bytes.
    #[must_use]
    pub fn files(&self) -> &[(PathBuf, bool, u64)] {
        &self.finished
    }

    /// Files so far that were made by a recovery, with its metadata.
    #[must_use]
    pub fn recovered(&self) -> &[(PathBuf, BTreeMap<String, String>)] {
        &self.recovered
    }

    /// Bytes of all files of the run.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Bytes read so far.
    #[must_use]
    pub fn position(&self) -> u64 {
        let finished: u64 = self.finished.iter().map(|(_, _, bytes)| bytes).sum();
        finished + self.scanner.as_ref().map_or(0, Scanner::position)
    }

    /// The current file.
    #[must_use]
    pub fn file(&self) -> &Path {
        &self.path
    }
}

/// The run metadata at the beginning of a file; `None` if there are none before the first message.
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

impl RunClock {
    /// The clock of a run: the one in its files if they were written since the last boot, else the one `set` for all
    /// processes of the run, else the current reading of both clocks.
    ///
    /// A restarted recorder continues with the clock of the first, whatever happened to the wall clock in the meantime.
    #[must_use]
    pub fn from_run(folder: &Path, set: Option<Self>) -> Self {
        let of_file = |file: &std::path::PathBuf| {
            let about = first_about(file)?;
            let same = about.get(BOOT_ID).is_some_and(|boot| !boot.is_empty() && *boot == boot_id());
            same.then(|| Self::from_about(&about)).flatten()
        };
        let files = segments(folder).unwrap_or_default();
        files.iter().find_map(of_file).or(set).unwrap_or_else(Self::now)
    }
}

/// All samples of one channel with their publication times (UNIX time, ns).
///
/// # Errors
/// The run cannot be read, or the channel has a type other than `T`.
pub fn read_channel<T: Message>(path: &Path, channel: &str) -> Result<Vec<(u64, T)>, RunError> {
    let mut reader = RunReader::open(path)?;
    let mut found = Vec::new();
    while let Some(recorded) = reader.next_sample()? {
        if recorded.channel.name != channel {
            continue;
        }
        match recorded.decode::<T>() {
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
