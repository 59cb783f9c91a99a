//! The interface of the file formats.

use super::table::Times;

/// Writes the rows of one table.
pub(super) trait Sink {
    fn row(&mut self, times: Times, sample: &[u8]) -> std::io::Result<()>;

    /// Bytes of rows that wait in memory for others.
    fn waiting_bytes(&self) -> usize {
        0
    }

    /// Writes the rows that wait.
    fn write_waiting(&mut self) -> std::io::Result<()> {
        Ok(())
    }

    fn finish(self: Box<Self>) -> std::io::Result<()>;
}
