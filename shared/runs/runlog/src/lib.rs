//! Run files: write, recover, read.
//!
//! A run is a folder. The samples of all channels are in one or more MCAP files in it, and any tool that reads MCAP and
//! ROS 2 definitions can read each file alone. This is the only crate that uses the `mcap` crate.
//!
//! Invariants:
//! * A sample is written as it is in memory, after the four bytes that mean "CDR, little endian". A definition that
//!   some reader would reject or misread is never written; the channel is recorded as plain bytes instead, and the
//!   original text is kept in the channel's metadata.
//! * A growing file is named `NAME.mcap.part`, is locked, and ends at a chunk boundary after every
//!   [`RunWriter::flush`]. Only a finished and synchronised file is named `NAME.mcap`.
//! * One offset maps CLOCK_MONOTONIC to UNIX time for a whole run ([`RunClock`]), so neither a step of the wall clock
//!   nor a restarted recorder distorts the time axis.
//! * The files of a run folder are read as one run. Each can also be read alone.
//! * The channel definitions are in the file twice, in the chunks and as attachments, so that no single damaged byte
//!   makes the rest unreadable.
//!
//! ```
//! # let folder = tempfile::tempdir()?;
//! use messages::{Message, TruthNode};
//! use runlog::{ChannelSpec, RunClock, RunReader, RunWriter};
//!
//! let path = folder.path().join("run.mcap");
//! let mut writer = RunWriter::create(&path, RunClock::now(), &Default::default(), &[])?;
//! let channel = writer.add_channel(&ChannelSpec::for_type::<TruthNode>("truth/node"))?;
//! let mut sample = TruthNode::default();
//! sample.header_mut().stamp_ns = 1_000;
//! writer.write(channel, 1, 1_000, 1_000, bytemuck::bytes_of(&sample))?;
//! writer.finish(&Default::default())?;
//!
//! let mut reader = RunReader::open(&path)?;
//! while let Some(recorded) = reader.next_sample()? {
//!     assert_eq!(recorded.channel.name, "truth/node");
//!     assert_eq!(recorded.decode::<TruthNode>(), Some(sample));
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![forbid(unsafe_code)]

mod attachments;
mod clock;
mod conversion;
mod dedup;
mod definition;
mod error;
pub mod export;
mod finding;
mod folder;
mod info;
mod instant;
mod read;
mod recover;
mod scan;
mod sequence;
mod sync;
mod write;

pub use attachments::{
    ATTACHED_ENDINGS, ATTACHED_FOLDERS, SYSTEM_FILE, is_system_file, run_attachments, system_file_text,
};
pub use clock::{RunClock, published_ns, seconds_since, unix_ns, utc};
pub use conversion::Conversion;
pub use definition::{ChannelSpec, Definition, Definitions, SchemaRefusal};
pub use error::{NotARunReason, RunError};
pub use finding::{Finding, MissingData};
pub use folder::{FILE_ENDING, PART_ENDING, free_bytes, next_file, segments};
pub use info::{ChannelReport, FileReport, GapReport, RunInspection, RunReport, cause_phrase, info, info_with};
pub use instant::{Instant, KeptSample, RECENT};
pub use read::{RecordedChannel, RecordedSample, RunReader, read_channel};
pub use recover::{Recovery, recover, recover_leaving};
pub use scan::Damage;
pub use sequence::Sequence;
pub use sync::SyncReport;
pub use write::{Attachment, CDR_HEADER, ChannelId, RunWriter};
