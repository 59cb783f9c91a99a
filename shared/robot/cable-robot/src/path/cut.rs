//! The remainder of a path from a given arc length.

use super::{Parabola, Path, SHORTEST_M, Spiral};

/// Smallest number of turns of a spiral that [`Path::check`] accepts.
const LEAST_TURNS: f64 = 0.01;

impl Path {
    /// Returns the part of the path from the arc length `s_m` (m) to the end, with the same points. Before the start,
    /// and for a dwell, this is the whole path.
    ///
    /// Returns `None` if the remainder is not a valid path, and for a lateral path, whose parts are not lateral paths.
    ///
    /// ```
    /// use cable_robot::Path;
    /// use cable_robot::Vector3;
    /// let path = Path::line(Vector3::zeros(), Vector3::new(2.0, 0.0, 0.0));
    /// assert_eq!(path.rest_from(0.5), Some(Path::line(Vector3::new(0.5, 0.0, 0.0), Vector3::new(2.0, 0.0, 0.0))));
    /// assert_eq!(path.rest_from(2.0), None);
    /// ```
    #[must_use]
    pub fn rest_from(&self, s_m: f64) -> Option<Self> {
        // Also true for NaN.
        if !(s_m > 0.0) {
            return Some(*self);
        }
        if let Self::Dwell(_) = self {
            return Some(*self);
        }
        if self.length() - s_m < SHORTEST_M {
            return None;
        }
        let rest = match self {
            Self::Line(line) => Self::line(self.point(s_m), line.to),
            // The second derivative of a parabola is constant.
            Self::Parabola(parabola) => Self::Parabola(Parabola { from: self.point(s_m), ..*parabola }),
            Self::Spiral(spiral) => Self::Spiral(spiral.rest_from(s_m)?),
            Self::Lateral(_) | Self::Dwell(_) => return None,
        };
        rest.check().is_ok().then_some(rest)
    }
}

impl Spiral {
    fn rest_from(&self, s_m: f64) -> Option<Self> {
        let ((growth, rise), end) = (self.rates(), self.angle());
        let theta = self.angle_at(s_m);
        let mut centre = self.centre;
        centre.z += rise * theta;
        let left = (end - theta) / (2.0 * std::f64::consts::PI);
        (left >= LEAST_TURNS).then_some(Self {
            centre,
            start_radius_m: self.start_radius_m + growth * theta,
            turns: left.copysign(self.turns),
            rise_m: self.rise_m - rise * theta,
            start_angle_rad: self.start_angle_rad + theta.copysign(self.turns),
            ..*self
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    fn path() -> impl Strategy<Value = Path> {
        let point = || prop::array::uniform3(-3.0..3.0f64).prop_map(Vector3::from);
        prop_oneof![
            (point(), point()).prop_map(|(from, to)| Path::line(from, to)),
            (point(), point(), -0.5..0.5f64).prop_map(|(from, to, mu_per_m)| Path::Parabola(Parabola {
                from,
                to,
                mu_per_m
            })),
            (point(), 0.0..1.0f64, 0.1..1.0f64, -4.0..4.0f64, -1.0..1.0f64, -3.0..3.0f64).prop_map(
                |(centre, start_radius_m, end_radius_m, turns, rise_m, start_angle_rad)| {
                    Path::Spiral(Spiral { centre, start_radius_m, end_radius_m, turns, rise_m, start_angle_rad })
                }
            ),
        ]
    }

    proptest! {
        #[test]
        fn the_rest_is_the_same_points(path in path(), cut in 0.0..0.95f64, probe in 0.0..=1.0f64) {
            prop_assume!(path.check().is_ok() && path.length() > 0.01);
            let s_m = cut * path.length();
            let Some(rest) = path.rest_from(s_m) else {
                // a spiral with almost no turn
                prop_assert!(matches!(path, Path::Spiral(spiral) if spiral.turns.abs() * (1.0 - cut) < 0.1));
                return Ok(());
            };
            prop_assert!((rest.length() - (path.length() - s_m)).abs() < 1e-9);
            let along_m = probe * rest.length();
            prop_assert!((rest.point(along_m) - path.point(s_m + along_m)).norm() < 1e-8);
            prop_assert!((rest.end() - path.end()).norm() < 1e-9);
        }
    }
}
