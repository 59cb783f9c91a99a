//! Every channel, known or not, to the files of one run.
//!
//! [`Recorder`] finds the channels of a domain, listens to each without knowing its type, and hands what it hears in batches to a [`Session`],
//! which decides about files: when to flush, when the disk is too full, when to begin another file.
//!
//! Invariants:
//! * It never slows a publisher: it takes copies from its own buffers, and only this process waits for the disk.
//! * It listens to the channels of the table before their publishers exist, so that the first sample of a run is in the file.
//! * Whatever is missing in the file is counted, per channel, and said in `recorder/status` while it happens, in the file at the place where
//!   it is missing (`recorder/gap`), and at its end.
//! * Each file of a run can be read alone: it has every definition, the configuration, and the last word of channels that rarely speak.
//! * The death of this process costs the time since the last flush, half a second by default; the file is readable up to there.
//! * It knows nothing of what the samples mean.

#![forbid(unsafe_code)]

mod batch;
mod listen;
mod recorder;
mod recording;
mod row;
mod session;

pub use batch::{Batch, Heard};
pub use listen::{Listening, listen_to_known};
pub use recorder::{Recorder, RecorderError, recover_leftovers};
pub use row::Row;
pub use session::{DiskFull, ENDED_DISK_FULL, Session, Settings};
