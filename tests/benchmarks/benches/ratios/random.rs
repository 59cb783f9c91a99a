//! Random numbers for problems that are the same in every run.

/// Numbers between 0 and 1 that are the same in every run: a linear congruential generator (Knuth's MMIX constants).
pub struct Random(pub u64);

impl Random {
    /// The next number.
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}
