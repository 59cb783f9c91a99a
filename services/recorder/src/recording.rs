//! One file of a run while it is being written.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use runlog::{Attachment, ChannelId, RunError, RunWriter, SyncReport};

/// A file that grows, and when it is to end.
pub(crate) struct Recording {
    pub(crate) writer: RunWriter,
    pub(crate) gaps: Option<ChannelId>,
    pub(crate) begun_ns: u64,
    pub(crate) split_ns: u64,
    settled: u64,
    /// Names of the files of the run folder that are in it.
    kept: BTreeSet<String>,
    spell: Spell,
}

impl Recording {
    /// `present`: the files that it begins with.
    pub(crate) fn new(writer: RunWriter, begun_ns: u64, split_ns: u64, present: &[Attachment]) -> Self {
        let kept = present.iter().map(|file| file.name.clone()).collect();
        let settled = writer.settled();
        Self { writer, gaps: None, begun_ns, split_ns, settled, kept, spell: Spell::default() }
    }

    /// Hands all that was written to the system; nothing else of it is unsettled then.
    pub(crate) fn flush(&mut self) -> Result<(), RunError> {
        self.writer.flush()?;
        self.has_settled();
        Ok(())
    }

    /// Whether all that was written has come into the file whole since this was asked last.
    pub(crate) fn has_settled(&mut self) -> bool {
        let before = std::mem::replace(&mut self.settled, self.writer.settled());
        before != self.settled
    }

    /// Says when the disk ceases to keep what it is given, and when it keeps it again.
    pub(crate) fn look_at_disk(&mut self) {
        let file = self.writer.path().display();
        match self.spell.change(&self.writer.sync_report()) {
            Some(true) => tracing::error!(
                "{file}: THE DISK DOES NOT CONFIRM that it keeps what is written (fdatasync fails): a power cut may cost more than two seconds, and the disk may be failing"
            ),
            Some(false) => tracing::warn!("{file}: the disk keeps what is written again"),
            None => {}
        }
    }

    /// Takes in those of the `present` files of the run folder that came while this one was written, and finishes it.
    pub(crate) fn finish(
        mut self,
        present: &[Attachment],
        summary: &BTreeMap<String, String>,
    ) -> Result<PathBuf, RunError> {
        for file in present.iter().filter(|file| !self.kept.contains(&file.name)) {
            self.writer.attach(file)?;
        }
        self.writer.finish(summary)
    }
}

/// Whether a disk refuses, told once per spell.
#[derive(Debug, Default)]
struct Spell {
    failing: bool,
}

impl Spell {
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
    fn a_disk_that_refuses_is_named_once_per_spell() {
        let mut spell = Spell::default();
        let told: Vec<_> = [false, true, true, false, false, true]
            .into_iter()
            .map(|failing| spell.change(&SyncReport { failing, ..SyncReport::default() }))
            .collect();
        assert_eq!(told, [None, Some(true), None, Some(false), None, Some(true)]);
    }
}
