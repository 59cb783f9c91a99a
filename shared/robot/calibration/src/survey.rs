//! x and y of the anchors from horizontal ranges between plumb lines: (1)-(2), further anchors, and networks of ranges.
//!
//! Ranges in m with standard deviations in m; N anchors as [x, y] in m, the first at the origin, the second on the x
//! axis. Ranges that do not form a triangle, or do not determine an anchor, are a [`CalibrationError`].

use nalgebra::{DMatrix, DVector};

use super::error::{CalibrationError, degenerate, invalid, undetermined};
use super::{Ambiguity, Undetermined};
use cable_robot::MAX_CABLES;

/// Three anchors count as collinear if their triangle is flatter than this share of its longest side; below it rounding
/// decides the side of the third one.
const COLLINEAR_SHARE: f64 = 1e-6;

/// Circles that miss each other by this share of the radii count as touching: rounding.
const TOUCH_SHARE: f64 = 1e-9;

/// Bound of the refinement, which needs about five steps.
const MAX_ITERATIONS: usize = 100;

/// Side of an anchor relative to the line from the first to the second anchor, seen from above.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Side {
    /// Left: y above 0 if the line is the x axis.
    #[default]
    Left,
    /// Right.
    Right,
}

impl Side {
    /// Converts +1 to left and -1 to right; rejects other values.
    pub fn from_sign(sign: i64) -> Result<Self, CalibrationError> {
        match sign {
            1 => Ok(Self::Left),
            -1 => Ok(Self::Right),
            other => invalid(format!("side is {other}; give 1 for left or -1 for right")),
        }
    }

    fn sign(self) -> f64 {
        match self {
            Self::Left => 1.0,
            Self::Right => -1.0,
        }
    }
}

/// A horizontal distance between the plumb lines of two anchors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Index of one anchor, from 0.
    pub from: usize,
    /// Index of the other anchor, from 0.
    pub to: usize,
    /// Distance, m.
    pub m: f64,
    /// Standard deviation, m.
    pub sigma_m: f64,
}

fn check_range(name: &str, m: f64) -> Result<(), CalibrationError> {
    if (0.0..=cable_robot::kinematics::LONGEST_M).contains(&m) {
        return Ok(());
    }
    invalid(format!("{name} is {m} m; give a finite horizontal distance in metres"))
}

/// Computes x and y of three anchors from `ranges_m` = [D1 = P1P3, D2 = P1P2, D3 = P2P3], (1)-(2): the first at the
/// origin, the second on the x axis, the third at the given side of it. y3 comes from Heron's formula in Kahan's order,
/// which is accurate for flat triangles.
///
/// # Errors
/// `invalid_argument`, or `degenerate_geometry` for ranges that do not form a triangle.
///
/// ```
/// use calibration::Side;
/// use calibration::survey_anchors;
/// let xy = survey_anchors([5.0, 6.0, 5.0], Side::Left)?;
/// assert_eq!(xy, [[0.0, 0.0], [6.0, 0.0], [3.0, 4.0]]);
/// # Ok::<(), calibration::CalibrationError>(())
/// ```
pub fn survey_anchors(ranges_m: [f64; 3], side: Side) -> Result<[[f64; 2]; 3], CalibrationError> {
    let [d1, d2, d3] = ranges_m;
    for (name, m) in [("the range between anchors 1 and 3", d1), ("the range between anchors 1 and 2", d2)]
        .into_iter()
        .chain([("the range between anchors 2 and 3", d3)])
    {
        check_range(name, m)?;
        if m == 0.0 {
            return degenerate(format!("{name} is 0 m: two anchors coincide; measure it again"));
        }
    }
    // Kahan: the sides in descending order.
    let mut sorted = ranges_m;
    sorted.sort_by(|a, b| b.total_cmp(a));
    let [a, b, c] = sorted;
    let shortfall = c - (a - b);
    let area_x16_squared = (a + (b + c)) * shortfall * (c + (a - b)) * (a + (b - c));
    let y3 = 0.5 * area_x16_squared.max(0.0).sqrt() / d2;
    if shortfall < 0.0 && -shortfall > TOUCH_SHARE * a {
        return degenerate(format!(
            "ranges of {d1}, {d2} and {d3} m form no triangle: {a} m is longer than the other two together; measure them again"
        ));
    }
    if !(y3 > COLLINEAR_SHARE * a) {
        return degenerate(format!(
            "ranges of {d1}, {d2} and {d3} m put the three anchors on one line; move one of them sideways"
        ));
    }
    // (D1² + D2² - D3²) / 2 D2 of (1), without the cancellation of squares.
    let x3 = 0.5 * (d2 + (d1 - d3) * ((d1 + d3) / d2));
    Ok([[0.0, 0.0], [d2, 0.0], [x3, side.sign() * y3]])
}

fn distance(a: &[f64; 2], b: &[f64; 2]) -> f64 {
    let (dx, dy) = (a[0] - b[0], a[1] - b[1]);
    (dx * dx + dy * dy).sqrt()
}

/// Point at `ra` from `a` and `rb` from `b`, left or right of the line from `a` to `b`.
fn intersect(a: &[f64; 2], b: &[f64; 2], ra: f64, rb: f64, side: Side) -> Result<[f64; 2], CalibrationError> {
    let d = distance(a, b);
    if !(d > 0.0) {
        return degenerate("two anchors coincide, so ranges from them determine no point; measure them again");
    }
    let (meeting, across_squared) = intersect_circles(a, b, ra, rb, side);
    if across_squared < -TOUCH_SHARE * (ra * ra).max(rb * rb).max(d * d) {
        return degenerate(format!(
            "ranges of {ra} and {rb} m from anchors {d:.4} m apart form no triangle; measure them again"
        ));
    }
    Ok(meeting)
}

/// Intersection of two circles, and its squared distance from the line of their centres; if the circles do not
/// intersect, a point on that line and a negative number.
fn intersect_circles(a: &[f64; 2], b: &[f64; 2], ra: f64, rb: f64, side: Side) -> ([f64; 2], f64) {
    let d = distance(a, b);
    let along = 0.5 * (d + (ra - rb) * ((ra + rb) / d));
    let across_squared = (ra - along) * (ra + along);
    let across = side.sign() * across_squared.max(0.0).sqrt();
    let (ux, uy) = ((b[0] - a[0]) / d, (b[1] - a[1]) / d);
    ([a[0] + along * ux - across * uy, a[1] + along * uy + across * ux], across_squared)
}

/// Spread of the points across their best-fitting line divided by their spread along it: 0 if they are collinear.
pub(super) fn flatness(anchors: &[[f64; 2]]) -> f64 {
    let n = anchors.len() as f64;
    let mean = anchors.iter().fold([0.0; 2], |m, a| [m[0] + a[0] / n, m[1] + a[1] / n]);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for a in anchors {
        let (x, y) = (a[0] - mean[0], a[1] - mean[1]);
        xx += x * x;
        xy += x * y;
        yy += y * y;
    }
    let (half, part) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    let large = half + (part * part + xy * xy).sqrt();
    if !(large > 0.0) {
        return 0.0;
    }
    // The product of the eigenvalues is the determinant.
    ((xx * yy - xy * xy).max(0.0) / large).sqrt() / large.sqrt()
}

/// Checks x and y of three or more anchors, in any frame: finite, and not on one line.
pub(super) fn check_anchors(anchors: &[[f64; 2]]) -> Result<(), CalibrationError> {
    if !(3..=MAX_CABLES).contains(&anchors.len()) {
        return invalid(format!("{} anchors are given; give x and y of 3 to {MAX_CABLES}", anchors.len()));
    }
    for (i, a) in anchors.iter().enumerate() {
        if !a.iter().all(|v| v.is_finite() && v.abs() <= cable_robot::kinematics::LONGEST_M) {
            return invalid(format!("anchor {} is at [{}, {}]; give finite coordinates in metres", i + 1, a[0], a[1]));
        }
    }
    if !(flatness(anchors) > COLLINEAR_SHARE) {
        return degenerate("the anchors lie on one line seen from above; lengths cannot tell its two sides apart");
    }
    Ok(())
}

/// Computes x and y of one more anchor from its ranges to three anchors (least squares in range), or from its ranges to
/// the first two of them and its side of the line from the first to the second.
///
/// # Errors
/// `invalid_argument`; `ambiguous` for two ranges without a side; `degenerate_geometry` for ranges that do not form a
/// triangle, a range of zero, and three anchors on one line.
pub fn fourth_anchor(
    anchors_xy_m: &[[f64; 2]; 3],
    ranges_m: &[f64],
    side: Option<Side>,
) -> Result<[f64; 2], CalibrationError> {
    for (i, a) in anchors_xy_m.iter().enumerate() {
        if !a.iter().all(|v| v.is_finite()) {
            return invalid(format!("anchor {} is at [{}, {}]; give finite coordinates in metres", i + 1, a[0], a[1]));
        }
    }
    for (i, m) in ranges_m.iter().enumerate() {
        check_range(&format!("the range from anchor {}", i + 1), *m)?;
        if *m == 0.0 {
            return degenerate(format!(
                "the range from anchor {} is 0 m: two anchors coincide; measure it again",
                i + 1
            ));
        }
    }
    match (ranges_m, side) {
        ([r1, r2], Some(side)) => intersect(&anchors_xy_m[0], &anchors_xy_m[1], *r1, *r2, side),
        ([_, _], None) => Err(CalibrationError::Ambiguous(Ambiguity::Fourth)),
        ([_, _, _], _) => {
            check_anchors(anchors_xy_m)?;
            let known: Vec<_> = anchors_xy_m.iter().zip(ranges_m).map(|(a, r)| (*a, *r, 1.0)).collect();
            Ok(best_point(&known))
        }
        (other, _) => invalid(format!("{} ranges are given; give two with a side, or three", other.len())),
    }
}

fn range_cost(known: &[([f64; 2], f64, f64)], p: &[f64; 2]) -> f64 {
    known
        .iter()
        .map(|(a, r, sigma)| {
            let e = (distance(a, p) - r) / sigma;
            e * e
        })
        .sum()
}

/// Computes the point that fits three or more weighted ranges (position, range, sigma) best: Gauss-Newton from every
/// intersection of two circles, to find the better of the two sides.
fn best_point(known: &[([f64; 2], f64, f64)]) -> [f64; 2] {
    let mut best = ([0.0; 2], f64::INFINITY);
    for (i, (a, ra, _)) in known.iter().enumerate() {
        for (b, rb, _) in &known[i + 1..] {
            for side in [Side::Left, Side::Right] {
                // Circles that miss each other still give a starting point between them.
                let (start, _) = intersect_circles(a, b, *ra, *rb, side);
                let found = refine_point(known, start);
                let cost = range_cost(known, &found);
                if cost < best.1 {
                    best = (found, cost);
                }
            }
        }
    }
    best.0
}

fn refine_point(known: &[([f64; 2], f64, f64)], start: [f64; 2]) -> [f64; 2] {
    let mut p = start;
    let mut damping = 1e-9;
    let mut cost = range_cost(known, &p);
    for _ in 0..MAX_ITERATIONS {
        let (mut xx, mut xy, mut yy, mut gx, mut gy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (a, r, sigma) in known {
            let d = distance(a, &p);
            if d > 0.0 {
                let (ux, uy, w) = ((p[0] - a[0]) / d, (p[1] - a[1]) / d, 1.0 / (sigma * sigma));
                xx += w * ux * ux;
                xy += w * ux * uy;
                yy += w * uy * uy;
                gx += w * ux * (d - r);
                gy += w * uy * (d - r);
            }
        }
        let (xx, yy) = (xx * (1.0 + damping), yy * (1.0 + damping));
        let det = xx * yy - xy * xy;
        if !(det > 0.0) {
            damping = (damping * 10.0).max(1e-6);
            continue;
        }
        let (sx, sy) = ((yy * gx - xy * gy) / det, (xx * gy - xy * gx) / det);
        let next = [p[0] - sx, p[1] - sy];
        let next_cost = range_cost(known, &next);
        let step = (sx * sx + sy * sy).sqrt();
        if next_cost <= cost || step < 1e-7 {
            (p, cost) = (next, next_cost);
            damping *= 0.1;
        } else {
            damping = (damping * 10.0).max(1e-6);
        }
        if step < 1e-13 {
            break;
        }
    }
    p
}

/// Index of a free coordinate among the 2N - 3 that the gauge leaves, or None if it is fixed. Axis 0 is x, 1 is y.
pub(super) fn free_index(anchor: usize, axis: usize) -> Option<usize> {
    match (anchor, axis) {
        (0, _) | (1, 1) => None,
        (1, _) => Some(0),
        (i, axis) => Some(1 + 2 * (i - 2) + axis),
    }
}

/// The same points transformed so that the first is at the origin and the second on the positive x axis.
pub(super) fn to_gauge(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let (o, p) = (points[0], points[1]);
    let d = distance(&o, &p);
    let (c, s) = ((p[0] - o[0]) / d, (p[1] - o[1]) / d);
    let turn = |a: &[f64; 2]| [c * (a[0] - o[0]) + s * (a[1] - o[1]), c * (a[1] - o[1]) - s * (a[0] - o[0])];
    let mut turned: Vec<_> = points.iter().map(turn).collect();
    turned[0] = [0.0, 0.0];
    turned[1] = [d, 0.0];
    turned
}

/// Checks ranges between `n` anchors.
pub(super) fn check_ranges(n: usize, ranges: &[Range]) -> Result<(), CalibrationError> {
    for r in ranges {
        let name = format!("the range between anchors {} and {}", r.from + 1, r.to + 1);
        if r.from >= n || r.to >= n {
            return invalid(format!("{name} refers to an anchor that does not exist: there are {n}"));
        }
        if r.from == r.to {
            return invalid(format!("{name} needs two different anchors"));
        }
        check_range(&name, r.m)?;
        if r.m == 0.0 {
            return degenerate(format!("{name} is 0 m: two anchors coincide; measure it again"));
        }
        super::error::check_sigma(&format!("the standard deviation of {name}"), r.sigma_m)?;
    }
    Ok(())
}

/// Anchors computed from a network of ranges.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// x and y of every anchor, m.
    pub anchors_xy_m: Vec<[f64; 2]>,
    /// Covariance of x1, y1, x2, y2, .., m²: 2N x 2N, zero where the gauge fixes a coordinate.
    pub covariance: DMatrix<f64>,
    /// Sum of squared residuals, each in standard deviations.
    pub chi_squared: f64,
    /// Number of redundant ranges.
    pub degrees_of_freedom: usize,
}

/// Computes the positions of any number of anchors from ranges between them: each from those already known, then
/// all ranges together by weighted least squares. `sides` has one entry per anchor and applies to an anchor with
/// only two ranges, relative to the line between those two anchors, lower number first; the default side of the
/// third anchor is left.
///
/// # Errors
/// `invalid_argument`; `degenerate_geometry` if ranges do not form a triangle; `rank_deficient` for an anchor with too
/// few ranges; `ambiguous` if a side is missing.
pub fn survey_network(n: usize, ranges: &[Range], sides: &[Option<Side>]) -> Result<Survey, CalibrationError> {
    if !(3..=MAX_CABLES).contains(&n) {
        return invalid(format!("{n} anchors cannot be surveyed; a robot has 3 to {MAX_CABLES}"));
    }
    check_ranges(n, ranges)?;
    let between = |i: usize, j: usize| {
        let (mut sum, mut weight) = (0.0, 0.0);
        for r in ranges.iter().filter(|r| (r.from, r.to) == (i, j) || (r.from, r.to) == (j, i)) {
            let w = 1.0 / (r.sigma_m * r.sigma_m);
            sum += w * r.m;
            weight += w;
        }
        (weight > 0.0).then(|| (sum / weight, 1.0 / weight.sqrt()))
    };
    let Some((baseline, _)) = between(0, 1) else {
        return undetermined(Undetermined::NoBaseline);
    };
    let mut placed: Vec<Option<[f64; 2]>> = vec![None; n];
    (placed[0], placed[1]) = (Some([0.0, 0.0]), Some([baseline, 0.0]));
    while let Some(next) = most_reached(&placed, &between) {
        let known: Vec<_> =
            (0..n).filter_map(|i| placed[i].and_then(|p| between(i, next).map(|(r, s)| (i, p, r, s)))).collect();
        let side = sides.get(next).copied().flatten().or((next == 2).then_some(Side::Left));
        placed[next] = Some(match known.as_slice() {
            [] | [_] => {
                return undetermined(Undetermined::FewRanges { anchor: next + 1, ranges: known.len() });
            }
            [(0, _, d1, _), (1, _, d3, _)] if next == 2 => {
                survey_anchors([*d1, baseline, *d3], side.unwrap_or_default())?[2]
            }
            [(i, a, ra, _), (j, b, rb, _)] => match side {
                Some(side) => intersect(a, b, *ra, *rb, side)?,
                None => {
                    let (anchor, from, to) = (next + 1, i + 1, j + 1);
                    return Err(CalibrationError::Ambiguous(Ambiguity::Anchor { anchor, from, to }));
                }
            },
            several => {
                let known: Vec<_> = several.iter().map(|(_, p, r, s)| (*p, *r, *s)).collect();
                let places: Vec<_> = known.iter().map(|(p, _, _)| *p).collect();
                if !(flatness(&places) > COLLINEAR_SHARE) {
                    return undetermined(Undetermined::RangesOnALine { anchor: next + 1 });
                }
                best_point(&known)
            }
        });
    }
    let start: Vec<_> = placed.into_iter().flatten().collect();
    refine(start, ranges)
}

/// The unknown anchor with the most ranges to known ones; of equals the first.
fn most_reached(placed: &[Option<[f64; 2]>], between: &impl Fn(usize, usize) -> Option<(f64, f64)>) -> Option<usize> {
    let reach = |k: usize| (0..placed.len()).filter(|i| placed[*i].is_some() && between(*i, k).is_some()).count();
    (0..placed.len()).rev().filter(|k| placed[*k].is_none()).max_by_key(|k| reach(*k))
}

fn refine(mut xy: Vec<[f64; 2]>, ranges: &[Range]) -> Result<Survey, CalibrationError> {
    let n = xy.len();
    let free = 2 * n - 3;
    let mut inverse = DMatrix::zeros(free, free);
    let mut chi_squared = 0.0;
    for _ in 0..MAX_ITERATIONS {
        let mut normal = DMatrix::zeros(free, free);
        let mut gradient = DVector::zeros(free);
        chi_squared = 0.0;
        for r in ranges {
            let (a, b) = (xy[r.from], xy[r.to]);
            let d = distance(&a, &b);
            if !(d > 0.0) {
                return degenerate(format!(
                    "anchors {} and {} coincide; measure their ranges again",
                    r.from + 1,
                    r.to + 1
                ));
            }
            let residual = (d - r.m) / r.sigma_m;
            chi_squared += residual * residual;
            let u = [(a[0] - b[0]) / d / r.sigma_m, (a[1] - b[1]) / d / r.sigma_m];
            let row = [(r.from, 0, u[0]), (r.from, 1, u[1]), (r.to, 0, -u[0]), (r.to, 1, -u[1])];
            for (i, k, di) in row {
                let Some(p) = free_index(i, k) else { continue };
                gradient[p] += di * residual;
                for (j, l, dj) in row {
                    if let Some(q) = free_index(j, l) {
                        normal[(p, q)] += di * dj;
                    }
                }
            }
        }
        let Some(cholesky) = normal.cholesky() else {
            return undetermined(Undetermined::LooseRanges);
        };
        let step = cholesky.solve(&gradient);
        inverse = cholesky.inverse();
        for i in 0..n {
            for k in 0..2 {
                if let Some(p) = free_index(i, k) {
                    xy[i][k] -= step[p];
                }
            }
        }
        if step.amax() < 1e-13 * (1.0 + xy[1][0].abs()) {
            break;
        }
    }
    let mut covariance = DMatrix::zeros(2 * n, 2 * n);
    for i in 0..2 * n {
        for j in 0..2 * n {
            if let (Some(p), Some(q)) = (free_index(i / 2, i % 2), free_index(j / 2, j % 2)) {
                covariance[(i, j)] = inverse[(p, q)];
            }
        }
    }
    Ok(Survey { anchors_xy_m: xy, covariance, chi_squared, degrees_of_freedom: ranges.len().saturating_sub(free) })
}
