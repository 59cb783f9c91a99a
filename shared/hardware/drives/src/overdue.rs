//! Readings that wait for time that no cycle leaves.

/// Cycles in a row that leave a reading out before it is taken all the same: the status of a unit, which may have a
/// stop button, is then read four times in a second of a hundred cycles, and at most every 25th cycle comes late.
const MOST_LEFT_OUT: u32 = 24;

/// Cycles in a row that had no time for readings that can wait.
#[derive(Debug, Clone, Copy, Default)]
pub struct Overdue(u32);

impl Overdue {
    /// True where the readings of this cycle are to be taken: they fit, or have been left out too often.
    pub fn is_due(&mut self, fits: bool) -> bool {
        let due = fits || self.0 >= MOST_LEFT_OUT;
        self.0 = if due { 0 } else { self.0 + 1 };
        due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_never_fits_is_read_in_every_25th_cycle() {
        let mut overdue = Overdue::default();
        let read: Vec<usize> = (1..=60).filter(|_| overdue.is_due(false)).collect();
        assert_eq!(read, [25, 50]);
        assert!(overdue.is_due(true));
        assert!((0..24).all(|_| !overdue.is_due(false)), "it counts from the last reading");
    }
}
