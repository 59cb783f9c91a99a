//! Kalman filter for length and velocity of one cable, from its encoder and the commands of its drive.
//!
//! The state is `[l, v]`. The drive approaches its command u with a time constant τ (its delay and its lag together);
//! over a time t: v' = u + (v - u) e^(-t/τ), l' = l + u t + (v - u) τ (1 - e^(-t/τ)). Effects outside this model (the
//! pure delay, other drives, stretch of the belt) are an unknown acceleration, constant over the step, with the
//! standard deviation σ_a. A reading has the standard deviation σ_l.
//!
//! A reading farther than [`GATE`] standard deviations from its prediction is rejected. After [`RESTART_AFTER`]
//! rejected readings in a row the filter accepts the new length and restarts with the last of them.

use thiserror::Error;

/// Number of standard deviations beyond which a reading is rejected: one correct reading in two million.
pub const GATE: f64 = 5.0;

/// Number of consecutive rejected readings after which the filter restarts.
pub const RESTART_AFTER: u32 = 3;

/// Standard deviation of the unknown initial velocity, m/s: cables move at up to walking pace.
const START_SIGMA_M_S: f64 = 0.5;

/// Longest prediction step, s; longer ones count as this. After a second without a reading the filter
/// has lost the state.
const LONGEST_S: f64 = 1.0;

/// Error: a parameter out of range.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("{what} is {value}; accepted: {accepted}")]
pub struct FilterError {
    /// Name of the parameter.
    pub what: &'static str,
    /// Value of the parameter.
    pub value: f64,
    /// Accepted values.
    pub accepted: &'static str,
}

/// Model of drive and encoder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilterSettings {
    lag_s: f64,
    acceleration_sigma_m_s2: f64,
    reading_sigma_m: f64,
}

impl FilterSettings {
    /// Builds the model from τ, s; σ_a, m/s²; σ_l, m.
    ///
    /// # Errors
    /// A value that is not finite or out of range.
    pub fn new(lag_s: f64, acceleration_sigma_m_s2: f64, reading_sigma_m: f64) -> Result<Self, FilterError> {
        let within = |what, value: f64, [low, high]: [f64; 2], accepted| {
            if (low..=high).contains(&value) { Ok(()) } else { Err(FilterError { what, value, accepted }) }
        };
        within("the drives' lag", lag_s, [0.001, 1.0], "0.001 to 1 s")?;
        within("the unknown acceleration", acceleration_sigma_m_s2, [0.001, 100.0], "0.001 to 100 m/s²")?;
        within("the deviation of a reading", reading_sigma_m, [1e-6, 0.1], "0.000001 to 0.1 m")?;
        Ok(Self { lag_s, acceleration_sigma_m_s2, reading_sigma_m })
    }
}

/// How the filter used a reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The reading was used.
    Taken,
    /// The reading does not fit and was rejected.
    Refused,
    /// The reading does not fit, and the filter restarted with it.
    BegunAnew,
}

/// The filter of one cable.
///
/// ```
/// use cable_control::length_filter::{FilterSettings, LengthFilter, Verdict};
/// let mut filter = LengthFilter::new(FilterSettings::new(0.07, 0.5, 1e-4)?, 5.0);
/// for cycle in 1..=100 {
///     filter.predict(0.1, 0.01); // the drive was commanded 0.1 m/s for 10 ms
///     filter.read(5.0 + 0.001 * f64::from(cycle));
/// }
/// assert!((filter.length_m() - 5.1).abs() < 1e-4 && (filter.velocity_m_s() - 0.1).abs() < 1e-3);
/// assert_eq!(filter.read(9.0), Verdict::Refused);
/// # Ok::<(), cable_control::length_filter::FilterError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LengthFilter {
    settings: FilterSettings,
    length_m: f64,
    velocity_m_s: f64,
    /// Covariance: of the length, m²; of length and velocity, m²/s; of the velocity, m²/s².
    p: [f64; 3],
    refused: u32,
}

impl LengthFilter {
    /// Starts with a reading, m, and unknown velocity.
    pub fn new(settings: FilterSettings, reading_m: f64) -> Self {
        let sigma = settings.reading_sigma_m;
        let p = [sigma * sigma, 0.0, START_SIGMA_M_S * START_SIGMA_M_S];
        Self { settings, length_m: reading_m, velocity_m_s: 0.0, p, refused: 0 }
    }

    /// Starts with a reading, m, at rest.
    pub fn at_rest(settings: FilterSettings, reading_m: f64) -> Self {
        let sigma = settings.reading_sigma_m;
        Self { p: [sigma * sigma, 0.0, 1e-6], ..Self::new(settings, reading_m) }
    }

    /// Continues from the present state with other settings.
    pub fn retune(&mut self, settings: FilterSettings) {
        self.settings = settings;
    }

    /// Predicts the state after `seconds` with the drive command `command_m_s`. A negative time (to an instant just
    /// before the reading) moves the length back along the present velocity.
    pub fn predict(&mut self, command_m_s: f64, seconds: f64) {
        if !(command_m_s.is_finite() && seconds.is_finite()) {
            return;
        }
        let t = seconds.clamp(-LONGEST_S, LONGEST_S);
        let [ll, lv, vv] = self.p;
        if t < 0.0 {
            self.length_m += self.velocity_m_s * t;
            self.p = [ll + 2.0 * t * lv + t * t * vv, lv + t * vv, vv];
            return;
        }
        let tau = self.settings.lag_s;
        let keep = libm::exp(-t / tau);
        let reach = tau * (1.0 - keep);
        let gap = self.velocity_m_s - command_m_s;
        self.length_m += command_m_s * t + gap * reach;
        self.velocity_m_s = command_m_s + gap * keep;
        // F P Fᵀ + Q with F = [1, reach; 0, keep].
        let q = self.settings.acceleration_sigma_m_s2 * self.settings.acceleration_sigma_m_s2;
        let (t2, half) = (t * t, 0.5 * t * t);
        self.p = [
            ll + 2.0 * reach * lv + reach * reach * vv + q * half * half,
            keep * (lv + reach * vv) + q * half * t,
            keep * keep * vv + q * t2,
        ];
    }

    /// Updates the state with a reading, m, of the present instant, or rejects it.
    pub fn read(&mut self, reading_m: f64) -> Verdict {
        if !reading_m.is_finite() {
            return Verdict::Refused;
        }
        let [ll, lv, vv] = self.p;
        let spread = ll + self.settings.reading_sigma_m * self.settings.reading_sigma_m;
        let surprise = reading_m - self.length_m;
        if surprise * surprise > GATE * GATE * spread {
            self.refused += 1;
            if self.refused < RESTART_AFTER {
                return Verdict::Refused;
            }
            *self = Self::new(self.settings, reading_m);
            return Verdict::BegunAnew;
        }
        self.refused = 0;
        let gain = [ll / spread, lv / spread];
        self.length_m += gain[0] * surprise;
        self.velocity_m_s += gain[1] * surprise;
        // (I - K H) P, whose off-diagonal entries are equal; 1 - K = R / S prevents the first from rounding below 0.
        let left = 1.0 - gain[0];
        self.p = [left * ll, left * lv, (vv - gain[1] * lv).max(0.0)];
        Verdict::Taken
    }

    /// Estimated length, m.
    pub fn length_m(&self) -> f64 {
        self.length_m
    }

    /// Estimated velocity dl/dt, m/s.
    pub fn velocity_m_s(&self) -> f64 {
        self.velocity_m_s
    }

    /// Standard deviation of the length, m.
    pub fn length_sigma_m(&self) -> f64 {
        self.p[0].max(0.0).sqrt()
    }

    /// Standard deviation of the velocity, m/s.
    pub fn velocity_sigma_m_s(&self) -> f64 {
        self.p[2].max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};
    use proptest::prelude::*;

    fn settings() -> FilterSettings {
        FilterSettings::new(0.07, 0.5, 1e-4).unwrap()
    }

    proptest! {
        /// Comparison with textbook matrices (Joseph's form); the transition is a series of many small Euler steps.
        #[test]
        fn it_is_the_kalman_filter(steps in proptest::collection::vec((-0.4..0.4f64, 0.002..0.02f64, -3e-4..3e-4f64, any::<bool>()), 1..60)) {
            let mut filter = LengthFilter::new(settings(), 5.0);
            let (tau, qa, r) = (0.07, 0.25, 1e-8);
            let mut x = Vector2::new(5.0, 0.0);
            let mut p = Matrix2::new(r, 0.0, 0.0, START_SIGMA_M_S * START_SIGMA_M_S);
            for (command, seconds, noise, is_read) in steps {
                filter.predict(command, seconds);
                let parts = 2000;
                let small = seconds / f64::from(parts);
                let a = Matrix2::new(0.0, 1.0, 0.0, -1.0 / tau);
                let half = Matrix2::identity() - a * (0.5 * small);
                let one = half.try_inverse().unwrap() * (Matrix2::identity() + a * (0.5 * small));
                let mut f = Matrix2::identity();
                for _ in 0..parts {
                    f = one * f;
                }
                // For constant u, the deviation is measured from the point [u t, u].
                let u = Vector2::new(0.0, command);
                x = f * (x - u) + u + Vector2::new(command * seconds, 0.0);
                let g = Vector2::new(0.5 * seconds * seconds, seconds);
                p = f * p * f.transpose() + g * g.transpose() * qa;
                prop_assert!((filter.length_m() - x[0]).abs() < 1e-9 && (filter.velocity_m_s() - x[1]).abs() < 1e-7);
                if is_read {
                    let reading = x[0] + noise;
                    let s = p[(0, 0)] + r;
                    prop_assume!(noise * noise < 0.9 * GATE * GATE * s);
                    let k = Vector2::new(p[(0, 0)], p[(1, 0)]) / s;
                    x += k * noise;
                    let left = Matrix2::identity() - k * nalgebra::RowVector2::new(1.0, 0.0);
                    p = left * p * left.transpose() + k * k.transpose() * r;
                    prop_assert_eq!(filter.read(reading), Verdict::Taken);
                }
                prop_assert!((filter.length_sigma_m() - p[(0, 0)].sqrt()).abs() < 1e-6 * p[(0, 0)].sqrt() + 1e-12);
                prop_assert!((filter.velocity_sigma_m_s() - p[(1, 1)].sqrt()).abs() < 1e-5 * p[(1, 1)].sqrt() + 1e-12);
            }
        }

        /// For any input, finite state remains finite and the covariance remains valid.
        #[test]
        fn any_input_leaves_a_finite_state(steps in proptest::collection::vec((any::<f64>(), any::<f64>(), any::<f64>()), 1..50)) {
            let mut filter = LengthFilter::at_rest(settings(), 5.0);
            for (command, seconds, reading) in steps {
                filter.predict(command.clamp(-1e3, 1e3), seconds);
                filter.read(reading.clamp(-1e6, 1e6));
                prop_assert!(filter.length_m().is_finite() && filter.velocity_m_s().is_finite());
                let [ll, lv, vv] = filter.p;
                prop_assert!(ll >= 0.0 && vv >= 0.0 && lv * lv <= ll * vv * (1.0 + 1e-6) + 1e-18, "{:?}", filter.p);
            }
        }
    }

    /// A cable that moves with the lag of the drive, read through encoder steps: the errors have the predicted spread.
    #[test]
    fn its_covariance_matches_the_errors() {
        let step_m = 0.000_35;
        let settings = FilterSettings::new(0.07, 0.5, step_m / 12f64.sqrt()).unwrap();
        let mut filter = LengthFilter::new(settings, 5.0);
        let (mut l, mut v, mut ratio, mut naive, mut count) = (5.0, 0.0, 0.0, 0.0, 0);
        // A reproducible unknown acceleration with the standard deviation of the settings.
        let mut seed = 12345u64;
        let mut random = || {
            let sum: f64 = (0..12)
                .map(|_| {
                    seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    (seed >> 11) as f64 / (1u64 << 53) as f64
                })
                .sum();
            sum - 6.0
        };
        for cycle in 0..5000 {
            let command = 0.2 * libm::sin(0.013 * f64::from(cycle));
            let (keep, a) = (libm::exp(-0.01f64 / 0.07), 0.5 * random());
            l += command * 0.01 + (v - command) * 0.07 * (1.0 - keep) + 0.5 * a * 1e-4;
            v = command + (v - command) * keep + a * 0.01;
            let reading = (l / step_m).round() * step_m;
            filter.predict(command, 0.01);
            filter.read(reading);
            if cycle > 100 {
                ratio += ((filter.length_m() - l) / filter.length_sigma_m()).powi(2);
                naive += ((reading - l) / filter.length_sigma_m()).powi(2);
                count += 1;
            }
        }
        let (ratio, naive) = (ratio / f64::from(count), naive / f64::from(count));
        assert!((0.6..1.4).contains(&ratio) && naive > 1.2 * ratio, "{ratio} {naive}");
    }

    #[test]
    fn an_outlier_is_rejected_and_a_lasting_change_restarts_the_filter() {
        let mut filter = LengthFilter::at_rest(settings(), 5.0);
        for _ in 0..100 {
            filter.predict(0.0, 0.01);
            assert_eq!(filter.read(5.0), Verdict::Taken);
        }
        filter.predict(0.0, 0.01);
        assert_eq!(filter.read(5.02), Verdict::Refused);
        assert!((filter.length_m() - 5.0).abs() < 1e-6);
        filter.predict(0.0, 0.01);
        assert_eq!((filter.read(5.0), filter.read(f64::NAN)), (Verdict::Taken, Verdict::Refused));
        for expected in [Verdict::Refused, Verdict::Refused, Verdict::BegunAnew, Verdict::Taken] {
            filter.predict(0.0, 0.01);
            assert_eq!(filter.read(5.3), expected);
        }
        assert_eq!(filter.length_m(), 5.3);
    }

    #[test]
    fn parameters_out_of_range_are_refused() {
        for [lag, acceleration, reading] in
            [[0.0, 0.5, 1e-4], [f64::NAN, 0.5, 1e-4], [0.07, -1.0, 1e-4], [0.07, 0.5, 0.0], [0.07, 0.5, f64::INFINITY]]
        {
            let error = FilterSettings::new(lag, acceleration, reading).unwrap_err();
            assert!(
                [lag, acceleration, reading].iter().any(|given| given.to_bits() == error.value.to_bits()),
                "{error}"
            );
            assert!(error.to_string().ends_with(error.accepted), "{error}");
        }
    }
}
