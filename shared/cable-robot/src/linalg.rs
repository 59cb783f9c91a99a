//! Small fixed-size kernels. nalgebra's general products may pick instructions by processor; these never do.

use nalgebra::{Matrix3, Vector3};

use crate::MAX_CABLES;

/// Below this the diagonal of R counts as zero: rows are unit vectors, so it is a sine of an angle.
const RANK_TOLERANCE: f64 = 1e-9;

/// The axes of space.
const SPACE: [usize; 3] = [0, 1, 2];

/// Those of the plane y = 0.
const PLANE: [usize; 2] = [0, 2];

/// Columns of the 3 x n (pseudo-)inverse of the n x 3 matrix with these rows, or None where the rank is below three. In
/// the plane the y of the rows is left out, the rank is two and the y of the columns 0.
///
/// QR by Gram-Schmidt carried out twice: unlike the normal equations it does not square the condition number.
pub(crate) fn pseudo_inverse(rows: &[Vector3<f64>], planar: bool) -> Option<[Vector3<f64>; MAX_CABLES]> {
    let axes = if planar { &PLANE[..] } else { &SPACE };
    let n = rows.len();
    let mut q = [[0.0; MAX_CABLES]; 3];
    let mut r = [[0.0; 3]; 3];
    for (j, axis) in axes.iter().enumerate() {
        let mut v = [0.0; MAX_CABLES];
        for (vi, row) in v.iter_mut().zip(rows) {
            *vi = row[*axis];
        }
        for _ in 0..2 {
            for i in 0..j {
                let d = dot(&q[i][..n], &v[..n]);
                r[i][j] += d;
                for (vk, qk) in v.iter_mut().zip(&q[i]) {
                    *vk -= d * qk;
                }
            }
        }
        let norm = dot(&v[..n], &v[..n]).sqrt();
        if norm.is_nan() || norm < RANK_TOLERANCE {
            return None;
        }
        r[j][j] = norm;
        for (qk, vk) in q[j].iter_mut().zip(&v) {
            *qk = vk / norm;
        }
    }
    let mut columns = [Vector3::zeros(); MAX_CABLES];
    for (i, column) in columns.iter_mut().enumerate().take(n) {
        for (j, axis) in axes.iter().enumerate().rev() {
            let mut rest = q[j][i];
            for (later, other) in axes.iter().enumerate().skip(j + 1) {
                rest -= r[j][later] * column[*other];
            }
            column[*axis] = rest / r[j][j];
        }
    }
    Some(columns)
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// a bᵀ.
pub(crate) fn outer(a: &Vector3<f64>, b: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::from_columns(&[a * b.x, a * b.y, a * b.z])
}

/// Solves the symmetric positive definite system by Cholesky, or None where a pivot is not positive.
pub(crate) fn solve_spd(m: &Matrix3<f64>, b: &Vector3<f64>) -> Option<Vector3<f64>> {
    let l00 = positive_root(m[(0, 0)])?;
    let (l10, l20) = (m[(1, 0)] / l00, m[(2, 0)] / l00);
    let l11 = positive_root(m[(1, 1)] - l10 * l10)?;
    let l21 = (m[(2, 1)] - l20 * l10) / l11;
    let l22 = positive_root(m[(2, 2)] - l20 * l20 - l21 * l21)?;
    let y0 = b.x / l00;
    let y1 = (b.y - l10 * y0) / l11;
    let y2 = (b.z - l20 * y0 - l21 * y1) / l22;
    let z = y2 / l22;
    let y = (y1 - l21 * z) / l11;
    let x = (y0 - l10 * y - l20 * z) / l00;
    Some(Vector3::new(x, y, z))
}

fn positive_root(x: f64) -> Option<f64> {
    // A denormal pivot would overflow the division that follows.
    (x > 1e-290).then(|| x.sqrt())
}

/// Determinant of three columns.
pub(crate) fn det3(a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>) -> f64 {
    a.dot(&b.cross(c))
}
