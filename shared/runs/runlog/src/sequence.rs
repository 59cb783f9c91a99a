//! Counts losses by sequence number where samples do not identify their publisher.

/// Publishers that may alternate on one channel; the channel table allows no more.
const STREAMS: usize = 8;

/// Counts the missing samples of one channel.
///
/// Every publisher numbers its samples independently. A sample continues the publisher whose last number is nearest
/// below its own; a number below all of them is a new publisher. With one publisher the count is exact. With several
/// that restart and lose samples at the same time, a loss can be attributed to the wrong publisher.
#[derive(Debug, Clone, Default)]
pub struct Sequence {
    last: [u64; STREAMS],
    /// When each publisher was last received, in samples of the channel.
    heard: [u64; STREAMS],
    known: usize,
    samples: u64,
    /// Missing samples.
    pub lost: u64,
    /// Number of gaps.
    pub gaps: u64,
}

impl Sequence {
    /// Processes the next number and returns how many are missing before it.
    pub fn observe(&mut self, seq: u64) -> u64 {
        self.samples += 1;
        let continued = (0..self.known).filter(|slot| self.last[*slot] < seq).max_by_key(|slot| self.last[*slot]);
        let slot = continued.unwrap_or_else(|| self.room());
        let missing = continued.map_or(0, |slot| seq - self.last[slot] - 1);
        (self.last[slot], self.heard[slot]) = (seq, self.samples);
        if missing > 0 {
            self.lost += missing;
            self.gaps += 1;
        }
        missing
    }

    /// The slot of a new publisher: a free one, or that of the publisher silent for longest, which has most likely
    /// ended.
    fn room(&mut self) -> usize {
        if self.known < STREAMS {
            self.known += 1;
            return self.known - 1;
        }
        (0..STREAMS).min_by_key(|slot| self.heard[*slot]).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(numbers: &[u64]) -> (u64, u64) {
        let mut sequence = Sequence::default();
        for number in numbers {
            sequence.observe(*number);
        }
        (sequence.lost, sequence.gaps)
    }

    #[test]
    fn losses_are_counted_and_new_publishers_are_not_losses() {
        assert_eq!(count(&[1, 2, 3]), (0, 0));
        assert_eq!(count(&[7, 8, 11, 12, 14]), (3, 2));
        assert_eq!(count(&[1, 2, 3, 1, 2, 3]), (0, 0), "the publisher restarted");
        assert_eq!(count(&[5, 6, 1, 7, 2, 8, 3]), (0, 0), "two publishers alternate");
        assert_eq!(count(&[100, 101, 1, 102, 2, 105]), (2, 1));
        assert!(count(&[9, 8, 7, 6, 5, 4, 3, 2, 1, 10]).0 <= 1, "more publishers than slots: the oldest is forgotten");
    }

    /// `operator/request`: each answering process numbers its own samples, and a restarted one begins at 1.
    #[test]
    fn a_process_that_answers_is_not_forgotten_for_others_that_are_started_again() {
        let lives = (0..50).flat_map(|life| [1, 2, 2 * life + 101, 2 * life + 102]);
        let numbers: Vec<u64> = (1..=100).chain(lives).collect();
        assert_eq!(count(&numbers), (0, 0));
    }
}
