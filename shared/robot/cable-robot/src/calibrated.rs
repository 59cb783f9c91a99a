//! The covariance that a calibration states, packed: robots are copied, and most of a whole matrix repeats itself.

use nalgebra::{Matrix3, Vector5};

use crate::MAX_CABLES;
use crate::linalg::dot;
use crate::robot_error::{RobotError, refuse};

/// Quantities per cable in [`crate::RobotParts::length_covariance`]; of these, the scale and the radius.
const PER_CABLE: usize = 5;
pub(crate) const SCALE: usize = 3;
pub(crate) const RADIUS: usize = 4;

/// Place of the radius, which is wrong by the same for all cables, among the packed quantities.
const COMMON_RADIUS: usize = RADIUS * MAX_CABLES;

/// Entries of the lower triangle.
const PACKED: usize = (COMMON_RADIUS + 1) * (COMMON_RADIUS + 2) / 2;

/// Derivatives of a length with respect to the quantities of its cable.
pub(crate) type LengthGradient = Vector5<f64>;

/// Covariance of what the lengths of a calibrated robot depend on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Calibrated {
    /// Of each anchor alone, m².
    anchors_m2: [Matrix3<f64>; MAX_CABLES],
    /// Nothing is known but the anchors.
    pub(crate) anchors_alone: bool,
    packed: [f64; PACKED],
}

impl Calibrated {
    /// Checks and packs the rows of a calibration; None without any.
    pub(crate) fn new(
        anchors: Option<&[Vec<f64>]>,
        lengths: Option<&[Vec<f64>]>,
        cables: usize,
    ) -> Result<Option<Self>, RobotError> {
        if let Some(rows) = anchors {
            check_covariance("covariance_m2", rows, 3, cables, "a symmetric matrix of x1, y1, z1, x2, .. in m²")?;
        }
        if let Some(rows) = lengths {
            let accepted = "a symmetric matrix of x, y, z, scale and radius of cable 1, of cable 2, ..";
            check_covariance("length_covariance", rows, PER_CABLE, cables, accepted)?;
        }
        let (rows, each) = match (lengths, anchors) {
            (Some(rows), _) => (rows, PER_CABLE),
            (None, Some(rows)) => (rows, 3),
            (None, None) => return Ok(None),
        };
        let mut calibrated = Self {
            anchors_m2: [Matrix3::zeros(); MAX_CABLES],
            anchors_alone: lengths.is_none(),
            packed: [0.0; PACKED],
        };
        for i in 0..cables {
            let (own, per) = anchors.map_or((rows, each), |rows| (rows, 3));
            calibrated.anchors_m2[i] = Matrix3::from_fn(|row, column| own[per * i + row][per * i + column]);
            for j in 0..cables {
                for (row, column) in (0..each).flat_map(|row| (0..each).map(move |column| (row, column))) {
                    calibrated.packed[place((i, row), (j, column))] = rows[each * i + row][each * j + column];
                }
            }
        }
        Ok(Some(calibrated))
    }

    /// Covariance of one anchor, m².
    pub(crate) fn anchor_m2(&self, anchor: usize) -> Option<&Matrix3<f64>> {
        self.anchors_m2.get(anchor)
    }

    /// Variance of a quantity of a cable.
    pub(crate) fn variance(&self, cable: usize, quantity: usize) -> f64 {
        self.packed[place((cable, quantity), (cable, quantity))]
    }

    /// Covariance between the lengths of two cables with these derivatives, m².
    pub(crate) fn between(&self, (i, a): (usize, &LengthGradient), (j, b): (usize, &LengthGradient)) -> f64 {
        let mut sum_m2 = 0.0;
        for row in 0..PER_CABLE {
            for column in 0..PER_CABLE {
                sum_m2 += a[row] * b[column] * self.packed[place((i, row), (j, column))];
            }
        }
        sum_m2
    }
}

/// Place of two quantities, each by its cable and its number, in the lower triangle.
fn place((i, row): (usize, usize), (j, column): (usize, usize)) -> usize {
    let index =
        |cable: usize, quantity: usize| if quantity == RADIUS { COMMON_RADIUS } else { RADIUS * cable + quantity };
    let (a, b) = (index(i, row), index(j, column));
    let (low, high) = (a.min(b), a.max(b));
    high * (high + 1) / 2 + low
}

/// Refuses a matrix that is no covariance of `each` quantities of every cable.
fn check_covariance(
    key: &'static str,
    rows: &[Vec<f64>],
    each: usize,
    cables: usize,
    accepted: &'static str,
) -> Result<(), RobotError> {
    let size = each * cables;
    if rows.len() != size || rows.iter().any(|row| row.len() != size) {
        return refuse(key, format!("is not {size} x {size} for {cables} anchors"), accepted);
    }
    let sound = |i: usize, j: usize| {
        let (value, largest) = (rows[i][j], (rows[i][i] * rows[j][j]).sqrt());
        // Also false for NaN.
        rows[i][i] >= 0.0 && value.abs() <= largest * (1.0 + 1e-6) && (value - rows[j][i]).abs() <= 1e-6 * largest
    };
    if let Some(at) = (0..size * size).find(|at| !sound(at / size, at % size)) {
        let (i, j) = (at / size, at % size);
        return refuse(key, format!("has {} in row {}, column {}", rows[i][j], i + 1, j + 1), accepted);
    }
    if let Some(row) = first_contradiction(rows) {
        return refuse(key, format!("contradicts itself in row {}: a variance would be negative", row + 1), accepted);
    }
    Ok(())
}

/// Largest share of the variances by which a combination of them may be negative: numbers that were written with four
/// digits.
const WRITTEN: f64 = 1e-3;

/// The row in which a Cholesky decomposition of the correlations finds a negative variance. Each pair of quantities may
/// be possible, and all together not.
fn first_contradiction(rows: &[Vec<f64>]) -> Option<usize> {
    let size = rows.len();
    let correlation = |i: usize, j: usize| {
        let both = (rows[i][i] * rows[j][j]).sqrt();
        if both > 0.0 { rows[i][j] / both } else { 0.0 }
    };
    let mut factor = vec![vec![0.0; size]; size];
    for i in 0..size {
        for j in 0..i {
            factor[i][j] = (correlation(i, j) - dot(&factor[i][..j], &factor[j][..j])) / factor[j][j];
        }
        let left = 1.0 + WRITTEN - dot(&factor[i][..i], &factor[i][..i]);
        // Also true for NaN.
        if !(left > 0.0) {
            return Some(i);
        }
        factor[i][i] = left.sqrt();
    }
    None
}
