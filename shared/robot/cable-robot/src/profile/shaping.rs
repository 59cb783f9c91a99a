//! Input shaping: a profile that leaves no swing at a period.

use super::{Knot, MAX_KNOTS, Profile};

/// Weights of the three copies of a profile, half a period apart: zero vibration and derivative (Singer and Seering
/// 1990). Of a swing of another period, cos²(pi f / 2) is left, where f is the ratio of the shaped period to it: at
/// most 0.15 within 20 %.
const WEIGHTS: [f64; 3] = [0.25, 0.5, 0.25];

/// Times closer than this are one knot, s.
const SAME_S: f64 = 1e-9;
/// Share of half a period that counts as rounding.
const ROUNDING: f64 = 1e-10;

impl Profile {
    /// Returns the profile convolved with three impulses half a period apart. It ends one period later at the same
    /// place, its speed and acceleration nowhere exceed the largest of this profile, and a swing of that period that
    /// its accelerations excite has ended with it. A profile shorter than half a period is slowed down to that first:
    /// otherwise the copies leave rests between them, which knots cannot express. None if it does not begin and end at
    /// rest, or if it would have more than [`MAX_KNOTS`] knots.
    ///
    /// ```
    /// use cable_robot::{Path, Profile, Vector3, profile::ProfileLimits};
    /// let path = Path::line(Vector3::zeros(), Vector3::new(2.0, 0.0, 0.0));
    /// let plain = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.4, 0.4))?;
    /// let shaped = plain.shaped(0.8).unwrap();
    /// assert!((shaped.duration() - plain.duration() - 0.8).abs() < 1e-9);
    /// assert!((shaped.at(0.1).a_m_s2 - 0.1).abs() < 1e-9, "a quarter of the acceleration first");
    /// # Ok::<(), cable_robot::profile::ProfileError>(())
    /// ```
    pub fn shaped(&self, period_s: f64) -> Option<Self> {
        let knots = self.knots();
        let at_rest = |knot: Option<&Knot>| knot.is_some_and(|knot| knot.v_m_s == 0.0);
        if knots.len() < 2 || !at_rest(knots.first()) || !at_rest(knots.last()) || !(period_s > 0.0) {
            return None;
        }
        let slower = self.duration() / delay_s(1, period_s);
        if slower < 1.0 - ROUNDING {
            let mut slow = [Knot::default(); MAX_KNOTS];
            for (slow, knot) in slow.iter_mut().zip(knots) {
                *slow = Knot { v_m_s: knot.v_m_s * slower, ..*knot };
            }
            return Self::from_knots(&slow[..knots.len()]).ok()?.shaped(period_s);
        }
        let mut times = [0.0; WEIGHTS.len() * MAX_KNOTS];
        let mut count = 0;
        for copy in 0..WEIGHTS.len() {
            for time_s in &self.times[..self.count] {
                times[count] = time_s + delay_s(copy, period_s);
                count += 1;
            }
        }
        times[..count].sort_by(f64::total_cmp);
        let mut shaped = [Knot::default(); MAX_KNOTS];
        let mut used = 0;
        let mut before_s = f64::NEG_INFINITY;
        for time_s in &times[..count] {
            if time_s - before_s < SAME_S {
                continue;
            }
            *shaped.get_mut(used)? = self.mean_of_copies(*time_s, period_s);
            (used, before_s) = (used + 1, *time_s);
        }
        // Rounding must not move the ends.
        shaped[0] = Knot::default();
        shaped[used - 1] = Knot { s_m: self.length(), v_m_s: 0.0 };
        Self::from_knots(&shaped[..used]).ok()
    }

    fn mean_of_copies(&self, time_s: f64, period_s: f64) -> Knot {
        let mut knot = Knot::default();
        for (copy, weight) in WEIGHTS.iter().enumerate() {
            let at = self.at(time_s - delay_s(copy, period_s));
            knot.s_m += weight * at.s_m;
            knot.v_m_s += weight * at.v_m_s;
        }
        knot
    }
}

fn delay_s(copy: usize, period_s: f64) -> f64 {
    0.5 * period_s * copy as f64
}
