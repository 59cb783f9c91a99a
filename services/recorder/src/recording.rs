//! One file of a run while it is being written.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use runlog::{Attachment, ChannelId, RunError, RunWriter, SyncReport};

/// The file being written, and the time when it ends.
pub(crate) struct Recording {
    pub(crate) writer: RunWriter,
    pub(crate) gaps: Option<ChannelId>,
    pub(crate) begun_ns: u64,
    pub(crate) split_ns: u64,
    settled: u64,
    /// Names of the files of the run folder that are attached.
    attached: BTreeSet<String>,
    sync_monitor: SyncMonitor,
}

impl Recording {
    /// `present`: the files attached at its start.
    pub(crate) fn new(writer: RunWriter, begun_ns: u64, split_ns: u64, present: &[Attachment]) -> Self {
        let attached = present.iter().map(|file| file.name.clone()).collect();
        let settled = writer.settled();
        Self { writer, gaps: None, begun_ns, split_ns, settled, attached, sync_monitor: SyncMonitor::default() }
    }

    /// Writes all buffered samples to the operating system; afterwards all samples are settled.
    pub(crate) fn flush(&mut self) -> Result<(), RunError> {
        self.writer.flush()?;
        self.has_settled();
        Ok(())
    }

    /// Returns whether all written samples have become part of complete chunks in the file since the last call.
    pub(crate) fn has_settled(&mut self) -> bool {
        let before = std::mem::replace(&mut self.settled, self.writer.settled());
        before != self.settled
    }

    /// Reports when the disk starts to fail to sync, and when it recovers.
    pub(crate) fn report_sync(&mut self) {
        let file = self.writer.path().display();
        match self.sync_monitor.change(&self.writer.sync_report()) {
            Some(true) => tracing::error!(
                "{file}: THE DISK DOES NOT CONFIRM WRITES (fdatasync fails): a power cut may cost more than two seconds, and the disk may be failing"
            ),
            Some(false) => tracing::warn!("{file}: the disk confirms writes again"),
            None => {}
        }
    }

    /// Attaches those of the `present` files of the run folder that were created since the start, and finishes the
    /// file.
    pub(crate) fn finish(
        mut self,
        present: &[Attachment],
        summary: &BTreeMap<String, String>,
    ) -> Result<PathBuf, RunError> {
        for file in present.iter().filter(|file| !self.attached.contains(&file.name)) {
            self.writer.attach(file)?;
        }
        self.writer.finish(summary)
    }
}

/// Detects changes of the disk-sync state.
#[derive(Debug, Default)]
struct SyncMonitor {
    failing: bool,
}

impl SyncMonitor {
    fn change(&mut self, report: &SyncReport) -> Option<bool> {
        (report.failing != self.failing).then(|| {
            self.failing = report.failing;
            self.failing
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_of_the_disk_is_reported_once() {
        let mut sync_monitor = SyncMonitor::default();
        let changes: Vec<_> = [false, true, true, false, false, true]
            .into_iter()
            .map(|failing| sync_monitor.change(&SyncReport { failing, ..SyncReport::default() }))
            .collect();
        assert_eq!(changes, [None, Some(true), None, Some(false), None, Some(true)]);
    }
}
