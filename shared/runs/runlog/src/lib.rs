//! Run files: write, recover, read.
//!
//! A run is a folder; the samples of every channel stand in it in one or more MCAP files, each readable on its own by any tool that knows
//! MCAP and ROS 2 definitions. This is the only crate that names the `mcap` crate.
//!
//! Invariants:
//! * A sample is written as it lay in memory, behind the four bytes that say "CDR, little endian". A definition that would make some
//!   reader fail or misread is never written; the channel is recorded as plain bytes instead, with the original text beside it.
//! * While it grows, a file is named `NAME.mcap.part`, is locked, and ends at a chunk boundary after every [`RunWriter::flush`]. Only a
//!   finished and synchronised file is named `NAME.mcap`.
//! * One offset maps CLOCK_MONOTONIC to UNIX time for a whole run ([`RunClock`]): a step of the wall clock bends nothing, and neither does
//!   a recorder that is started again.
//! * The files of a run folder are read as one run. Each can also be read alone.
//! * What describes the channels stands in the file twice, in the chunks and as attachments, so that no single damaged byte makes the
//!   rest unreadable.
//!
//! ```
//! # let folder = tempfile::tempdir()?;
//! use messages::{Message, TruthNode};
//! use runlog::{ChannelSpec, RunClock, RunReader, RunWriter};
//!
//! let path = folder.path().join("run.mcap");
//! let mut writer = RunWriter::create(&path, RunClock::now(), &Default::default(), &[])?;
//! let channel = writer.add_channel(&ChannelSpec::of::<TruthNode>("truth/node"))?;
//! let mut sample = TruthNode::default();
//! sample.header_mut().stamp_ns = 1_000;
//! writer.write(channel, 1, 1_000, 1_000, bytemuck::bytes_of(&sample))?;
//! writer.finish(&Default::default())?;
//!
//! let mut reader = RunReader::open(&path)?;
//! while let Some(recorded) = reader.next_sample()? {
//!     assert_eq!(recorded.channel.name, "truth/node");
//!     assert_eq!(recorded.to::<TruthNode>(), Some(sample));
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
mod read;
mod recover;
mod scan;
mod sequence;
mod sync;
mod write;

pub use attachments::{KEPT_ENDINGS, KEPT_FOLDERS, kept_files};
pub use clock::{RunClock, published_ns, utc};
pub use conversion::Conversion;
pub use definition::{ChannelSpec, Definition, Definitions, Refusal};
pub use error::{NoRun, RunError};
pub use finding::{Finding, Lack};
pub use folder::{FILE_ENDING, PART_ENDING, free_bytes, next_file, segments};
pub use info::{ChannelReport, FileReport, GapReport, Inspection, RunReport, cause_phrase, info, info_with};
pub use read::{Recorded, RecordedChannel, RunReader, read_channel};
pub use recover::{Recovery, recover};
pub use scan::Damage;
pub use sequence::Sequence;
pub use sync::SyncReport;
pub use write::{Attachment, CDR_HEADER, ChannelId, RunWriter};
