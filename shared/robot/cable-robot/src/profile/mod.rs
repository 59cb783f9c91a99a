//! Speed along a path: at most 32 knots (s, v) with constant tangential acceleration in between, so that v² is linear
//! in s and every quantity has a closed form in time.

mod build;
mod shaping;

use thiserror::Error;

/// Largest number of knots of a profile and of a message.
pub const MAX_KNOTS: usize = 32;

/// Arc lengths, speeds and accelerations beyond these are in a wrong unit or erroneous.
const FARTHEST_M: f64 = 1e6;
const FASTEST_M_S: f64 = 1e4;
const STEEPEST_M_S2: f64 = 1e6;

/// Default of the swing above which a profile is shaped, m: about what a careful calibration leaves over.
pub const SWING_LIMIT_M: f64 = 0.005;

/// Relative excess that counts as rounding.
const ROUNDING: f64 = 1e-9;

/// Speed at a point of the path.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Knot {
    /// Arc length, m.
    pub s_m: f64,
    /// Speed, m/s.
    pub v_m_s: f64,
}

/// Position along the path at a time, with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ProfilePoint {
    /// Arc length, m.
    pub s_m: f64,
    /// Speed, m/s.
    pub v_m_s: f64,
    /// Tangential acceleration, m/s².
    pub a_m_s2: f64,
}

/// Limits of a profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProfileLimits {
    /// Highest speed, m/s.
    pub cruise_m_s: f64,
    /// Highest tangential acceleration, m/s².
    pub tangential_m_s2: f64,
    /// Highest total acceleration (tangential and centripetal), m/s².
    pub total_m_s2: f64,
    /// Speed at the start, m/s.
    pub start_m_s: f64,
    /// Speed at the end, m/s.
    pub end_m_s: f64,
    /// Swing above which [`crate::swing::shaped`] shapes the profile, m. A profile that is planned without the robot
    /// is not shaped.
    pub swing_limit_m: f64,
}

impl ProfileLimits {
    /// Limits from rest to rest, with the same tangential and total acceleration.
    pub fn rest_to_rest(cruise_m_s: f64, acceleration_m_s2: f64) -> Self {
        Self {
            cruise_m_s,
            tangential_m_s2: acceleration_m_s2,
            total_m_s2: acceleration_m_s2,
            start_m_s: 0.0,
            end_m_s: 0.0,
            swing_limit_m: SWING_LIMIT_M,
        }
    }
}

/// Error of an invalid profile.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum ProfileError {
    /// A limit is not a positive number, or a speed is negative.
    #[error("{what} is {value}; accepted: {accepted}")]
    InvalidLimit {
        /// Name of the parameter.
        what: &'static str,
        /// Value of the quantity.
        value: f64,
        /// Accepted values.
        accepted: &'static str,
    },
    /// Number of knots outside the accepted range.
    #[error("a speed profile has 1 to {MAX_KNOTS} knots, not {given}")]
    WrongCount {
        /// Number of knots given.
        given: usize,
    },
    /// Knots out of order, negative, not finite, or at rest over a distance.
    #[error("knot {knot} of the speed profile ({s_m} m, {v_m_s} m/s) {problem}")]
    BadKnot {
        /// Number of the knot, from 1.
        knot: usize,
        /// Arc length of the knot, m.
        s_m: f64,
        /// Speed of the knot, m/s.
        v_m_s: f64,
        /// Description of the problem.
        problem: &'static str,
    },
    /// The speed at an end is above the limit from curvature or cruise speed.
    #[error("the speed of {wanted_m_s} m/s at the {end} of the path is above the {allowed_m_s:.4} m/s possible there")]
    EndTooFast {
        /// "start" or "end".
        end: &'static str,
        /// Requested speed, m/s.
        wanted_m_s: f64,
        /// Highest possible speed, m/s.
        allowed_m_s: f64,
    },
}

/// Speed along a path.
///
/// ```
/// use cable_robot::Path;
/// use cable_robot::Vector3;
/// use cable_robot::profile::{Profile, ProfileLimits};
/// let path = Path::line(Vector3::zeros(), Vector3::new(2.0, 0.0, 0.0));
/// let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.2, 0.4))?;
/// assert_eq!(profile.knots().len(), 4); // a trapezoid
/// assert!((profile.duration() - (2.0 / 0.2 + 0.2 / 0.4)).abs() < 1e-12);
/// assert!((profile.at(5.0).v_m_s - 0.2).abs() < 1e-12);
/// # Ok::<(), cable_robot::profile::ProfileError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Profile {
    knots: [Knot; MAX_KNOTS],
    /// Time at each knot, s.
    times: [f64; MAX_KNOTS],
    count: usize,
    duration_s: f64,
}

impl Profile {
    /// Returns a profile that stays in place for a time, s.
    pub fn dwell(duration_s: f64) -> Result<Self, ProfileError> {
        if !(duration_s.is_finite() && duration_s >= 0.0) {
            return Err(ProfileError::InvalidLimit {
                what: "the duration of the dwell",
                value: duration_s,
                accepted: "0 s or more",
            });
        }
        let knots = [Knot::default(); MAX_KNOTS];
        Ok(Self { knots, times: [0.0; MAX_KNOTS], count: 1, duration_s })
    }

    /// Builds a profile from the knots of a message: the first at s = 0, s increasing, v ≥ 0 and never 0 at two
    /// neighbours. A single knot (0, 0) is a dwell of zero duration; see [`Profile::dwell`].
    pub fn from_knots(given: &[Knot]) -> Result<Self, ProfileError> {
        if given.is_empty() || given.len() > MAX_KNOTS {
            return Err(ProfileError::WrongCount { given: given.len() });
        }
        let bad = |i: usize, problem| {
            Err(ProfileError::BadKnot { knot: i + 1, s_m: given[i].s_m, v_m_s: given[i].v_m_s, problem })
        };
        let mut result =
            Self { knots: [Knot::default(); MAX_KNOTS], times: [0.0; MAX_KNOTS], count: given.len(), duration_s: 0.0 };
        for (i, knot) in given.iter().enumerate() {
            if !(knot.s_m.abs() <= FARTHEST_M && (0.0..=FASTEST_M_S).contains(&knot.v_m_s)) {
                return bad(i, "is negative, not a finite number or in a wrong unit");
            }
            result.knots[i] = *knot;
            if i == 0 {
                if knot.s_m != 0.0 {
                    return bad(i, "is the first and does not lie at 0 m");
                }
                continue;
            }
            let ds = knot.s_m - given[i - 1].s_m;
            if !(ds > 0.0) {
                return bad(i, "does not lie beyond the previous knot");
            }
            if !(slope(given[i - 1], *knot).abs() <= STEEPEST_M_S2) {
                return bad(i, "changes the speed without distance");
            }
            let sum = knot.v_m_s + given[i - 1].v_m_s;
            if sum == 0.0 {
                return bad(i, "and the previous knot are both at rest, so the path between them would never end");
            }
            result.duration_s += 2.0 * ds / sum;
            if !result.duration_s.is_finite() {
                return bad(i, "is too slow to be reached in finite time");
            }
            result.times[i] = result.duration_s;
        }
        Ok(result)
    }

    /// The knots.
    pub fn knots(&self) -> &[Knot] {
        &self.knots[..self.count]
    }

    /// Time from start to end, s.
    pub fn duration(&self) -> f64 {
        self.duration_s
    }

    /// Arc length at the end, m.
    pub fn length(&self) -> f64 {
        self.knots[self.count - 1].s_m
    }

    /// Position along the path at a time since its start, s. Before the start and after the end, the profile rests
    /// there; exactly at an end, the speed and acceleration of the profile apply.
    pub fn at(&self, t_s: f64) -> ProfilePoint {
        // Also true for NaN.
        if !(t_s >= 0.0) {
            return ProfilePoint::default();
        }
        if t_s > self.duration_s || self.count < 2 {
            return ProfilePoint { s_m: self.length(), ..ProfilePoint::default() };
        }
        let times = &self.times[1..self.count];
        let i = times.partition_point(|t| *t < t_s).min(self.count - 2);
        let (a, b) = (self.knots[i], self.knots[i + 1]);
        let acceleration = slope(a, b);
        let tau = t_s - self.times[i];
        let s = a.s_m + (a.v_m_s + 0.5 * acceleration * tau) * tau;
        let (low, high) = if a.v_m_s < b.v_m_s { (a.v_m_s, b.v_m_s) } else { (b.v_m_s, a.v_m_s) };
        let v = (a.v_m_s + acceleration * tau).clamp(low, high);
        ProfilePoint { s_m: s.clamp(a.s_m, b.s_m), v_m_s: v, a_m_s2: acceleration }
    }

    /// Time at which an arc length is reached, s; 0 before the start, the duration after the end.
    pub fn time_at(&self, s_m: f64) -> f64 {
        if !(s_m > 0.0) || self.count < 2 {
            return 0.0;
        }
        if s_m >= self.length() {
            return self.duration_s;
        }
        let i = self.interval_of(s_m);
        let (a, b) = (self.knots[i], self.knots[i + 1]);
        let v = speed_between(a, b, s_m);
        self.times[i] + 2.0 * (s_m - a.s_m) / (a.v_m_s + v)
    }

    /// Speed at an arc length, m/s; 0 outside the path.
    pub fn speed_at(&self, s_m: f64) -> f64 {
        if self.count < 2 || !(s_m >= 0.0) || s_m > self.length() {
            return 0.0;
        }
        let i = self.interval_of(s_m);
        speed_between(self.knots[i], self.knots[i + 1], s_m)
    }

    fn interval_of(&self, s_m: f64) -> usize {
        self.knots[1..self.count].partition_point(|k| k.s_m < s_m).min(self.count - 2)
    }
}

/// Tangential acceleration between two knots, m/s².
pub fn slope(a: Knot, b: Knot) -> f64 {
    (b.v_m_s - a.v_m_s) * (b.v_m_s + a.v_m_s) / (2.0 * (b.s_m - a.s_m))
}

pub(crate) fn speed_between(a: Knot, b: Knot, s_m: f64) -> f64 {
    let share = ((s_m - a.s_m) / (b.s_m - a.s_m)).clamp(0.0, 1.0);
    (a.v_m_s * a.v_m_s * (1.0 - share) + b.v_m_s * b.v_m_s * share).sqrt()
}

impl ProfileLimits {
    fn check(&self) -> Result<(), ProfileError> {
        let positive = [
            ("the cruise speed", self.cruise_m_s),
            ("the tangential acceleration", self.tangential_m_s2),
            ("the total acceleration", self.total_m_s2),
        ];
        for (what, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(ProfileError::InvalidLimit { what, value, accepted: "a finite value above 0" });
            }
        }
        for (end, wanted_m_s) in [("start", self.start_m_s), ("end", self.end_m_s)] {
            if !(wanted_m_s.is_finite() && wanted_m_s >= 0.0) {
                let what = if end == "start" { "the speed at the start" } else { "the speed at the end" };
                return Err(ProfileError::InvalidLimit { what, value: wanted_m_s, accepted: "0 m/s or more" });
            }
            if wanted_m_s > self.cruise_m_s * (1.0 + ROUNDING) {
                return Err(ProfileError::EndTooFast { end, wanted_m_s, allowed_m_s: self.cruise_m_s });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::{Bow, Lateral, Parabola, Path, Spiral};
    use nalgebra::Vector3;
    use proptest::prelude::*;

    fn line(length: f64) -> Path {
        Path::line(Vector3::new(1.0, 2.0, 0.5), Vector3::new(1.0 + length, 2.0, 0.5))
    }

    fn spiral(turns: f64, r0: f64, r1: f64) -> Path {
        Path::Spiral(Spiral {
            centre: Vector3::new(4.8, 3.0, 0.8),
            start_radius_m: r0,
            end_radius_m: r1,
            turns,
            rise_m: 1.125,
            start_angle_rad: 0.0,
        })
    }

    fn curved_paths() -> impl Strategy<Value = Path> {
        prop_oneof![
            (0.3..6.0f64, 0.0..1.0f64, 0.0..1.0f64).prop_map(|(t, a, b)| spiral(t, a, b)),
            ([-3.0..3.0f64, -3.0..3.0f64, 0.0..2.0f64], 0.01..1.0f64).prop_map(|(d, mu_per_m)| Path::Parabola(
                Parabola { from: Vector3::zeros(), to: Vector3::from(d), mu_per_m }
            )),
            (
                [1.0..3.0f64, -3.0..3.0f64, 0.0..2.0f64],
                [0.0..1.0f64, -0.2..0.2f64, -0.1..0.1f64],
                [-1.0..1.0f64, -0.2..0.2f64, -0.1..0.1f64]
            )
                .prop_map(|(d, down_m, side_m)| Path::Lateral(Lateral::new(Bow {
                    from: Vector3::zeros(),
                    to: Vector3::from(d),
                    down_m,
                    side_m
                }))),
        ]
        .prop_filter("a path", |p| p.check().is_ok() && p.length() > 0.05)
    }

    /// Largest of speed / cruise, tangential / limit, total / limit over a dense sampling in time, as shares.
    fn worst(path: &Path, profile: &Profile, limits: &ProfileLimits) -> (f64, f64, f64) {
        let n = 4000;
        (0..=n).fold((0.0f64, 0.0f64, 0.0f64), |(v, t, a), i| {
            let along = profile.at(profile.duration() * i as f64 / n as f64);
            let across = path.curvature(along.s_m) * along.v_m_s * along.v_m_s;
            let total = (along.a_m_s2 * along.a_m_s2 + across * across).sqrt();
            (
                v.max(along.v_m_s / limits.cruise_m_s),
                t.max(along.a_m_s2.abs() / limits.tangential_m_s2),
                a.max(total / limits.total_m_s2),
            )
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn limits_hold_everywhere(path in curved_paths(), cruise in 0.05..0.6f64, tangential in 0.1..1.0f64, total in 0.1..1.0f64) {
            let limits = ProfileLimits { cruise_m_s: cruise, tangential_m_s2: tangential, total_m_s2: total, ..ProfileLimits::rest_to_rest(cruise, tangential) };
            let profile = Profile::plan(&path, &limits).unwrap();
            let (v, t, a) = worst(&path, &profile, &limits);
            prop_assert!(v <= 1.0 + 1e-6 && t <= 1.0 + 1e-6 && a <= 1.0 + 1e-3, "{v} {t} {a}");
            prop_assert!(profile.duration().is_finite() && (profile.length() - path.length()).abs() < 1e-12);
            // Not slower than a trapezoid at the speed of the greatest curvature.
            let sharpest = (0..=2000).map(|i| path.curvature(path.length() * i as f64 / 2000.0)).fold(0.0, f64::max);
            let plain = ProfileLimits { cruise_m_s: cruise.min((0.3 * total / sharpest).sqrt()), tangential_m_s2: tangential.min(0.6 * total), ..limits };
            let slow = build::straight(path.length(), &plain).unwrap();
            prop_assert!(profile.duration() <= slow.duration() * 1.05, "{} {}", profile.duration(), slow.duration());
        }

        #[test]
        fn position_speed_and_acceleration_belong_together(path in curved_paths(), u in 0.01..0.99f64) {
            let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.3, 0.5)).unwrap();
            let t = u * profile.duration();
            let h = 1e-6;
            let (a, m, b) = (profile.at(t - h), profile.at(t), profile.at(t + h));
            prop_assert!(((b.s_m - a.s_m) / (2.0 * h) - m.v_m_s).abs() < 1e-5);
            prop_assert!((profile.time_at(m.s_m) - t).abs() < 1e-7);
            prop_assert!((profile.speed_at(m.s_m) - m.v_m_s).abs() < 1e-7);
        }

        #[test]
        fn straight_profiles_are_exact_trapezoids(length in 1e-4..20.0f64, cruise in 0.01..2.0f64, a in 0.01..3.0f64) {
            let profile = Profile::plan(&line(length), &ProfileLimits::rest_to_rest(cruise, a)).unwrap();
            let length = line(length).length();
            let expected = if length * a > cruise * cruise { length / cruise + cruise / a } else { 2.0 * (length / a).sqrt() };
            prop_assert!((profile.duration() - expected).abs() < 1e-9 * expected);
            prop_assert!(profile.knots().len() <= 4);
        }

        #[test]
        fn speeds_at_the_ends_are_kept(path in curved_paths(), start in 0.0..0.05f64, end in 0.0..0.05f64) {
            let limits = ProfileLimits { start_m_s: start, end_m_s: end, ..ProfileLimits::rest_to_rest(0.3, 0.5) };
            if let Ok(profile) = Profile::plan(&path, &limits) {
                prop_assert!((profile.at(0.0).v_m_s - start).abs() < 1e-12);
                prop_assert!((profile.at(profile.duration()).v_m_s - end).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_turn_sharper_than_the_samples_is_not_missed() {
        let needle = Path::Parabola(Parabola {
            from: Vector3::new(0.0, 0.0, 2.0),
            to: Vector3::new(4.0, 3.0, 2.5),
            mu_per_m: 19.0,
        });
        let limits = ProfileLimits::rest_to_rest(0.4, 0.2);
        let profile = Profile::plan(&needle, &limits).unwrap();
        let Path::Parabola(p) = needle else { unreachable!() };
        let turn = needle.sharpest_m().unwrap();
        assert!((needle.point(turn).z - p.lowest_m()).abs() < 1e-6);
        for i in -1000..=1000 {
            let s = turn + f64::from(i) * 1e-3;
            let v = profile.speed_at(s);
            assert!(needle.curvature(s) * v * v <= 0.2 * (1.0 + 1e-6), "{s}");
        }
    }

    #[test]
    fn a_stop_that_is_too_short_is_refused() {
        let limits = ProfileLimits { start_m_s: 1.0, ..ProfileLimits::rest_to_rest(1.0, 0.1) };
        let error = Profile::plan(&line(1.0), &limits).unwrap_err();
        let ProfileError::EndTooFast { end: "start", wanted_m_s: 1.0, allowed_m_s } = error else { panic!("{error}") };
        assert!((allowed_m_s - 0.2_f64.sqrt()).abs() < 1e-9, "{error}");
        assert!(["1 m/s", "0.4472 m/s"].iter().all(|number| error.to_string().contains(number)), "{error}");
        assert!(Profile::plan(&spiral(2.0, 0.2, 0.4), &limits).is_err());
    }

    #[test]
    fn bad_knots_and_limits_are_refused() {
        let k = |s_m, v_m_s| Knot { s_m, v_m_s };
        for knots in [
            &[][..],
            &[k(0.0, 0.0); 33],
            &[k(0.1, 0.0), k(1.0, 1.0)],
            &[k(0.0, 0.0), k(1.0, 0.0)],
            &[k(0.0, 0.0), k(1.0, 1.0), k(1.0, 0.0)],
            &[k(0.0, 0.0), k(1.0, f64::NAN)],
            &[k(0.0, -1.0), k(1.0, 1.0)],
        ] {
            assert!(Profile::from_knots(knots).is_err());
        }
        for (v, a) in [(0.0, 1.0), (-1.0, 1.0), (f64::NAN, 1.0), (1.0, 0.0), (1.0, f64::INFINITY)] {
            assert!(Profile::plan(&line(1.0), &ProfileLimits::rest_to_rest(v, a)).is_err());
        }
        assert!(Profile::dwell(-1.0).is_err() && Profile::dwell(f64::NAN).is_err());
    }

    #[test]
    fn before_and_after_it_rests() {
        let profile = Profile::plan(&line(1.0), &ProfileLimits::rest_to_rest(0.2, 0.4)).unwrap();
        assert_eq!(profile.at(-1.0), ProfilePoint::default());
        assert_eq!(profile.at(1e9), ProfilePoint { s_m: profile.length(), ..ProfilePoint::default() });
        let dwell = Profile::dwell(3.0).unwrap();
        assert_eq!((dwell.duration(), dwell.at(1.0)), (3.0, ProfilePoint::default()));
        assert_eq!(Profile::from_knots(profile.knots()).unwrap(), profile);
    }
}
