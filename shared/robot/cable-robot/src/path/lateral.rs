//! A path that also swings sideways: the straight line and three harmonics down and to the side (an extension of
//! section VIII of the paper, whose paths stay in a vertical plane).
//!
//! A [`Bow`] is the shape by its fraction u of the straight line, from 0 to 1: X(u) = from + (to - from) u + Σ sin(kπu)
//! (side_k e - down_k z), k = 1..3, where e is the horizontal unit vector to the left of the direction from start to
//! end. A [`Lateral`] is the same shape by arc length. The arc length has no closed form: it is integrated once by
//! Gauss's rule in panels.

use nalgebra::Vector3;

use super::curves::{by_arc_length, invert};
use super::shapes::PathPoint;

/// Number of harmonics in each of the two directions.
pub const HARMONICS: usize = 3;

/// Panels of the arc length integral: the phase of the third harmonic changes by 0.6 rad in each.
const PANELS: usize = 16;

/// Gauss-Legendre nodes and weights on -1..1, five points: exact for polynomials of degree 9.
const GAUSS: [(f64, f64); 5] = [
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (0.906_179_845_938_664, 0.236_926_885_056_189_08),
    (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
];

/// Deviation of a path from the straight line between two points, as harmonics.
///
/// ```
/// use cable_robot::Vector3;
/// use cable_robot::path::Bow;
/// let (from, to) = (Vector3::new(0.0, 0.0, 2.0), Vector3::new(4.0, 0.0, 2.0));
/// let bow = Bow { from, to, down_m: [0.5, 0.0, 0.0], side_m: [0.3, 0.0, 0.0] };
/// let middle = bow.at_fraction(0.5);
/// // Half a metre down and 0.3 m to the left, which is +y here.
/// assert!((middle.position - Vector3::new(2.0, 0.3, 1.5)).norm() < 1e-12);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bow {
    /// Start, m.
    pub from: Vector3<f64>,
    /// End, m.
    pub to: Vector3<f64>,
    /// Amplitudes below the straight line, m, of the half wave, the full wave, and one and a half waves.
    pub down_m: [f64; HARMONICS],
    /// Amplitudes to the left of the straight line, m, likewise.
    pub side_m: [f64; HARMONICS],
}

/// Point of a bow with its derivatives with respect to the fraction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BowPoint {
    /// Position, m.
    pub position: Vector3<f64>,
    /// dX/du, m.
    pub first: Vector3<f64>,
    /// d²X/du², m.
    pub second: Vector3<f64>,
}

impl Bow {
    /// Computes the point at a fraction of the straight line.
    pub fn at_fraction(&self, u: f64) -> BowPoint {
        let chord = self.to - self.from;
        let extent = self.extent();
        let left = if extent > 0.0 { Vector3::new(-chord.y, chord.x, 0.0) / extent } else { Vector3::zeros() };
        let angle = std::f64::consts::PI * u;
        let (sin, cos) = (libm::sin(angle), libm::cos(angle));
        let mut point = BowPoint { position: self.from + chord * u, first: chord, second: Vector3::zeros() };
        // sin and cos of kπu by the addition formulas.
        let (mut s, mut c) = (sin, cos);
        for k in 0..HARMONICS {
            let frequency = std::f64::consts::PI * (k + 1) as f64;
            let bow = left * self.side_m[k] - Vector3::new(0.0, 0.0, self.down_m[k]);
            point.position += bow * s;
            point.first += bow * (frequency * c);
            point.second -= bow * (frequency * frequency * s);
            (s, c) = (s * cos + c * sin, c * cos - s * sin);
        }
        point
    }

    /// Horizontal distance from start to end, m.
    pub fn extent(&self) -> f64 {
        let d = self.to - self.from;
        (d.x * d.x + d.y * d.y).sqrt()
    }

    /// Arc length, m.
    pub fn length_m(&self) -> f64 {
        (0..PANELS).map(|i| self.panel_m(i)).sum()
    }

    /// The same bow with its deviation from the straight line multiplied by `share`.
    pub fn scaled(&self, share: f64) -> Self {
        Self { down_m: self.down_m.map(|m| m * share), side_m: self.side_m.map(|m| m * share), ..*self }
    }

    /// Upper bound for the depth of the path below the chord between two of its points that are `step` of u apart, m,
    /// from its second derivative.
    pub fn sagitta_m(&self, step: f64) -> f64 {
        let bend = |k: usize| (std::f64::consts::PI * (k + 1) as f64).powi(2) * self.down_m[k].abs();
        (0..HARMONICS).map(bend).sum::<f64>() * step * step / 8.0
    }

    fn panel_m(&self, i: usize) -> f64 {
        self.part_m(i as f64 / PANELS as f64, 1.0 / PANELS as f64)
    }

    /// Arc length from u to u + `step`, m.
    fn part_m(&self, u: f64, step: f64) -> f64 {
        let half = 0.5 * step;
        GAUSS.iter().map(|(at, weight)| weight * self.at_fraction(u + half * (1.0 + at)).first.norm()).sum::<f64>()
            * half
    }
}

/// A bow parametrised by arc length.
///
/// ```
/// use cable_robot::Path;
/// use cable_robot::Vector3;
/// use cable_robot::path::{Bow, Lateral};
/// let bow = Bow {
///     from: Vector3::new(2.0, 2.0, 2.0),
///     to: Vector3::new(7.0, 3.0, 2.2),
///     down_m: [0.4, 0.0, 0.05],
///     side_m: [-0.6, 0.1, 0.0],
/// };
/// let path = Path::Lateral(Lateral::new(bow));
/// path.check()?;
/// let middle = path.at(0.5 * path.length());
/// assert!((middle.tangent.norm() - 1.0).abs() < 1e-12);
/// # Ok::<(), cable_robot::path::PathError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lateral {
    bow: Bow,
    /// Arc length from the start to the end of each panel, m.
    reached_m: [f64; PANELS],
}

impl Lateral {
    /// Integrates the arc length of a bow.
    pub fn new(bow: Bow) -> Self {
        let mut reached_m = [0.0; PANELS];
        let mut sum = 0.0;
        for (i, reached) in reached_m.iter_mut().enumerate() {
            sum += bow.panel_m(i);
            *reached = sum;
        }
        Self { bow, reached_m }
    }

    /// Shape.
    pub fn bow(&self) -> &Bow {
        &self.bow
    }

    /// Arc length, m.
    pub fn length_m(&self) -> f64 {
        self.reached_m[PANELS - 1]
    }

    /// True if the path is the straight line.
    pub fn is_straight(&self) -> bool {
        self.bow.down_m.iter().chain(&self.bow.side_m).all(|m| *m == 0.0)
    }

    pub(super) fn at(&self, s: f64) -> PathPoint {
        let panel = self.reached_m.partition_point(|reached| *reached < s).min(PANELS - 1);
        let before = if panel == 0 { 0.0 } else { self.reached_m[panel - 1] };
        let (start, step) = (panel as f64 / PANELS as f64, 1.0 / PANELS as f64);
        let within = invert(
            |x| self.bow.part_m(start, x),
            |x| self.bow.at_fraction(start + x).first.norm(),
            s - before,
            self.reached_m[panel] - before,
            step,
        );
        let point = self.bow.at_fraction(start + within);
        let at = by_arc_length(point.position, point.first, point.second);
        // Rounding in the sines must not leave the end point off target.
        if s >= self.length_m() { PathPoint { position: self.bow.to, ..at } } else { at }
    }
}
