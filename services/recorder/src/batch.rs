//! The samples received since the last poll, in the order of their publication.

/// A received sample without its bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReceivedSample {
    /// Index of its channel, from [`crate::Session::declare`].
    pub row: usize,
    /// Time of its publication, CLOCK_MONOTONIC, ns; the file is sorted by it.
    pub logged_ns: u64,
    /// Time of its content, CLOCK_MONOTONIC, ns.
    pub stamp_ns: u64,
    /// Sequence number.
    pub seq: u64,
    /// Number of missing samples of the same publisher before it.
    pub missing: u64,
}

/// Samples of many channels; reuses its memory.
#[derive(Debug, Default)]
pub struct Batch {
    entries: Vec<(ReceivedSample, usize, usize)>,
    bytes: Vec<u8>,
}

impl Batch {
    /// Adds a sample.
    pub fn push(&mut self, received: ReceivedSample, sample: &[u8]) {
        let begin = self.bytes.len();
        self.bytes.extend_from_slice(sample);
        self.entries.push((received, begin, self.bytes.len()));
    }

    /// Returns the size of all samples, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.bytes.len()
    }

    /// Returns whether the batch has no samples.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Sorts the samples by the time of their publication; the sort is stable.
    pub fn sort(&mut self) {
        self.entries.sort_by_key(|(received, _, _)| received.logged_ns);
    }

    /// Iterates over the samples and their bytes.
    pub fn iter(&self) -> impl Iterator<Item = (&ReceivedSample, &[u8])> {
        self.entries.iter().map(|(received, begin, end)| (received, &self.bytes[*begin..*end]))
    }

    /// Removes the samples, and frees memory in excess of `keep` bytes.
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
            let received = ReceivedSample { row, logged_ns, stamp_ns: 0, seq: 0, missing: 0 };
            batch.push(received, &[row as u8; 3]);
        }
        batch.sort();
        let order: Vec<_> =
            batch.iter().map(|(received, sample)| (received.logged_ns, received.row, sample[0])).collect();
        assert_eq!(order, [(10, 1, 1), (30, 0, 0), (30, 2, 2), (40, 0, 0)]);
        assert_eq!(batch.bytes(), 12);
        batch.clear(0);
        assert!(batch.is_empty());
    }
}
