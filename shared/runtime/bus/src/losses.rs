//! Counts lost samples by the sequence numbers of each publisher.

/// Number of publishers tracked at once; with more, the oldest entry is replaced. Twice the largest number of
/// publishers of a channel.
const PUBLISHERS: usize = 16;

/// Counts samples that never arrived. The first sequence number of a new publisher is not a gap.
#[derive(Debug, Default)]
pub(crate) struct Losses {
    last: [(u128, u64); PUBLISHERS],
    next_slot: usize,
    pub(crate) lost: u64,
    pub(crate) gaps: u64,
}

impl Losses {
    /// Records sample `seq` (counted from 1) of `publisher`; returns the number of missing samples before it.
    pub(crate) fn record(&mut self, publisher: u128, seq: u64) -> u64 {
        if let Some((_, last)) = self.last.iter_mut().find(|(id, last)| *id == publisher && *last != 0) {
            let missing = seq.saturating_sub(*last).saturating_sub(1);
            *last = seq.max(*last);
            // Saturate: a publisher outside this project may send any numbers.
            self.lost = self.lost.saturating_add(missing);
            self.gaps = self.gaps.saturating_add(u64::from(missing > 0));
            return missing;
        }
        self.last[self.next_slot] = (publisher, seq);
        self.next_slot = (self.next_slot + 1) % PUBLISHERS;
        0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_a_loss_and_a_new_publisher_is_not() {
        let mut losses = Losses::default();
        for seq in [5, 6, 7] {
            assert_eq!(losses.record(1, seq), 0);
        }
        assert_eq!(losses.record(1, 11), 3);
        assert_eq!(losses.record(2, 900), 0, "another publisher starts at any number");
        assert_eq!(losses.record(1, 12), 0);
        assert_eq!(losses.record(1, 4), 0, "an older number is no loss");
        assert_eq!(losses.record(1, 13), 0);
        assert_eq!((losses.lost, losses.gaps), (3, 1));
    }

    #[test]
    fn arbitrary_numbers_do_not_overflow_the_count() {
        let mut losses = Losses::default();
        for publisher in 1..4 {
            losses.record(publisher, 1);
            losses.record(publisher, u64::MAX);
        }
        assert_eq!((losses.lost, losses.gaps), (u64::MAX, 3));
    }

    #[test]
    fn many_restarts_are_not_losses() {
        let mut losses = Losses::default();
        for publisher in 1..100 {
            for seq in 1..4 {
                losses.record(publisher, seq);
            }
        }
        assert_eq!(losses.lost, 0);
    }
}
