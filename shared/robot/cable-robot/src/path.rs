//! The geometry of a move, parametrised by arc length: position, direction and curvature, without time.
//!
//! Arc length in m, positions in m, tangents as unit vectors, curvature in 1/m; µ of (25)-(26) in 1/m. [`Path::check`]
//! returns a [`PathError`] for an invalid path.

mod curves;
mod cut;
mod lateral;
mod shapes;

pub use lateral::{Bow, BowPoint, HARMONICS, Lateral};
pub use shapes::{Line, Parabola, PathPoint, Spiral};

use curves::Slopes;
use nalgebra::Vector3;
use thiserror::Error;

/// Length of the shortest path that is a motion, m; a shorter one is a dwell.
pub const SHORTEST_M: f64 = 1e-6;

/// Error of an invalid path.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum PathError {
    /// A coordinate or parameter is not a finite number.
    #[error("{what} of the path is {value}; give a finite number")]
    NotFinite {
        /// Name of the parameter.
        what: &'static str,
        /// Value of the quantity.
        value: f64,
    },
    /// Start and end coincide.
    #[error("the path is {length_m:e} m long; use a dwell to stay in place")]
    TooShort {
        /// Length of the path, m.
        length_m: f64,
    },
    /// A parabola or a lateral path without horizontal extent.
    #[error(
        "start and end of a parabola or lateral path must be {SHORTEST_M} m or more apart horizontally; use a line for vertical moves"
    )]
    Vertical,
    /// A negative radius or an invalid number of turns.
    #[error("{what} of the spiral is {value}; accepted: {accepted}")]
    Spiral {
        /// Name of the parameter.
        what: &'static str,
        /// Value of the quantity.
        value: f64,
        /// Accepted values.
        accepted: &'static str,
    },
}

/// The geometry of one segment of a motion.
///
/// ```
/// use cable_robot::Vector3;
/// use cable_robot::path::{Parabola, Path};
/// let path = Path::Parabola(Parabola {
///     from: Vector3::new(2.0, 2.0, 2.0),
///     to: Vector3::new(7.0, 3.0, 2.2),
///     mu_per_m: 0.1,
/// });
/// path.check()?;
/// let middle = path.at(0.5 * path.length());
/// assert!(middle.position.z < 2.0 && (middle.tangent.norm() - 1.0).abs() < 1e-12);
/// # Ok::<(), cable_robot::path::PathError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Path {
    /// A straight line.
    Line(Line),
    /// A parabola in a vertical plane.
    Parabola(Parabola),
    /// A spiral about a vertical axis.
    Spiral(Spiral),
    /// A line with vertical and sideways harmonics.
    Lateral(Lateral),
    /// A point at which the node stays.
    Dwell(Vector3<f64>),
}

impl Path {
    /// A straight line.
    pub fn line(from: Vector3<f64>, to: Vector3<f64>) -> Self {
        Self::Line(Line { from, to })
    }

    /// Rejects parameters that are not finite, zero length, a vertical parabola and a negative radius.
    pub fn check(&self) -> Result<(), PathError> {
        match self {
            Self::Dwell(p) => finite("position", p),
            Self::Line(l) => {
                finite("start", &l.from)?;
                finite("end", &l.to)?;
                long_enough(self)
            }
            Self::Parabola(p) => {
                finite("start", &p.from)?;
                finite("end", &p.to)?;
                number("mu_per_m", p.mu_per_m)?;
                if p.extent() < SHORTEST_M { Err(PathError::Vertical) } else { long_enough(self) }
            }
            Self::Spiral(s) => {
                finite("centre", &s.centre)?;
                number("rise_m", s.rise_m)?;
                number("start_angle_rad", s.start_angle_rad)?;
                for (what, value) in [("start_radius_m", s.start_radius_m), ("end_radius_m", s.end_radius_m)] {
                    number(what, value)?;
                    if value < 0.0 {
                        return Err(PathError::Spiral { what, value, accepted: "0 m or more" });
                    }
                }
                number("turns", s.turns)?;
                if !(0.01..=1000.0).contains(&s.turns.abs()) {
                    let accepted = "0.01 to 1000, or -0.01 to -1000 for clockwise";
                    return Err(PathError::Spiral { what: "turns", value: s.turns, accepted });
                }
                long_enough(self)
            }
            Self::Lateral(l) => {
                let bow = l.bow();
                finite("start", &bow.from)?;
                finite("end", &bow.to)?;
                bow.down_m.iter().try_for_each(|m| number("down_m", *m))?;
                bow.side_m.iter().try_for_each(|m| number("side_m", *m))?;
                if bow.extent() < SHORTEST_M { Err(PathError::Vertical) } else { long_enough(self) }
            }
        }
    }

    /// Arc length, m.
    pub fn length(&self) -> f64 {
        match self {
            Self::Line(l) => (l.to - l.from).norm(),
            Self::Parabola(p) => p.arc_length(p.extent()),
            Self::Spiral(s) => s.arc_length(s.angle()),
            Self::Lateral(l) => l.length_m(),
            Self::Dwell(_) => 0.0,
        }
    }

    /// Position, tangent and curvature at an arc length, m; clamped to the start and the end.
    pub fn at(&self, s_m: f64) -> PathPoint {
        match self {
            Self::Line(l) => l.at(s_m),
            Self::Parabola(p) => p.at(s_m),
            Self::Spiral(s) => s.at(s_m),
            Self::Lateral(l) => l.at(s_m),
            Self::Dwell(p) => PathPoint { position: *p, tangent: Vector3::zeros(), curvature: Vector3::zeros() },
        }
    }

    /// Position at an arc length, m.
    pub fn point(&self, s_m: f64) -> Vector3<f64> {
        self.at(s_m).position
    }

    /// Unit tangent at an arc length; zero for a dwell.
    pub fn tangent(&self, s_m: f64) -> Vector3<f64> {
        self.at(s_m).tangent
    }

    /// Curvature at an arc length, 1/m.
    pub fn curvature(&self, s_m: f64) -> f64 {
        self.at(s_m).curvature.norm()
    }

    /// Returns the path for many of its points in their order.
    pub fn walk(&self) -> Walk<'_> {
        let slopes = if let Self::Parabola(parabola) = self { Slopes::new(parabola) } else { None };
        Walk { path: self, slopes }
    }

    /// Spreads samples over the path, two or more: rising arc lengths from the start to the end, m, and the curvature
    /// at each, 1/m. Those of a parabola are closest where it turns fastest, and its sharpest point is one of them, or
    /// counts at the end beside it.
    pub(crate) fn sample(&self, arc_lengths_m: &mut [f64], curvatures: &mut [f64]) {
        if let Self::Parabola(parabola) = self {
            return parabola.sample(arc_lengths_m, curvatures);
        }
        let (length_m, last) = (self.length(), arc_lengths_m.len() - 1);
        for (i, (s_m, curvature)) in arc_lengths_m.iter_mut().zip(curvatures).enumerate() {
            *s_m = length_m * i as f64 / last as f64;
            *curvature = self.curvature(*s_m);
        }
    }

    /// Start position, m.
    pub fn start(&self) -> Vector3<f64> {
        match self {
            Self::Line(Line { from, .. }) | Self::Parabola(Parabola { from, .. }) => *from,
            Self::Spiral(_) => self.point(0.0),
            Self::Lateral(l) => l.bow().from,
            Self::Dwell(p) => *p,
        }
    }

    /// End position, m.
    pub fn end(&self) -> Vector3<f64> {
        match self {
            Self::Line(Line { to, .. }) | Self::Parabola(Parabola { to, .. }) => *to,
            Self::Spiral(s) => s.geometry(s.angle()).position,
            Self::Lateral(l) => l.bow().to,
            Self::Dwell(p) => *p,
        }
    }

    /// Arc length of an inner point with a local maximum of curvature, m, if the path has one.
    #[cfg(test)]
    pub(crate) fn sharpest_m(&self) -> Option<f64> {
        let Self::Parabola(p) = self else { return None };
        p.vertex().map(|x| p.arc_length(x))
    }

    /// Greatest curvature, 1/m, if it is known without a search.
    pub fn greatest_curvature(&self) -> Option<f64> {
        match self {
            Self::Line(_) | Self::Dwell(_) => Some(0.0),
            Self::Parabola(p) => Some(p.greatest_curvature()),
            Self::Spiral(_) | Self::Lateral(_) => None,
        }
    }

    /// True if the curvature is 0 everywhere.
    pub fn is_straight(&self) -> bool {
        match self {
            Self::Line(_) | Self::Dwell(_) => true,
            Self::Parabola(p) => p.mu_per_m == 0.0,
            Self::Spiral(_) => false,
            Self::Lateral(l) => l.is_straight(),
        }
    }
}

/// A path on which a point is found faster near the one before. To the last bits, it is that of [`Path::at`].
#[derive(Debug, Clone, Copy)]
pub struct Walk<'a> {
    path: &'a Path,
    slopes: Option<Slopes>,
}

impl Walk<'_> {
    /// Position, tangent and curvature at an arc length, m, as [`Path::at`].
    pub fn at(&mut self, s_m: f64) -> PathPoint {
        match &mut self.slopes {
            Some(slopes) => slopes.point(s_m),
            None => self.path.at(s_m),
        }
    }
}

fn number(what: &'static str, value: f64) -> Result<(), PathError> {
    if value.is_finite() { Ok(()) } else { Err(PathError::NotFinite { what, value }) }
}

fn finite(what: &'static str, point: &Vector3<f64>) -> Result<(), PathError> {
    point.iter().try_for_each(|v| number(what, *v))
}

fn long_enough(path: &Path) -> Result<(), PathError> {
    let length_m = path.length();
    number("length", length_m)?;
    if length_m < SHORTEST_M { Err(PathError::TooShort { length_m }) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn spiral() -> Spiral {
        Spiral {
            centre: Vector3::new(4.8, 3.0, 0.8),
            start_radius_m: 0.0,
            end_radius_m: 0.60,
            turns: 3.0,
            rise_m: 1.125,
            start_angle_rad: 0.3,
        }
    }

    fn paths() -> impl Strategy<Value = Path> {
        let point = || [-5.0..5.0f64, -5.0..5.0f64, 0.0..3.0f64].prop_map(Vector3::from);
        prop_oneof![
            (point(), point()).prop_map(|(a, b)| Path::line(a, b)),
            (point(), point(), prop_oneof![-0.5..0.5f64, -1e-4..1e-4f64, Just(0.0)])
                .prop_map(|(from, to, mu_per_m)| Path::Parabola(Parabola { from, to, mu_per_m })),
            (point(), 0.0..2.0f64, prop_oneof![0.0..2.0f64, Just(f64::NAN)], -5.0..5.0f64, -1.0..1.0f64, 0.0..6.0f64)
                .prop_map(|(centre, r0, r1, turns, rise_m, start_angle_rad)| {
                    // NaN means "the same radius": a helix.
                    let end_radius_m = if r1.is_nan() { r0 } else { r1 };
                    Path::Spiral(Spiral { centre, start_radius_m: r0, end_radius_m, turns, rise_m, start_angle_rad })
                }),
            (point(), point(), [-0.5..0.5f64, -0.2..0.2f64, -0.1..0.1f64], [-1.5..1.5f64, -0.3..0.3f64, -0.1..0.1f64])
                .prop_filter("apart", |(a, b, ..)| (b - a).xy().norm() > 0.5)
                .prop_map(|(from, to, down_m, side_m)| Path::Lateral(Lateral::new(Bow { from, to, down_m, side_m }))),
        ]
        .prop_filter("a path", |p| p.check().is_ok() && p.length() > 1e-2)
    }

    proptest! {
        #[test]
        fn tangent_and_curvature_are_the_derivatives(path in paths(), u in 0.01..0.99f64) {
            let length = path.length();
            let s = u * length;
            let p = path.at(s);
            prop_assert!((p.tangent.norm() - 1.0).abs() < 1e-12);
            prop_assert!(p.tangent.dot(&p.curvature).abs() < 1e-9 * (1.0 + p.curvature.norm()));
            // A step that is small relative to the radius of curvature.
            let h = (1e-4 * length).min(1e-3 / (1.0 + p.curvature.norm()));
            let (a, b) = (path.point(s - h), path.point(s + h));
            prop_assert!(((b - a) / (2.0 * h) - p.tangent).norm() < 1e-5);
            let second = (path.tangent(s + h) - path.tangent(s - h)) / (2.0 * h);
            prop_assert!((second - p.curvature).norm() < 2e-3 * (1.0 + p.curvature.norm()));
        }

        #[test]
        fn nothing_is_curved_more_than_the_greatest_curvature(path in paths()) {
            let most = (0..=2000).map(|i| path.curvature(path.length() * f64::from(i) / 2000.0)).fold(0.0, f64::max);
            if let Some(greatest) = path.greatest_curvature() {
                prop_assert!(most <= greatest * (1.0 + 1e-9) + 1e-12, "{most} {greatest}");
                // And no less, up to the value between two samples.
                prop_assert!(greatest <= most.max(path.curvature(path.sharpest_m().unwrap_or(0.0))) * (1.0 + 1e-9) + 1e-12, "{most} {greatest}");
            }
        }

        #[test]
        fn arc_length_agrees_with_chords(path in paths()) {
            // Chords converge from below with the square of their number; two refinements extrapolate.
            let chords = |n: usize| -> f64 {
                let l = path.length();
                (0..n).map(|i| (path.point(l * (i + 1) as f64 / n as f64) - path.point(l * i as f64 / n as f64)).norm()).sum()
            };
            let (coarse, fine) = (chords(500), chords(1000));
            let extrapolated = fine + (fine - coarse) / 3.0;
            prop_assert!((extrapolated - path.length()).abs() < 1e-5 * path.length(), "{extrapolated} {}", path.length());
        }

        #[test]
        fn a_walk_is_the_same_path(path in paths(), steps in proptest::collection::vec(-0.1..1.1f64, 1..20), near in any::<bool>()) {
            let length = path.length();
            let mut walk = path.walk();
            for (i, step) in steps.iter().enumerate() {
                // Small steps back and forth, and leaps.
                let s = length * if near { 0.05 * i as f64 + 0.01 * step } else { *step };
                let (there, at) = (walk.at(s), path.at(s));
                prop_assert!((there.position - at.position).norm() < 1e-12 * (1.0 + length));
                prop_assert!((there.tangent - at.tangent).norm() < 1e-11);
                prop_assert!((there.curvature - at.curvature).norm() < 1e-10 * (1.0 + at.curvature.norm()));
            }
        }

        #[test]
        fn ends_are_where_they_say(path in paths()) {
            prop_assert!((path.point(0.0) - path.start()).norm() < 1e-12);
            prop_assert!((path.point(path.length()) - path.end()).norm() < 1e-9);
            prop_assert_eq!(path.point(-1.0), path.point(0.0));
            for beyond in [1e9, 1e300, f64::INFINITY] {
                prop_assert!((path.point(beyond) - path.end()).norm() < 1e-12);
            }
        }
    }

    /// Simpson's rule on |dX/du| over the parameter of the path: an oracle that shares no formula with arc_length.
    fn simpson(f: impl Fn(f64) -> f64, end: f64) -> f64 {
        let n = 20_000;
        let h = end / n as f64;
        (0..=n).map(|i| f(i as f64 * h) * if i == 0 || i == n { 1.0 } else { 2.0 + 2.0 * (i % 2) as f64 }).sum::<f64>()
            * h
            / 3.0
    }

    #[test]
    fn closed_form_lengths_agree_with_quadrature() {
        for mu in [0.0, 1e-9, 4e-5, 9.9e-5, 1.01e-4, 2e-4, 0.05, 0.3, -0.2] {
            let p = Parabola { from: Vector3::new(1.0, 1.0, 2.0), to: Vector3::new(4.0, 5.0, 2.5), mu_per_m: mu };
            let zeta = p.zeta();
            let expected = simpson(|x| (1.0 + (2.0 * mu * x + zeta) * (2.0 * mu * x + zeta)).sqrt(), p.extent());
            assert!((p.arc_length(p.extent()) - expected).abs() < 1e-11 * expected, "mu {mu}");
        }
        for (r0, r1) in
            [(0.0, 0.6), (0.6, 0.0), (0.5, 0.5), (0.5, 0.5 + 1e-9), (0.5, 0.5004), (0.5, 0.5006), (1.0, 3.0)]
        {
            let s = Spiral { start_radius_m: r0, end_radius_m: r1, ..spiral() };
            let (a, h) = s.rates();
            let expected = simpson(|t| ((r0 + a * t) * (r0 + a * t) + a * a + h * h).sqrt(), s.angle());
            assert!((s.arc_length(s.angle()) - expected).abs() < 1e-10 * expected, "{r0} {r1}");
        }
    }

    #[test]
    fn a_bow_is_as_long_as_a_fine_sum_says_and_deviates_at_right_angles() {
        let bow = Bow {
            from: Vector3::new(1.0, 1.0, 2.0),
            to: Vector3::new(4.0, 5.0, 2.5),
            down_m: [0.6, -0.1, 0.05],
            side_m: [-0.9, 0.2, 0.03],
        };
        let expected = simpson(
            |u| {
                let h = 1e-6;
                (bow.at_fraction(u + h).position - bow.at_fraction(u - h).position).norm() / (2.0 * h)
            },
            1.0,
        );
        assert!((Lateral::new(bow).length_m() - expected).abs() < 1e-7 * expected);
        assert!((bow.length_m() - Lateral::new(bow).length_m()).abs() < 1e-12);
        let chord = bow.to - bow.from;
        for i in 1..20 {
            let u = f64::from(i) / 20.0;
            let off = bow.at_fraction(u).position - (bow.from + chord * u);
            // Seen from above, its progress along the line is uniform.
            assert!((off.x * chord.x + off.y * chord.y).abs() < 1e-12);
            assert!((bow.scaled(0.5).at_fraction(u).position - (bow.from + chord * u) - off * 0.5).norm() < 1e-12);
            // Between two points it hangs below their middle by no more than the sagitta.
            let (a, b) = (bow.at_fraction(u - 0.05).position, bow.at_fraction(u + 0.05).position);
            assert!((0.5 * (a.z + b.z) - bow.at_fraction(u).position.z).abs() <= bow.sagitta_m(0.1));
        }
    }

    #[test]
    fn the_papers_spiral_rises_and_widens() {
        let path = Path::Spiral(spiral());
        path.check().unwrap();
        let (start, end) = (path.start(), path.end());
        assert!((end.z - start.z - 1.125).abs() < 1e-12);
        let out = end - Vector3::new(4.8, 3.0, end.z);
        assert!((out.norm() - 0.60).abs() < 1e-12);
    }

    #[test]
    fn the_parabola_of_the_paper() {
        let p = Parabola { from: Vector3::new(0.0, 0.0, 2.0), to: Vector3::new(4.0, 0.0, 3.0), mu_per_m: 0.25 };
        assert!((p.zeta() - (1.0 - 0.25 * 16.0) / 4.0).abs() < 1e-15);
        let lowest = (0..=4000).map(|i| Path::Parabola(p).point(i as f64 * 0.002).z).fold(f64::INFINITY, f64::min);
        assert!((p.lowest_m() - lowest).abs() < 1e-5);
    }

    #[test]
    fn what_is_not_a_path_is_refused() {
        let p = Vector3::new(1.0, 1.0, 1.0);
        let bad = [
            Path::line(p, p),
            Path::line(p, Vector3::new(f64::NAN, 0.0, 0.0)),
            Path::Parabola(Parabola { from: p, to: p + Vector3::new(0.0, 0.0, 1.0), mu_per_m: 0.1 }),
            Path::Parabola(Parabola { from: p, to: p * 2.0, mu_per_m: f64::INFINITY }),
            Path::Spiral(Spiral { start_radius_m: -0.1, ..spiral() }),
            Path::Spiral(Spiral { turns: 0.0, ..spiral() }),
            Path::Lateral(Lateral::new(Bow { from: p, to: p + Vector3::z(), down_m: [0.0; 3], side_m: [0.1; 3] })),
            Path::Lateral(Lateral::new(Bow { from: p, to: p * 2.0, down_m: [f64::NAN; 3], side_m: [0.1; 3] })),
            Path::Dwell(Vector3::new(0.0, f64::NAN, 0.0)),
        ];
        for path in bad {
            let sentence = path.check().unwrap_err().to_string();
            assert!(sentence.len() > 20, "{sentence}");
        }
        assert!(Path::Dwell(p).check().is_ok());
    }
}
