//! Obstacles: upright bodies, e.g. trunks and walls, that neither the node nor a cable may touch.
//!
//! An obstacle is a footprint in x and y, a disc or a polygon, between two heights. Lengths in m. The distance to a
//! body is 0 inside it.

use nalgebra::{Vector2, Vector3};

use crate::robot_error::{FARTHEST_M, RobotError, refuse};

/// Largest number of corners of a footprint.
pub const MAX_CORNERS: usize = 6;

/// Length of a cable from its pulley on which it may be close to a body, m: pulleys hang on trunks and masts, which are
/// at most about that wide.
const ROOT_M: f64 = 1.0;
/// Steps of the check of that length.
const ROOT_STEPS: u32 = 50;
/// Pieces of a hanging cable. Each is checked down to its own chord and what the parabola hangs below that, so that the
/// band below the straight line is at most 0.4 % of the sag too wide, and has no steps: a step between two pieces would
/// hide that the cable approaches a body beside it.
const HANGING_PIECES: u32 = 16;
/// Approach within a step that counts as rounding, m.
const APPROACH_M: f64 = 1e-9;

const KEY: &str = "obstacle";

/// Largest number of obstacles of a robot.
pub const MAX_OBSTACLES: usize = 16;

/// Contact with an obstacle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Contact {
    /// Index of the obstacle, from 0.
    pub obstacle: usize,
    /// Index of the cable, from 0; None for the node.
    pub cable: Option<usize>,
}

/// An upright body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Obstacle {
    footprint: Footprint,
    bottom_m: f64,
    top_m: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Footprint {
    Disc { center: Vector2<f64>, radius_m: f64 },
    Polygon { corners: [Vector2<f64>; MAX_CORNERS], count: usize },
}

impl Obstacle {
    /// Creates an upright cylinder between two heights.
    ///
    /// # Errors
    /// A radius that is not above 0, heights in the wrong order, or coordinates that are not finite.
    pub fn cylinder(center_m: [f64; 2], radius_m: f64, heights_m: [f64; 2]) -> Result<Self, RobotError> {
        coordinates(&center_m)?;
        if !(radius_m > 0.0 && radius_m <= FARTHEST_M) {
            return refuse(KEY, format!("has a radius of {radius_m} m"), "a finite radius above 0, in metres");
        }
        Self::between(heights_m, Footprint::Disc { center: center_m.into(), radius_m })
    }

    /// Creates an upright prism over a polygon, whose corners may have any order of rotation, between two heights.
    ///
    /// ```
    /// use cable_robot::{Obstacle, Vector3};
    /// let wall = Obstacle::prism(&[[0.0, 0.0], [4.0, 0.0], [4.0, 0.2], [0.0, 0.2]], [0.0, 2.0])?;
    /// let above = Vector3::new(1.0, 0.1, 2.5);
    /// assert_eq!(wall.distance_m(&above), 0.5);
    /// assert!(!wall.is_near(&above, &Vector3::new(3.0, 0.1, 2.2), 0.1));
    /// assert!(wall.is_near(&above, &Vector3::new(1.0, 3.0, 1.9), 0.6));
    /// # Ok::<(), cable_robot::RobotError>(())
    /// ```
    ///
    /// # Errors
    /// Fewer than 3 or more than [`MAX_CORNERS`] corners, a polygon without area, heights in the wrong order, or
    /// coordinates that are not finite.
    pub fn prism(corners_m: &[[f64; 2]], heights_m: [f64; 2]) -> Result<Self, RobotError> {
        if !(3..=MAX_CORNERS).contains(&corners_m.len()) {
            return refuse(KEY, format!("has {} corners", corners_m.len()), "3 to 6 corners, [x, y] in metres");
        }
        let mut corners = [Vector2::zeros(); MAX_CORNERS];
        for (corner, given) in corners.iter_mut().zip(corners_m) {
            coordinates(given)?;
            *corner = (*given).into();
        }
        let count = corners_m.len();
        let twice_the_area: f64 = edges(&corners[..count]).map(|(a, b)| a.perp(&b)).sum();
        if twice_the_area.abs() < 1e-9 {
            return refuse(KEY, "has a polygon without area".to_owned(), "corners in their order around the body");
        }
        if crosses_itself(&corners[..count]) {
            return refuse(KEY, "has edges that cross or touch".to_owned(), "corners in their order around the body");
        }
        Self::between(heights_m, Footprint::Polygon { corners, count })
    }

    fn between([bottom_m, top_m]: [f64; 2], footprint: Footprint) -> Result<Self, RobotError> {
        coordinates(&[bottom_m, top_m])?;
        if bottom_m >= top_m {
            let problem = format!("extends from {bottom_m} m to {top_m} m");
            return refuse(KEY, problem, "[lowest, highest] in metres, the lowest first");
        }
        Ok(Self { footprint, bottom_m, top_m })
    }

    /// Computes the distance from a position to the body, m; 0 inside.
    pub fn distance_m(&self, position: &Vector3<f64>) -> f64 {
        let beside_m = self.footprint.distance_m(&position.xy(), &position.xy());
        let above_m = (self.bottom_m - position.z).max(position.z - self.top_m).max(0.0);
        libm::hypot(beside_m, above_m)
    }

    /// True if a cable from its pulley at `start` to the node at `end`, or a cable that sags by up to `sag_m` below
    /// this line in its middle, comes closer than `margin_m` to the body. Within a metre of the pulley it may be
    /// closer, but must not approach the body.
    pub fn blocks_cable(&self, start: &Vector3<f64>, end: &Vector3<f64>, margin_m: f64, sag_m: f64) -> bool {
        if !self.is_near_below(start, end, margin_m, sag_m) {
            return false;
        }
        let length_m = (end - start).norm();
        if !(length_m > 0.0) {
            return true;
        }
        let root_share = (ROOT_M / length_m).min(1.0);
        if root_share < 1.0 && self.is_near_hanging([start, end], root_share, margin_m, sag_m) {
            return true;
        }
        let root = start + (end - start) * root_share;
        let margin_m = margin_m + parabola(sag_m, root_share);
        let mut before_m = self.distance_m(start);
        (1..=ROOT_STEPS).any(|k| {
            let distance_m = self.distance_m(&(start + (root - start) * (f64::from(k) / f64::from(ROOT_STEPS))));
            let approaches = distance_m < margin_m && distance_m < before_m - APPROACH_M;
            before_m = distance_m;
            approaches
        })
    }

    /// True if the part of a line from a share of its length on, or a parabola below that sags by up to `sag_m`, comes
    /// closer than `margin_m` to the body.
    fn is_near_hanging(&self, [start, end]: [&Vector3<f64>; 2], from_share: f64, margin_m: f64, sag_m: f64) -> bool {
        let at = |u: f64| start + (end - start) * u;
        if sag_m == 0.0 {
            return self.is_near(&at(from_share), end, margin_m);
        }
        let u = |k: u32| from_share + (1.0 - from_share) * f64::from(k) / f64::from(HANGING_PIECES);
        let piece = (1.0 - from_share) / f64::from(HANGING_PIECES);
        let below_chord_m = sag_m * piece * piece;
        (0..HANGING_PIECES).any(|k| {
            let ends = [u(k), u(k + 1)];
            let depths_m = ends.map(|u| parabola(sag_m, u) + below_chord_m);
            self.is_near_band(ends.map(at).each_ref(), margin_m, depths_m)
        })
    }

    /// True if the straight line from `a` to `b` comes closer than `margin_m` to the body. Around its upper and lower
    /// rim the margin is up to a factor √2 larger. A line with an end that is not finite is near.
    pub fn is_near(&self, a: &Vector3<f64>, b: &Vector3<f64>, margin_m: f64) -> bool {
        self.is_near_below(a, b, margin_m, 0.0)
    }

    /// The same for the band between the line and the line `depth_m` below it.
    pub fn is_near_below(&self, a: &Vector3<f64>, b: &Vector3<f64>, margin_m: f64, depth_m: f64) -> bool {
        self.is_near_band([a, b], margin_m, [depth_m; 2])
    }

    /// The same for a band whose depth changes evenly between its ends.
    fn is_near_band(&self, [a, b]: [&Vector3<f64>; 2], margin_m: f64, depths_m: [f64; 2]) -> bool {
        let all = a.iter().chain(b.iter()).chain(&depths_m);
        if !(all.into_iter().all(|x| x.is_finite()) && margin_m.is_finite()) {
            return true;
        }
        // The line is above the lower end of the body, and the lower edge of the band below its upper end.
        let (rise, deepening) = (b.z - a.z, depths_m[1] - depths_m[0]);
        let above_m = a.z - (self.bottom_m - margin_m);
        let below_m = self.top_m + margin_m + depths_m[0] - a.z;
        let part = not_negative((0.0, 1.0), above_m, rise);
        let Some((enter, leave)) = part.and_then(|part| not_negative(part, below_m, deepening - rise)) else {
            return false;
        };
        let along = |t: f64| (a + (b - a) * t).xy();
        self.footprint.distance_m(&along(enter), &along(leave)) <= margin_m
    }
}

impl Footprint {
    /// Computes the distance from the straight line from `a` to `b` to the footprint; 0 if they touch.
    fn distance_m(&self, a: &Vector2<f64>, b: &Vector2<f64>) -> f64 {
        match self {
            Self::Disc { center, radius_m } => (to_segment_m(center, a, b) - radius_m).max(0.0),
            Self::Polygon { corners, count } => {
                let corners = &corners[..*count];
                // A line that enters the polygon has its start inside or crosses an edge.
                if contains(corners, a) {
                    return 0.0;
                }
                edges(corners).map(|(c, d)| between_segments_m(a, b, &c, &d)).fold(f64::INFINITY, f64::min)
            }
        }
    }
}

/// The part of an interval in which `at_0 + slope t` is not negative.
fn not_negative((enter, leave): (f64, f64), at_0: f64, slope: f64) -> Option<(f64, f64)> {
    let (enter, leave) = if slope > 0.0 {
        (enter.max(-at_0 / slope), leave)
    } else if slope < 0.0 {
        (enter, leave.min(-at_0 / slope))
    } else {
        (enter, if at_0 >= 0.0 { leave } else { f64::NEG_INFINITY })
    };
    (enter <= leave).then_some((enter, leave))
}

/// Depth of a parabola below its chord at a share of the chord; `sag_m` in the middle.
fn parabola(sag_m: f64, share: f64) -> f64 {
    4.0 * sag_m * share * (1.0 - share)
}

fn coordinates(values: &[f64; 2]) -> Result<(), RobotError> {
    match values.iter().find(|value| !(value.is_finite() && value.abs() <= FARTHEST_M)) {
        None => Ok(()),
        Some(value) => refuse(KEY, format!("contains {value}"), "finite coordinates in metres"),
    }
}

fn edges(corners: &[Vector2<f64>]) -> impl Iterator<Item = (Vector2<f64>, Vector2<f64>)> + '_ {
    corners.iter().zip(corners.iter().cycle().skip(1)).map(|(a, b)| (*a, *b))
}

/// True if two edges that are no neighbours touch, or an edge has no length.
fn crosses_itself(corners: &[Vector2<f64>]) -> bool {
    let count = corners.len();
    edges(corners).enumerate().any(|(i, (a, b))| {
        let others = edges(corners).enumerate().skip(i + 2).filter(|(k, _)| !(i == 0 && k + 1 == count));
        (b - a).norm() < 1e-9 || others.into_iter().any(|(_, (c, d))| between_segments_m(&a, &b, &c, &d) < 1e-9)
    })
}

/// True if a point is inside a polygon: a ray toward +x crosses its edges an odd number of times.
fn contains(corners: &[Vector2<f64>], p: &Vector2<f64>) -> bool {
    edges(corners)
        .filter(|(a, b)| (a.y > p.y) != (b.y > p.y) && p.x < a.x + (b.x - a.x) * ((p.y - a.y) / (b.y - a.y)))
        .count()
        % 2
        == 1
}

/// Computes the distance from a point to a segment.
fn to_segment_m(p: &Vector2<f64>, a: &Vector2<f64>, b: &Vector2<f64>) -> f64 {
    let along = b - a;
    let squared = along.norm_squared();
    let t = if squared > 0.0 { ((p - a).dot(&along) / squared).clamp(0.0, 1.0) } else { 0.0 };
    (p - (a + along * t)).norm()
}

/// Computes the distance between two segments; 0 if they cross.
fn between_segments_m(a: &Vector2<f64>, b: &Vector2<f64>, c: &Vector2<f64>, d: &Vector2<f64>) -> f64 {
    let side = |p: &Vector2<f64>, q: &Vector2<f64>, r: &Vector2<f64>| (q - p).perp(&(r - p));
    if side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0 {
        return 0.0;
    }
    [to_segment_m(a, c, d), to_segment_m(b, c, d), to_segment_m(c, a, b), to_segment_m(d, a, b)]
        .into_iter()
        .fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn obstacle() -> impl Strategy<Value = Obstacle> {
        let heights = || (-1.0..1.0f64, 0.1..3.0f64).prop_map(|(bottom, height)| [bottom, bottom + height]);
        // A star around a centre: neither convex nor crossing itself.
        let star = (proptest::collection::vec(0.2..1.5f64, 3..=MAX_CORNERS), -1.0..1.0f64, -1.0..1.0f64);
        prop_oneof![
            (-1.0..1.0f64, -1.0..1.0f64, 0.05..1.0f64, heights())
                .prop_map(|(x, y, radius_m, heights_m)| Obstacle::cylinder([x, y], radius_m, heights_m).unwrap()),
            (star, heights()).prop_map(|((radii, x, y), heights_m)| {
                let turn = std::f64::consts::TAU / radii.len() as f64;
                let corner = |(i, r): (usize, &f64)| {
                    let (sin, cos) = (i as f64 * turn).sin_cos();
                    [x + r * cos, y + r * sin]
                };
                let corners: Vec<_> = radii.iter().enumerate().map(corner).collect();
                Obstacle::prism(&corners, heights_m).unwrap()
            }),
        ]
    }

    fn point() -> impl Strategy<Value = Vector3<f64>> {
        [-3.0..3.0f64, -3.0..3.0f64, -3.0..4.0f64].prop_map(Vector3::from)
    }

    proptest! {
        #[test]
        fn a_line_is_near_if_one_of_its_points_is(body in obstacle(), a in point(), b in point(), margin_m in 0.0..0.5f64) {
            const PIECES: usize = 2000;
            let least_m = (0..=PIECES)
                .map(|i| body.distance_m(&(a + (b - a) * (i as f64 / PIECES as f64))))
                .fold(f64::INFINITY, f64::min);
            let step_m = (b - a).norm() / PIECES as f64;
            if least_m < margin_m {
                prop_assert!(body.is_near(&a, &b, margin_m), "{least_m}");
            }
            if least_m > margin_m * std::f64::consts::SQRT_2 + step_m {
                prop_assert!(!body.is_near(&a, &b, margin_m), "{least_m}");
            }
        }

        #[test]
        fn a_cable_is_blocked_if_a_point_of_the_hanging_one_is_near(
            body in obstacle(), a in point(), b in point(), margin_m in 0.0..0.3f64, sag_m in 0.0..0.8f64,
        ) {
            const PIECES: usize = 1000;
            let length_m = (b - a).norm();
            prop_assume!(length_m > ROOT_M);
            let hanging = |share: f64| {
                (0..=PIECES).map(|i| i as f64 / PIECES as f64).filter(|u| u * length_m > ROOT_M).map(|u| {
                    let depth_m = parabola(share * sag_m, u);
                    body.distance_m(&(a + (b - a) * u - Vector3::new(0.0, 0.0, depth_m)))
                }).fold(f64::INFINITY, f64::min)
            };
            for share in [0.0, 0.4, 1.0] {
                if hanging(share) < margin_m {
                    prop_assert!(body.blocks_cable(&a, &b, margin_m, sag_m), "{share}");
                }
            }
            // What is blocked stays blocked with more of either.
            if body.blocks_cable(&a, &b, margin_m, 0.5 * sag_m) {
                prop_assert!(body.blocks_cable(&a, &b, margin_m + 0.05, 0.5 * sag_m));
                prop_assert!(body.blocks_cable(&a, &b, margin_m, sag_m));
            }
        }

        #[test]
        fn distances_change_by_at_most_the_way(body in obstacle(), a in point(), b in point()) {
            prop_assert!((body.distance_m(&a) - body.distance_m(&b)).abs() <= (a - b).norm() + 1e-12);
        }
    }

    #[test]
    fn bodies_without_extent_are_rejected() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        Obstacle::prism(&square, [0.0, 1.0]).unwrap();
        assert!(Obstacle::prism(&square, [1.0, 1.0]).is_err());
        assert!(Obstacle::prism(&square[..2], [0.0, 1.0]).is_err());
        assert!(Obstacle::prism(&[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]], [0.0, 1.0]).is_err());
        assert!(Obstacle::prism(&[[0.0; 2]; 9], [0.0, 1.0]).is_err());
        // Two corners in the wrong order, a star of five, and a corner twice.
        assert!(Obstacle::prism(&[[0.0, 0.0], [3.0, 1.0], [3.0, 0.0], [0.0, 1.5]], [0.0, 1.0]).is_err());
        let star = [[0.0, 1.0], [0.59, -0.81], [-0.95, 0.31], [0.95, 0.31], [-0.59, -0.81]];
        assert!(Obstacle::prism(&star, [0.0, 1.0]).is_err());
        assert!(Obstacle::prism(&[[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [0.0, 1.0]], [0.0, 1.0]).is_err());
        assert!(Obstacle::cylinder([0.0, 0.0], 0.0, [0.0, 1.0]).is_err());
        assert!(Obstacle::cylinder([f64::NAN, 0.0], 0.1, [0.0, 1.0]).is_err());
    }

    #[test]
    fn what_is_not_a_number_is_near() {
        let trunk = Obstacle::cylinder([0.0, 0.0], 0.2, [0.0, 5.0]).unwrap();
        let wall = Obstacle::prism(&[[0.0, 0.0], [4.0, 0.0], [4.0, 0.2]], [0.0, 2.0]).unwrap();
        let (here, nowhere) = (Vector3::new(50.0, 50.0, 50.0), Vector3::repeat(f64::NAN));
        for body in [trunk, wall] {
            assert!(body.is_near(&nowhere, &here, 0.1) && body.is_near(&here, &nowhere, 0.1));
            assert!(!body.is_near(&here, &here, 0.1));
        }
    }
}
