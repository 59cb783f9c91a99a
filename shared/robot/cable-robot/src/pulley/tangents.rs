//! The tangents to two wheels at once.
//!
//! Roots, quotients and a polynomial that wait for each other leave most of a processor idle. Two wheels in the two
//! lanes of its registers take the time of one, without branches. Lanes add, multiply, divide and take roots by IEEE
//! 754, so each has the bits of the same scalar operations, on every processor.
//!
//! With the symbols of [`crate::pulley`], `out` and `up` are c² u: the division by c² comes last.

use core::f64::consts::{FRAC_PI_2, FRAC_PI_4, SQRT_2, TAU};

use nalgebra::Vector3;
use wide::f64x2;

use super::geometry::{CableGeometry, SMALLEST_M};

/// Coefficients of (arctan x / x - 1) / x² over the powers of x², for |x| up to tan(π / 8): interpolation at the points
/// of Chebyshev in 50 digits. The error of twice the arc tangent is at most 1.1e-16.
const ARC_TANGENT: [f64; 10] = [
    -0.333_333_333_333_332_5,
    0.199_999_999_998_984_07,
    -0.142_857_142_660_966_2,
    0.111_111_096_365_343_61,
    -0.090_908_525_571_760_49,
    0.076_910_551_583_931_5,
    -0.066_496_136_952_916_69,
    0.057_363_321_659_076_43,
    -0.044_833_346_222_728_86,
    0.022_750_526_993_361_67,
];

/// Two cables with their anchors and their radii; an odd last one twice.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PairOfCables<'a> {
    pub anchors: &'a [Vector3<f64>; 2],
    pub radii_m: &'a [f64; 2],
    pub planar: bool,
}

impl PairOfCables<'_> {
    /// Both cables to a position.
    #[inline(always)]
    pub(crate) fn cables_to(&self, position: &Vector3<f64>) -> [CableGeometry; 2] {
        let tangents = Tangents::of(self, position);
        if tangents.have_directions() { tangents.cables() } else { [CableGeometry::NONE; 2] }
    }
}

/// Two wheels, and the node relative to where the cables enter them.
#[derive(Debug, Clone, Copy)]
struct Wheels {
    x: f64x2,
    y: f64x2,
    z: f64x2,
    radius: f64x2,
    /// 1 in space and 0 in the plane.
    turning: f64,
}

impl Wheels {
    #[inline(always)]
    fn of(pair: &PairOfCables, position: &Vector3<f64>) -> Self {
        let [a, b] = pair.anchors;
        let x = f64x2::splat(position.x) - f64x2::new([a.x, b.x]);
        let y = f64x2::splat(position.y) - f64x2::new([a.y, b.y]);
        let z = f64x2::splat(position.z) - f64x2::new([a.z, b.z]);
        let radius = f64x2::new(*pair.radii_m);
        if pair.planar {
            Self { x, y: f64x2::ZERO, z, radius, turning: 0.0 }
        } else {
            Self { x, y, z, radius, turning: 1.0 }
        }
    }
}

/// The tangents to two wheels in their planes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tangents {
    wheels: Wheels,
    /// Distance of the node from the axis, m.
    p: f64x2,
    /// Free length, m; NaN inside the wheel.
    free: f64x2,
    /// c² u, outward and up, m².
    out: f64x2,
    up: f64x2,
    /// c², m².
    square: f64x2,
}

impl Tangents {
    /// Computes the tangents of two cables of a robot. In the plane the y of the position does not count.
    #[inline(always)]
    pub(crate) fn of(pair: &PairOfCables, position: &Vector3<f64>) -> Self {
        Self::new(Wheels::of(pair, position))
    }

    #[inline(always)]
    fn new(wheels: Wheels) -> Self {
        let Wheels { x, y, z, radius: r, .. } = wheels;
        let level = x * x + y * y;
        let p = level.sqrt();
        let free_square = (level + z * z) - (r + r) * p;
        let free = free_square.sqrt();
        let q = p - r;
        Self { wheels, p, free, out: r * z + free * q, up: free * z - r * q, square: free_square + r * r }
    }

    /// True if both cables have a direction.
    #[inline(always)]
    pub(crate) fn have_directions(&self) -> bool {
        let smallest = f64x2::splat(SMALLEST_M);
        // All three are false for NaN.
        let finite = self.free.simd_lt(f64x2::splat(f64::INFINITY));
        (self.free.simd_ge(smallest) & self.p.simd_ge(smallest) & finite).all()
    }

    /// Computes the lengths from the anchors, m; NaN inside the wheels.
    ///
    /// Tangent of the half angle between the direction and the nearest diagonal: (|out| - |up|) / (√2 c² + |out| +
    /// |up|), within ± tan(π / 8). The diagonal and the side follow from signs, and enter before the polynomial, on
    /// which everything waits.
    #[inline(always)]
    pub(crate) fn lengths_m(&self) -> [f64; 2] {
        self.lengths().to_array()
    }

    #[inline(always)]
    fn lengths(&self) -> f64x2 {
        let Self { wheels: Wheels { z, radius: r, .. }, free, out, up, square, .. } = *self;
        let (a, b) = (out.abs(), up.abs());
        let down = up.simd_lt(f64x2::ZERO);
        let inward = out.simd_lt(f64x2::ZERO);
        let side = (down ^ inward) & f64x2::splat(-0.0);
        let x = ((a - b) / ((square * f64x2::splat(SQRT_2) + a) + b)) ^ side;
        let diagonal = f64x2::splat(FRAC_PI_4) + (down & f64x2::splat(FRAC_PI_2));
        // Only below the wheel the cable wraps more than half a turn; above, a negative angle is rounding.
        let turned = (z.simd_lt(f64x2::ZERO) & f64x2::splat(TAU)) - diagonal;
        let diagonal = inward.bitselect(turned, diagonal);
        let arc = r * (x + x);
        let w = x * x;
        let w2 = w * w;
        let w4 = w2 * w2;
        let c = |k: usize| f64x2::splat(ARC_TANGENT[k]);
        let pair = |k: usize| c(k) + w * c(k + 1);
        let third = arc * w;
        let first = ((free + r * diagonal) + arc) + third * (pair(0) + w2 * pair(2));
        first + (third * w4) * ((pair(4) + w2 * pair(6)) + w4 * pair(8))
    }

    /// Computes the unit vectors of the free cables; without meaning unless [`Self::have_directions`].
    #[inline(always)]
    pub(crate) fn directions(&self) -> [Vector3<f64>; 2] {
        let Self { wheels: Wheels { x, y, .. }, p, out, up, square, .. } = *self;
        let scale = f64x2::splat(1.0) / (p * square);
        let per_p = out * scale;
        lanes([x * per_p, y * per_p, up * (p * scale)])
    }

    /// Computes everything of both cables; without meaning unless [`Self::have_directions`].
    #[inline(always)]
    pub(crate) fn both(&self) -> Both {
        let Self { wheels: Wheels { x, y, turning, .. }, p, free, out, up, square } = *self;
        let scale = f64x2::splat(1.0) / (p * square);
        let sideways = out * scale;
        let per_p = square * scale;
        let per_free = f64x2::splat(1.0) / free;
        Both {
            length: self.lengths(),
            direction: [x * sideways, y * sideways, up * (p * scale)],
            per_free,
            bend: (sideways - per_free) * f64x2::splat(turning),
            across: [-(y * per_p), x * per_p],
        }
    }

    /// As [`Self::both`], cable by cable.
    #[inline(always)]
    pub(crate) fn cables(&self) -> [CableGeometry; 2] {
        let Both { length, direction, bend, across: [ax, ay], .. } = self.both();
        let ([length, free, bend], direction) = ([length, self.free, bend].map(f64x2::to_array), lanes(direction));
        let across = lanes([ax, ay, f64x2::ZERO]);
        [0, 1].map(|k| CableGeometry {
            length_m: length[k],
            direction: direction[k],
            free_m: free[k],
            bend_per_m: bend[k],
            across: across[k],
        })
    }

    /// Free lengths, m.
    #[inline(always)]
    pub(crate) fn free_m(&self) -> [f64; 2] {
        self.free.to_array()
    }
}

/// Two cables in two lanes, with the symbols of [`CableGeometry`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Both {
    pub length: f64x2,
    pub direction: [f64x2; 3],
    /// 1 / free length, 1/m.
    pub per_free: f64x2,
    pub bend: f64x2,
    /// x and y; z is 0.
    pub across: [f64x2; 2],
}

impl Both {
    /// No cables.
    pub(crate) const NONE: Self = Self {
        length: f64x2::ZERO,
        direction: [f64x2::ZERO; 3],
        per_free: f64x2::ZERO,
        bend: f64x2::ZERO,
        across: [f64x2::ZERO; 2],
    };

    /// Computes two cables of a robot without pulleys.
    #[inline(always)]
    pub(crate) fn from_eyes(pair: &PairOfCables, position: &Vector3<f64>) -> Self {
        let Wheels { x, y, z, .. } = Wheels::of(pair, position);
        let length = (x * x + y * y + z * z).sqrt();
        let per_free = f64x2::splat(1.0) / length;
        let across = [f64x2::ZERO; 2];
        Self { length, direction: [x * per_free, y * per_free, z * per_free], per_free, bend: f64x2::ZERO, across }
    }

    /// True if no length of an eye is too small for a direction, infinite or NaN.
    #[inline(always)]
    pub(crate) fn have_lengths(&self) -> bool {
        let finite = self.length.simd_lt(f64x2::splat(f64::INFINITY));
        (self.length.simd_ge(f64x2::splat(SMALLEST_M)) & finite).all()
    }

    /// Unit vectors of the free cables.
    #[inline(always)]
    pub(crate) fn directions(&self) -> [Vector3<f64>; 2] {
        lanes(self.direction)
    }

    /// Two cables of any kind.
    pub(crate) fn from_cables(cables: &[CableGeometry; 2]) -> Self {
        let both = |of: fn(&CableGeometry) -> f64| f64x2::new(cables.each_ref().map(of));
        Self {
            length: both(|cable| cable.length_m),
            direction: [
                both(|cable| cable.direction.x),
                both(|cable| cable.direction.y),
                both(|cable| cable.direction.z),
            ],
            per_free: both(|cable| 1.0 / cable.free_m),
            bend: both(|cable| cable.bend_per_m),
            across: [both(|cable| cable.across.x), both(|cable| cable.across.y)],
        }
    }
}

/// The vectors in the two lanes.
#[inline(always)]
fn lanes(vectors: [f64x2; 3]) -> [Vector3<f64>; 2] {
    let [x, y, z] = vectors.map(f64x2::to_array);
    [0, 1].map(|k| Vector3::new(x[k], y[k], z[k]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::PI;
    use proptest::prelude::*;

    fn tangents(anchors: [Vector3<f64>; 2], radii_m: [f64; 2], position: &Vector3<f64>) -> Tangents {
        Tangents::of(&PairOfCables { anchors: &anchors, radii_m: &radii_m, planar: false }, position)
    }

    /// From where the cable enters to the node, most of all where the tangent points along an axis or a diagonal.
    fn to_node() -> impl Strategy<Value = (f64, Vector3<f64>)> {
        let turn = prop_oneof![0.0..2.0 * PI, (0..8).prop_map(|k| f64::from(k) * FRAC_PI_4)];
        (0.005..0.5f64, turn, -1e-9..1e-9f64, 1e-3..20.0f64, 0.0..6.2f64).prop_map(|(r, turn, off, free, azimuth)| {
            let turn = turn + off;
            let p = |turn: f64| r - r * libm::cos(turn) + free * libm::sin(turn);
            // On the other side of the axis, the mirror image of the direction.
            let turn = if p(turn) > 1e-6 { turn } else { -turn };
            let z = r * libm::sin(turn) + free * libm::cos(turn);
            (r, Vector3::new(p(turn) * libm::cos(azimuth), p(turn) * libm::sin(azimuth), z))
        })
    }

    proptest! {
        #[test]
        fn the_wrapped_angle_is_the_arc_tangent_of_the_library((r, at) in to_node()) {
            let tangents = tangents([Vector3::zeros(); 2], [r; 2], &at);
            let [free, out, up] = [tangents.free, tangents.out, tangents.up].map(|lanes| lanes.to_array()[0]);
            let turn = libm::atan2(out, up);
            let wrapped = if turn < 0.0 && at.z < 0.0 { turn + TAU } else { turn };
            let (length_m, expected_m) = (tangents.lengths_m()[0], free + r * wrapped);
            prop_assert!((length_m - expected_m).abs() <= 1e-15 * expected_m.max(r), "{length_m} {expected_m}");
        }

        #[test]
        fn no_lane_depends_on_the_other((r, at) in to_node(), (other_r, other_at) in to_node()) {
            let both = tangents([Vector3::zeros(), at - other_at], [r, other_r], &at);
            let alone = tangents([Vector3::zeros(); 2], [r; 2], &at);
            let bits = |cable: &CableGeometry| {
                let CableGeometry { length_m, direction: u, free_m, bend_per_m, across: a } = *cable;
                [length_m, u.x, u.y, u.z, free_m, bend_per_m, a.x, a.y, a.z].map(f64::to_bits)
            };
            prop_assert_eq!(bits(&both.cables()[0]), bits(&alone.cables()[0]));
            prop_assert_eq!(bits(&alone.cables()[0]), bits(&alone.cables()[1]));
        }
    }
}
