//! The interface of the file formats.

use super::table::Times;

/// Writes the rows of one table.
pub(super) trait Sink {
    fn row(&mut self, times: Times, sample: &[u8]) -> std::io::Result<()>;
    fn finish(self: Box<Self>) -> std::io::Result<()>;
}
