//! Average deviation of a controller from the one in charge, compared with the commanded speed.
//!
//! Two good laws differ briefly, where the motion changes. A law that answers zeros, or has an offset on one cable,
//! differs all the time, by an amount that may be small compared with the speed limit but not with the commanded speed.

use crate::limits::largest;
use messages::CABLES;

/// Averages of the difference and of the commanded speed over the last cycles.
#[derive(Debug, Clone, Copy, Default)]
pub struct Bias {
    difference_m_s: [f64; CABLES],
    pace_m_s: f64,
}

impl Bias {
    /// Adds a cycle in which both answered. `share`: weight of the newest cycle, 0 to 1.
    pub fn add(&mut self, lead_m_s: &[f64; CABLES], side_m_s: &[f64; CABLES], share: f64) {
        debug_assert!((0.0..=1.0).contains(&share), "the newest cycle counts as {share} of the average");
        for (mean, (lead, side)) in self.difference_m_s.iter_mut().zip(lead_m_s.iter().zip(side_m_s)) {
            *mean += share * (side - lead - *mean);
        }
        self.pace_m_s += share * (largest(lead_m_s) - self.pace_m_s);
    }

    /// Average difference per cable, m/s.
    #[must_use]
    pub fn difference_m_s(&self) -> &[f64; CABLES] {
        &self.difference_m_s
    }

    /// Largest average difference as a share of what is allowed: `share` of the commanded speed, at least `least_m_s`.
    #[must_use]
    pub fn relative(&self, share: f64, least_m_s: f64) -> f64 {
        largest(&self.difference_m_s) / (share * self.pace_m_s).max(least_m_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(lead: f64, side: f64) -> f64 {
        let mut bias = Bias::default();
        for _ in 0..300 {
            bias.add(&[lead; CABLES], &[side; CABLES], 0.03);
        }
        bias.relative(0.25, 0.05)
    }

    #[test]
    fn a_law_that_answers_zeros_or_is_biased_exceeds_the_accepted_deviation() {
        assert!(after(0.11, 0.0) > 1.0, "zeros beside a slow motion, far below a bound of 0.12 m/s");
        assert!(after(0.05, 0.15) > 1.0, "a bias of 0.1 m/s on one line");
        assert!(after(0.4, 0.48) < 1.0, "a fifth of what is being commanded");
        assert!(after(0.0, 0.0) < 1e-9);
    }

    #[test]
    fn a_short_difference_is_not_a_bias() {
        let mut bias = Bias::default();
        for cycle in 0..300 {
            let side = if cycle % 100 < 20 { 0.16 } else { 0.1 };
            bias.add(&[0.1; CABLES], &[side; CABLES], 0.03);
        }
        assert!(bias.relative(0.25, 0.05) < 1.0);
    }
}
