//! The joint covariance of all anchor coordinates, and the confidence regions it defines. A 3N x 3N matrix in m²,
//! anchor by anchor, x, y and z each; anchors and axes count from 0. Nothing here fails.
//!
//! ```
//! use calibration::{Measurements, Method, Range, calibrate};
//! use cable_robot::{CableVec, Vector3};
//! let anchors = [[0.0, 0.0, 3.0], [10.0, 0.0, 3.2], [5.0, 8.0, 2.9f64]];
//! let range = |i: usize, j: usize| {
//!     let (dx, dy) = (anchors[i][0] - anchors[j][0], anchors[i][1] - anchors[j][1]);
//!     Range { from: i, to: j, m: dx.hypot(dy), sigma_m: 0.002 }
//! };
//! let lengths = |[x, y]: [f64; 2]| {
//!     CableVec::from_fn(3, |i| (anchors[i][0] - x).hypot(anchors[i][1] - y).hypot(anchors[i][2]))
//! };
//! let measured = Measurements {
//!     ranges: vec![range(0, 1), range(0, 2), range(1, 2)],
//!     lengths_m: [[1.0, 0.5], [9.0, 0.5], [5.0, 7.0], [5.0, 3.0], [2.0, 2.0]].map(lengths).to_vec(),
//!     ..Measurements::new(3)
//! };
//! let found = calibrate(&measured, Method::Survey)?;
//! assert_eq!((found.covariance.matrix().nrows(), found.covariance.anchor_count()), (9, 3));
//! // The anchors define the frame: the first one is at x = y = 0, and only its height is uncertain.
//! let [x, y, z] = found.covariance.std_m()[0];
//! assert!(x == 0.0 && y == 0.0 && z > 0.0);
//! assert!(found.covariance.contains_95(0, &Vector3::new(0.0, 0.0, z)));
//! assert!(!found.covariance.contains_95(0, &Vector3::new(0.0, 0.0, 3.0 * z)));
//! # Ok::<(), calibration::CalibrationError>(())
//! ```

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// 95 % quantiles of chi-squared with 0 to 3 degrees of freedom (from a table of the distribution).
const CHI2_95: [f64; 4] = [0.0, 3.841_458_821, 5.991_464_547, 7.814_727_903];

/// A direction whose variance is below this share of the largest one is fixed by the gauge.
const FIXED_SHARE: f64 = 1e-12;

/// Largest error of an anchor along a direction that the gauge fixes, m: rounding.
const FIXED_M: f64 = 1e-6;

/// Covariance of x1, y1, z1, x2, y2, z2, .. in m². Coordinates that the gauge fixes (x1, y1, y2) have rows of zeros.
#[derive(Debug, Clone, PartialEq)]
pub struct AnchorCovariance {
    matrix: DMatrix<f64>,
}

impl AnchorCovariance {
    /// Wraps the 3N x 3N matrix.
    pub(super) fn new(matrix: DMatrix<f64>) -> Self {
        Self { matrix }
    }

    /// The 3N x 3N matrix, m².
    pub fn matrix(&self) -> &DMatrix<f64> {
        &self.matrix
    }

    /// The rows of the matrix, m².
    pub fn rows(&self) -> Vec<Vec<f64>> {
        rows(&self.matrix)
    }

    /// Number of anchors.
    pub fn anchor_count(&self) -> usize {
        self.matrix.nrows() / 3
    }

    /// The 3 x 3 block of one anchor, counted from 0, m².
    pub fn block(&self, anchor: usize) -> Matrix3<f64> {
        self.matrix.fixed_view::<3, 3>(3 * anchor, 3 * anchor).into_owned()
    }

    /// Standard deviation of every coordinate, m.
    pub fn std_m(&self) -> Vec<[f64; 3]> {
        let root = |k: usize| self.matrix[(k, k)].max(0.0).sqrt();
        (0..self.anchor_count()).map(|i| [root(3 * i), root(3 * i + 1), root(3 * i + 2)]).collect()
    }

    /// The least certain coordinate: index of the anchor, index of the axis, standard deviation in m.
    pub fn worst(&self) -> (usize, usize, f64) {
        let mut worst = (0, 0, 0.0);
        for (i, std) in self.std_m().iter().enumerate() {
            for (k, s) in std.iter().enumerate() {
                // A NaN becomes the worst.
                if !(*s <= worst.2) {
                    worst = (i, k, *s);
                }
            }
        }
        worst
    }

    /// True if an anchor with an error of `error_m` is inside its 95 % region: an ellipsoid, an ellipse or an interval,
    /// depending on the number of directions that the gauge leaves free.
    pub fn contains_95(&self, anchor: usize, error_m: &Vector3<f64>) -> bool {
        let eigen = self.block(anchor).symmetric_eigen();
        let largest = eigen.eigenvalues.max();
        let (mut distance, mut free) = (0.0, 0);
        for (k, variance) in eigen.eigenvalues.iter().enumerate() {
            let along = eigen.eigenvectors.column(k).dot(error_m);
            if *variance > FIXED_SHARE * largest {
                distance += along * along / variance;
                free += 1;
            } else if along.abs() > FIXED_M {
                return false;
            }
        }
        distance <= CHI2_95[free]
    }

    /// Squared Mahalanobis distance of the errors of all anchors together (3N of them, m), and the number of free
    /// directions. If the model is correct, the distance is chi-squared distributed with that many degrees of freedom.
    pub fn distance_squared(&self, errors_m: &[f64]) -> (f64, usize) {
        let error = DVector::from_column_slice(errors_m);
        let eigen = self.matrix.clone().symmetric_eigen();
        let largest = eigen.eigenvalues.max();
        let mut result = (0.0, 0);
        for (k, variance) in eigen.eigenvalues.iter().enumerate() {
            if *variance > FIXED_SHARE * largest {
                let along = eigen.eigenvectors.column(k).dot(&error);
                result.0 += along * along / variance;
                result.1 += 1;
            }
        }
        result
    }

    /// The same covariance with every standard deviation multiplied by `factor`.
    pub fn widened(&self, factor: f64) -> Self {
        Self { matrix: &self.matrix * (factor * factor) }
    }

    /// The same covariance with an error of its own that moves all coordinates together: its standard deviation by
    /// coordinate, with sign, m.
    pub(super) fn with_shift(&self, standard_m: &[f64]) -> Self {
        let shift = DVector::from_column_slice(standard_m);
        Self { matrix: &self.matrix + &shift * shift.transpose() }
    }
}

/// Quantities per cable in a [`LengthCovariance`], and among them the scale and the radius.
pub(super) const PER_CABLE: usize = 5;
pub(super) const SCALE: usize = 3;
pub(super) const RADIUS: usize = 4;

/// Covariance of what the lengths of a calibrated robot depend on: per cable x, y and z of the anchor less those of the
/// point where the cable is tied to the node (m), the scale of the length as a share, and the radius of the pulley (m),
/// which is wrong by the same for all cables. The errors of one calibration are wrong together, and where the lengths
/// of the robot were set, they count nothing; the deviations of the anchors alone say neither.
#[derive(Debug, Clone, PartialEq)]
pub struct LengthCovariance {
    matrix: DMatrix<f64>,
}

impl LengthCovariance {
    pub(super) fn new(matrix: DMatrix<f64>) -> Self {
        Self { matrix }
    }

    /// The 5N rows of the matrix.
    pub fn rows(&self) -> Vec<Vec<f64>> {
        rows(&self.matrix)
    }

    /// The same covariance with every standard deviation multiplied by `factor`.
    pub(super) fn widened(&self, factor: f64) -> Self {
        Self { matrix: &self.matrix * (factor * factor) }
    }

    /// The same covariance with an error of its own that moves the anchors and changes all radii together: one standard
    /// deviation of each coordinate, with sign, and of the radius, m.
    pub(super) fn with_shift(&self, anchors_m: &[[f64; 3]], radius_m: f64) -> Self {
        let of = |anchor: &[f64; 3]| [anchor[0], anchor[1], anchor[2], 0.0, radius_m];
        let shift = DVector::from_iterator(PER_CABLE * anchors_m.len(), anchors_m.iter().flat_map(of));
        Self { matrix: &self.matrix + &shift * shift.transpose() }
    }

    /// The same covariance without the scales, for lengths that the encoders of the robot did not count.
    #[must_use]
    pub fn without_scales(&self) -> Self {
        let scale = |k: usize| k % PER_CABLE == SCALE;
        let kept = |a: usize, b: usize| if scale(a) || scale(b) { 0.0 } else { self.matrix[(a, b)] };
        Self { matrix: DMatrix::from_fn(self.matrix.nrows(), self.matrix.ncols(), kept) }
    }
}

fn rows(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
}
