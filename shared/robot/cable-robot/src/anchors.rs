//! Anchor positions of a robot that moves in space or in the plane y = 0.

use std::ops::{Deref, RangeInclusive};

use nalgebra::Vector3;

use crate::kinematics::{COLLINEAR_TOLERANCE, Frame};
use crate::pulley::{Both, CableGeometry, PairOfCables, Pulley, Tangents};
use crate::robot_error::{FARTHEST_M, RobotError, refuse};
use crate::{CableVec, MAX_CABLES};

/// Key of the robot file.
const KEY: &str = "anchors_m";

/// Key of the radii of the pulleys.
const RADIUS_KEY: &str = "pulley_radius_m";

/// Accepted radii of a pulley, m; 0 is an eye.
pub const RADII_M: RangeInclusive<f64> = 0.0..=0.5;

/// Anchors closer than this count as one point, m. Pulleys are larger.
const COINCIDENT_M: f64 = 1e-3;

/// Anchor positions: one per cable, from one per direction up to eight, finite and distinct; with the radius of the
/// pulley at each.
///
/// A planar robot has its anchors and its node in the plane y = 0 and moves in two directions, x and z. Positions, unit
/// vectors and forces remain 3-vectors with y = 0; ranks and redundancies are counted in the plane.
///
/// ```
/// use cable_robot::Anchors;
/// let anchors = Anchors::new(&[[0.0, 0.0, 3.0], [9.0, 0.0, 3.0], [4.0, 8.0, 3.0]])?;
/// assert_eq!((anchors.len(), anchors.dimensions()), (3, 3));
/// let planar = Anchors::planar(&[[0.0, 4.0], [6.0, 4.0], [6.0, 0.0], [0.0, 0.0]])?;
/// assert_eq!((planar.len(), planar.dimensions()), (4, 2));
/// assert_eq!(planar[1], cable_robot::Vector3::new(6.0, 0.0, 4.0));
/// # Ok::<(), cable_robot::RobotError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Anchors {
    points: [Vector3<f64>; MAX_CABLES],
    radii_m: [f64; MAX_CABLES],
    len: usize,
    planar: bool,
    /// Whether any, and whether every cable runs over a pulley.
    pulleys: [bool; 2],
    /// Of three anchors in space that are not on one line.
    frame: Option<Frame>,
}

impl Anchors {
    /// Checks and copies anchor positions [x, y, z], m.
    pub fn new(points: &[[f64; 3]]) -> Result<Self, RobotError> {
        if !(3..=MAX_CABLES).contains(&points.len()) {
            return refuse(KEY, format!("has {} points", points.len()), "3 to 8 points [x, y, z] in metres");
        }
        Self::from_points(points.iter().copied(), points.len(), false)
    }

    /// Checks and copies anchor positions [x, z] of a robot in the plane y = 0, m.
    pub fn planar(points: &[[f64; 2]]) -> Result<Self, RobotError> {
        Self::from_plane_points(points.iter().map(|[x, z]| [*x, 0.0, *z]), points.len())
    }

    /// Like [`Anchors::planar`], from points [x, y, z] with y = 0.
    pub fn in_plane(points: &[[f64; 3]]) -> Result<Self, RobotError> {
        if let Some(i) = points.iter().position(|p| p[1] != 0.0) {
            let problem = format!("number {} is {} m outside the plane y = 0", i + 1, points[i][1]);
            return refuse(KEY, problem, "points [x, z] in metres, or [x, 0, z]");
        }
        Self::from_plane_points(points.iter().copied(), points.len())
    }

    fn from_plane_points(points: impl Iterator<Item = [f64; 3]>, count: usize) -> Result<Self, RobotError> {
        if !(2..=MAX_CABLES).contains(&count) {
            return refuse(KEY, format!("has {count} points"), "2 to 8 points [x, z] in metres");
        }
        Self::from_points(points, count, true)
    }

    fn from_points(points: impl Iterator<Item = [f64; 3]>, len: usize, planar: bool) -> Result<Self, RobotError> {
        let (zeros, radii_m) = ([Vector3::zeros(); MAX_CABLES], [0.0; MAX_CABLES]);
        let mut result = Self { points: zeros, radii_m, len, planar, pulleys: [false; 2], frame: None };
        for (i, p) in points.enumerate() {
            if !p.iter().all(|v| v.is_finite() && v.abs() <= FARTHEST_M) {
                let problem = format!("number {} is [{}, {}, {}]", i + 1, p[0], p[1], p[2]);
                return refuse(KEY, problem, "finite coordinates in metres, at most 1e5");
            }
            let point = Vector3::from(p);
            if let Some(j) = result.points[..i].iter().position(|q| (q - point).norm() < COINCIDENT_M) {
                let problem = format!("numbers {} and {} coincide", j + 1, i + 1);
                return refuse(KEY, problem, "points at least 1 mm apart");
            }
            // Unused places have the last point, for pairs of pulleys.
            result.points[i..].fill(point);
        }
        if let ([a, b, c], false) = (&*result, planar) {
            result.frame = Frame::of([*a, *b, *c]);
        }
        Ok(result)
    }

    /// The frame in which three spheres around the anchors intersect; None for another number of anchors, for anchors
    /// on one line, and in the plane.
    #[inline]
    pub(crate) fn frame(&self) -> Option<&Frame> {
        self.frame.as_ref()
    }

    /// The same anchors with swivelling pulleys of these radii, m; 0 for an eye. See [`crate::pulley`].
    ///
    /// ```
    /// # use cable_robot::Anchors;
    /// let anchors = Anchors::new(&[[0.0, 0.0, 3.0], [9.0, 0.0, 3.0], [4.0, 8.0, 3.0]])?;
    /// assert!(!anchors.have_pulleys());
    /// let with = anchors.with_pulleys(&[0.04, 0.04, 0.0])?;
    /// assert!(with.have_pulleys() && with.pulley(0).radius_m == 0.04);
    /// assert_eq!(anchors.with_pulleys(&[-0.04; 3]).unwrap_err().key, "pulley_radius_m");
    /// # Ok::<(), cable_robot::RobotError>(())
    /// ```
    pub fn with_pulleys(&self, radii_m: &[f64]) -> Result<Self, RobotError> {
        if radii_m.len() != self.len {
            let problem = format!("has {} values for {} cables", radii_m.len(), self.len);
            return refuse(RADIUS_KEY, problem, "one radius per cable, in metres");
        }
        if let Some(i) = radii_m.iter().position(|r| !RADII_M.contains(r)) {
            let problem = format!("number {} is {}", i + 1, radii_m[i]);
            return refuse(RADIUS_KEY, problem, "radii of 0 (an eye) to 0.5 m");
        }
        let mut result = *self;
        for (i, radius_m) in radii_m.iter().enumerate() {
            result.radii_m[i..].fill(*radius_m);
        }
        result.pulleys = [radii_m.iter().any(|r| *r != 0.0), radii_m.iter().all(|r| *r != 0.0)];
        Ok(result)
    }

    /// Radius of the pulley at each anchor, m; 0 for an eye.
    pub fn radii_m(&self) -> &[f64] {
        &self.radii_m[..self.len]
    }

    /// True if any cable runs over a pulley instead of through an eye.
    pub fn have_pulleys(&self) -> bool {
        self.pulleys[0]
    }

    /// The cables two by two for a robot that has only pulleys; None if any cable runs through an eye.
    #[inline]
    pub(crate) fn pairs_of_pulleys(&self) -> Option<impl Iterator<Item = PairOfCables<'_>>> {
        let [_, only] = self.pulleys;
        only.then(|| self.pairs())
    }

    /// The same for a robot that has only pulleys or only eyes; None if it has both.
    #[inline]
    pub(crate) fn pairs_of_a_kind(&self) -> Option<impl Iterator<Item = PairOfCables<'_>>> {
        let [any, only] = self.pulleys;
        (any == only).then(|| self.pairs())
    }

    #[inline]
    fn pairs(&self) -> impl Iterator<Item = PairOfCables<'_>> {
        (0..self.len.div_ceil(2)).map_while(|k| self.pair(k))
    }

    /// The cables of the pair with this number, of any kind.
    #[inline(always)]
    pub(crate) fn both_cables(&self, k: usize, position: &Vector3<f64>) -> Option<Both> {
        let pair = self.pair(k)?;
        Some(match self.pulleys {
            [false, _] => Both::from_eyes(&pair, position),
            [_, true] => Tangents::of(&pair, position).both(),
            [true, false] => {
                let cable = |lane: usize| self.pulley((2 * k + lane).min(self.len - 1)).cable_at(position);
                Both::from_cables(&[cable(0), cable(1)])
            }
        })
    }

    /// Lengths to a position if the wheels were wider by this, m; NaN inside a wheel.
    #[must_use]
    pub fn lengths_with_wider_m(&self, position: &Vector3<f64>, wider_m: f64) -> CableVec {
        let lengths_m = self.pairs().map(|pair| {
            let radii_m = pair.radii_m.map(|radius_m| radius_m + wider_m);
            Tangents::of(&PairOfCables { radii_m: &radii_m, ..pair }, position).lengths_m()
        });
        CableVec::from_pairs(self.len, lengths_m)
    }

    #[inline]
    fn pair(&self, k: usize) -> Option<PairOfCables<'_>> {
        let (anchors, radii_m) = (self.points.as_chunks().0.get(k)?, self.radii_m.as_chunks().0.get(k)?);
        Some(PairOfCables { anchors, radii_m, planar: self.planar })
    }

    /// Calls a function for each cable at a position. At an eye the direction is zero, and over a pulley everything is
    /// NaN where it has no direction.
    #[inline(always)]
    pub(crate) fn each_cable(&self, position: &Vector3<f64>, mut then: impl FnMut(usize, &CableGeometry)) {
        let Some(pairs) = self.pairs_of_pulleys() else {
            for (i, pulley) in self.pulleys().enumerate() {
                then(i, &pulley.cable_at(position));
            }
            return;
        };
        for (k, pair) in pairs.enumerate() {
            for (i, cable) in (2 * k..self.len).zip(&pair.cables_to(position)) {
                then(i, cable);
            }
        }
    }

    /// The eye or pulley of a cable, counted from 0 and below the number of cables.
    pub fn pulley(&self, cable: usize) -> Pulley {
        Pulley { anchor: self.points[cable], radius_m: self.radii_m[cable], planar: self.planar }
    }

    /// The eye or pulley of each cable.
    pub fn pulleys(&self) -> impl ExactSizeIterator<Item = Pulley> + '_ {
        (0..self.len).map(|cable| self.pulley(cable))
    }

    /// Number of directions in which the node moves: 3, or 2 in the plane y = 0.
    pub fn dimensions(&self) -> usize {
        if self.planar { 2 } else { 3 }
    }

    /// True if all anchors lie on one straight line, so that the node can swing around it whatever the tensions. Always
    /// false for a planar robot, which cannot swing.
    ///
    /// ```
    /// # use cable_robot::Anchors;
    /// let in_a_row = [[0.0, 0.0, 3.0], [4.0, 0.0, 3.0], [8.0, 0.0, 3.0]];
    /// assert!(Anchors::new(&in_a_row)?.are_on_a_line());
    /// assert!(!Anchors::in_plane(&in_a_row)?.are_on_a_line());
    /// # Ok::<(), cable_robot::RobotError>(())
    /// ```
    pub fn are_on_a_line(&self) -> bool {
        !self.planar && on_a_line(self)
    }

    /// True if the node moves in the plane y = 0 only.
    pub fn is_planar(&self) -> bool {
        self.planar
    }
}

/// True if all points lie on one straight line.
pub fn on_a_line(points: &[Vector3<f64>]) -> bool {
    let [first, rest @ ..] = points else { return true };
    let farthest = rest.iter().map(|p| p - first).max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
    let Some(along) = farthest else { return true };
    // Area spanned by two sides, relative to the square of the longer one.
    rest.iter().all(|p| along.cross(&(p - first)).norm() <= COLLINEAR_TOLERANCE * along.norm_squared())
}

impl Deref for Anchors {
    type Target = [Vector3<f64>];
    fn deref(&self) -> &[Vector3<f64>] {
        &self.points[..self.len]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_of_anchors_differs_from_a_slender_triangle() {
        let row = |beside: f64| Anchors::new(&[[0.0, 0.0, 3.0], [4.0, beside, 3.0], [8.0, 0.0, 3.0]]).unwrap();
        assert!(row(0.0).are_on_a_line() && row(1e-12).are_on_a_line());
        assert!(!row(0.01).are_on_a_line());
        // not level, and starting from another of its points
        let slanting = [[1.0, 2.0, 3.0], [0.0, 0.0, 1.0], [2.0, 4.0, 5.0], [3.0, 6.0, 7.0]];
        assert!(Anchors::new(&slanting).unwrap().are_on_a_line());
        let mut bent = slanting;
        bent[2][2] += 0.1;
        assert!(!Anchors::new(&bent).unwrap().are_on_a_line());
    }

    #[test]
    fn a_plane_accepts_only_points_with_y_0() {
        let corners = [[0.0, 0.0, 4.0], [6.0, 0.0, 4.0], [6.0, 0.0, 0.0], [0.0, 0.0, 0.0]];
        let planar = Anchors::in_plane(&corners).unwrap();
        assert_eq!(planar, Anchors::planar(&corners.map(|[x, _, z]| [x, z])).unwrap());
        // The same points in space: four cables that hold nothing sideways.
        assert_ne!(planar, Anchors::new(&corners).unwrap());
        for bad in [&[[0.0, 0.0, 4.0], [6.0, 0.1, 4.0]][..], &corners[..1], &[[0.0, 0.0, 4.0]; 2], &[[0.0; 3]; 9]] {
            assert_eq!(Anchors::in_plane(bad).unwrap_err().key, "anchors_m");
        }
    }
}
