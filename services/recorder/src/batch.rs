//! What was heard since the last look, in the order in which it was published.

/// One sample without its bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Heard {
    /// The channel, as [`crate::Session::declare`] numbered it.
    pub row: usize,
    /// When it was published, CLOCK_MONOTONIC, ns: what the file is sorted by.
    pub logged_ns: u64,
    /// When its content was true, CLOCK_MONOTONIC, ns.
    pub stamp_ns: u64,
    /// Its number.
    pub seq: u64,
    /// Samples of the same publisher missing before it.
    pub missing: u64,
}

/// Samples of many channels; keeps its memory from one use to the next.
#[derive(Debug, Default)]
pub struct Batch {
    entries: Vec<(Heard, usize, usize)>,
    bytes: Vec<u8>,
}

impl Batch {
    /// Adds a sample.
    pub fn push(&mut self, heard: Heard, sample: &[u8]) {
        let begin = self.bytes.len();
        self.bytes.extend_from_slice(sample);
        self.entries.push((heard, begin, self.bytes.len()));
    }

    /// Bytes of all samples.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.bytes.len()
    }

    /// Whether there is nothing.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Brings the samples into the order of their publication; equal ones stay as they came.
    pub fn sort(&mut self) {
        self.entries.sort_by_key(|(heard, _, _)| heard.logged_ns);
    }

    /// The samples.
    pub fn iter(&self) -> impl Iterator<Item = (&Heard, &[u8])> {
        self.entries.iter().map(|(heard, begin, end)| (heard, &self.bytes[*begin..*end]))
    }

    /// Forgets the samples and gives back what a burst has taken beyond `keep` bytes.
    pub fn clear(&mut self, keep: usize) {
        self.entries.clear();
        self.bytes.clear();
        self.bytes.shrink_to(keep);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_come_out_in_the_order_of_their_publication() {
        let mut batch = Batch::default();
        for (row, logged_ns) in [(0, 30), (0, 40), (1, 10), (2, 30)] {
            let heard = Heard { row, logged_ns, stamp_ns: 0, seq: 0, missing: 0 };
            batch.push(heard, &[row as u8; 3]);
        }
        batch.sort();
        let order: Vec<_> = batch.iter().map(|(heard, sample)| (heard.logged_ns, heard.row, sample[0])).collect();
        assert_eq!(order, [(10, 1, 1), (30, 0, 0), (30, 2, 2), (40, 0, 0)]);
        assert_eq!(batch.bytes(), 12);
        batch.clear(0);
        assert!(batch.is_empty());
    }
}
