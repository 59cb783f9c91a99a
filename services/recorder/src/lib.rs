//! Records every channel, of known or unknown type, to the files of one run.
//!
//! [`Recorder`] finds the channels of a domain, subscribes to each without its type, and passes the received samples in
//! batches to a [`Session`], which manages the files: when to flush, when the disk is too full, when to begin the next
//! file.
//!
//! Invariants:
//! * It never slows a publisher: it copies from its own buffers, and only this process waits for the disk.
//! * It subscribes to the channels of the table before their publishers exist, so the first sample of a run is in the
//!   file.
//! * Every missing sample is counted per channel, and reported in `recorder/status` when it happens, in the file where
//!   it is missing (`recorder/gap`), and at the end of the file.
//! * Each file of a run can be read alone: it has every definition, the configuration, and the last sample of channels
//!   that publish rarely.
//! * The death of this process costs the time since the last flush, half a second by default; the file is readable up
//!   to there.
//! * It does not interpret the samples, except the faults and stops around which blobs are recorded, if not all are.

#![forbid(unsafe_code)]

mod around;
mod batch;
mod disk_full;
mod listen;
mod recorder;
mod recording;
mod row;
mod session;
mod settings;

pub use around::Around;
pub use batch::{Batch, ReceivedSample};
pub use disk_full::DiskFull;
pub use listen::Listening;
pub use recorder::{Recorder, RecorderError, recover_leftovers};
pub use row::Row;
pub use session::{ENDED_DISK_FULL, Session};
pub use settings::Settings;
