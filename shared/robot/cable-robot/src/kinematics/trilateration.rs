//! Intersections of spheres around eyes: closed forms from which every solution starts.

use nalgebra::Vector3;

use super::solution::KinematicsError;

/// Anchors count as collinear if the area of their triangle is below this share of its squared longest side.
pub(crate) const COLLINEAR_TOLERANCE: f64 = 1e-9;

/// With anchors at nearly one height, the mirror image fits the lengths nearly as well as the true position, and with
/// noise sometimes better. The lower point is chosen unless its residual is larger by more than this share of the
/// length: 2 cm on 7 m, several times the error of calibrated lengths.
const MIRROR_TOLERANCE: f64 = 0.003;

/// True if the residual `a` is so much larger than `b` that its position is excluded.
pub(crate) fn fits_worse(a: f64, b: f64, lengths: &[f64]) -> bool {
    let mean_length = lengths.iter().sum::<f64>() / lengths.len() as f64;
    a > 5.0 * b + MIRROR_TOLERANCE * mean_length
}

/// Intersection of three spheres.
#[derive(Debug, Clone, Copy)]
pub struct Pair {
    /// Both points; the same point twice if the spheres do not intersect.
    pub points: [Vector3<f64>; 2],
    /// Squared distance from the plane of the anchors; negative if the spheres do not intersect.
    pub height_squared: f64,
}

/// The frame of the plane of three centres, which stays the same for all lengths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Frame {
    origin: Vector3<f64>,
    /// Unit vectors toward the second centre, across it in the plane, and across the plane.
    axes: [Vector3<f64>; 3],
    /// The second centre is (d, 0) and the third one (qx, qy), m.
    d: f64,
    qx: f64,
    qy: f64,
}

impl Frame {
    /// None if the centres lie on one line.
    pub(crate) fn of(a: [Vector3<f64>; 3]) -> Option<Self> {
        let (p, q) = (a[1] - a[0], a[2] - a[0]);
        let normal = p.cross(&q);
        let longest = p.norm_squared().max(q.norm_squared()).max((q - p).norm_squared());
        if normal.norm() < COLLINEAR_TOLERANCE * longest {
            return None;
        }
        let d = p.norm();
        let ex = p / d;
        let ez = normal / normal.norm();
        let ey = ez.cross(&ex);
        Some(Self { origin: a[0], axes: [ex, ey, ez], d, qx: q.dot(&ex), qy: q.dot(&ey) })
    }

    /// Computes the intersection of spheres with these radii, m.
    pub(crate) fn intersect(&self, l: [f64; 3]) -> Pair {
        let Self { origin, axes: [ex, ey, ez], d, qx, qy } = *self;
        let x = ((l[0] - l[1]) * (l[0] + l[1]) + d * d) / (2.0 * d);
        let y = ((l[0] - l[2]) * (l[0] + l[2]) + qx * qx + qy * qy - 2.0 * qx * x) / (2.0 * qy);
        let height_squared = (l[0] - x) * (l[0] + x) - y * y;
        let foot = origin + ex * x + ey * y;
        let h = height_squared.max(0.0).sqrt();
        Pair { points: [foot - ez * h, foot + ez * h], height_squared }
    }
}

/// Computes the intersection of three spheres in the frame of their plane. Solves (7)-(9) without the division of
/// (10)-(12) by the horizontal distance of the anchors, which fails for anchors above each other.
///
/// # Errors
/// The centres lie on one line.
pub fn trilaterate(a: [Vector3<f64>; 3], l: [f64; 3]) -> Result<Pair, KinematicsError> {
    Ok(Frame::of(a).ok_or(KinematicsError::DegenerateGeometry)?.intersect(l))
}

/// Returns the chosen one of two mirror points, and the other.
pub(super) fn choose(
    points: [Vector3<f64>; 2],
    near: Option<&Vector3<f64>>,
) -> Result<(Vector3<f64>, Vector3<f64>), KinematicsError> {
    let [a, b] = points;
    let first = match near {
        Some(hint) => (a - hint).norm_squared() <= (b - hint).norm_squared(),
        None => {
            let apart = (a - b).norm();
            // Below this the height difference is rounding.
            if apart > 1e-9 && (a.z - b.z).abs() < 1e-9 * apart.max(1.0) {
                return Err(KinematicsError::Ambiguous);
            }
            a.z <= b.z
        }
    };
    Ok(if first { (a, b) } else { (b, a) })
}

pub(super) fn residuals(anchors: &[Vector3<f64>], lengths: &[f64], x: &Vector3<f64>) -> f64 {
    anchors.iter().zip(lengths).map(|(a, l)| ((x - a).norm() - l) * ((x - a).norm() - l)).sum()
}

/// Returns the points of the three spheres, out of all triples, one of whose points fits all lengths best; None if all
/// anchors lie on one line.
pub(super) fn best_pair(anchors: &[Vector3<f64>], l: &[f64]) -> Option<[Vector3<f64>; 2]> {
    let n = anchors.len();
    let mut best: Option<(f64, [Vector3<f64>; 2])> = None;
    for i in 0..n {
        for j in i + 1..n {
            for k in j + 1..n {
                let Ok(pair) = trilaterate([anchors[i], anchors[j], anchors[k]], [l[i], l[j], l[k]]) else { continue };
                let costs = pair.points.map(|p| residuals(anchors, l, &p));
                let cost = costs[0].min(costs[1]);
                if best.as_ref().is_none_or(|(c, _)| cost < *c) {
                    best = Some((cost, pair.points));
                }
            }
        }
    }
    best.map(|(_, points)| points)
}
