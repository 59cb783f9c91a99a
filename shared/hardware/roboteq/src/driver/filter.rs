//! Values that no checksum protects: which of several readings to use.

/// A value that is used once it was read twice in a row.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Steady<V>(Option<V>);

impl<V: Copy + PartialEq> Steady<V> {
    /// Records a reading; returns it where the one before was the same.
    pub(super) fn read(&mut self, value: V) -> Option<V> {
        (self.0.replace(value) == Some(value)).then_some(value)
    }
}

/// The middle one of the last three readings, which a single wrong one cannot become unless it is between the others.
#[derive(Debug, Clone, Copy)]
pub(super) struct Middle<const N: usize> {
    last: [[i32; N]; 3],
    /// Time of each, ns.
    at_ns: [u64; 3],
    count: usize,
}

impl<const N: usize> Default for Middle<N> {
    fn default() -> Self {
        Self { last: [[0; N]; 3], at_ns: [0; 3], count: 0 }
    }
}

impl<const N: usize> Middle<N> {
    /// Records a reading; returns the middle of the last three, with the time of the oldest of them.
    pub(super) fn read(&mut self, value: [i32; N], at_ns: u64) -> Option<([i32; N], u64)> {
        self.last.rotate_left(1);
        self.at_ns.rotate_left(1);
        (self.last[2], self.at_ns[2]) = (value, at_ns);
        self.count = (self.count + 1).min(3);
        let [one, two, three] = self.last;
        let middles = std::array::from_fn(|index| middle(one[index], two[index], three[index]));
        (self.count == 3).then_some((middles, self.at_ns[0]))
    }
}

/// The middle one of three.
pub(super) fn middle<V: Ord + Copy>(one: V, two: V, three: V) -> V {
    one.min(two).max(one.max(two).min(three))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_wrong_reading_of_three_is_not_used() {
        for (three, wanted) in [([1, 2, 3], 2), ([3, 1, 2], 2), ([900, 10, 12], 12), ([10, -900, 12], 10), ([7; 3], 7)]
        {
            assert_eq!(middle(three[0], three[1], three[2]), wanted);
            let mut readings = Middle::default();
            assert_eq!((readings.read([three[0]], 5), readings.read([three[1]], 6)), (None, None));
            assert_eq!(readings.read([three[2]], 7), Some(([wanted], 5)));
        }
        let mut flags = Steady::default();
        let read: Vec<_> = [0, 0, 16, 0, 16, 16].into_iter().map(|value| flags.read(value)).collect();
        assert_eq!(read, [None, Some(0), None, None, None, Some(16)]);
    }
}
