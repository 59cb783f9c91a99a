//! Small fixed-size kernels. nalgebra's general products may select instructions by processor; these never do.

pub(crate) mod closed;
pub(crate) mod eigen;

use nalgebra::{Matrix3, Vector3};

use crate::{CableVec, MAX_CABLES};

/// Diagonal entries of R below this count as zero. Rows are unit vectors, so an entry is the sine of an angle.
const RANK_TOLERANCE: f64 = 1e-9;

/// Axes of space.
const SPACE: [usize; 3] = [0, 1, 2];

/// Axes of the plane y = 0.
const PLANE: [usize; 2] = [0, 2];

/// QR decomposition of the n x D matrix of the selected axes of some rows: Q with orthonormal columns, padded with rows
/// of zeros to N; R upper triangular.
///
/// Gram-Schmidt with reorthogonalisation: unlike the normal equations it does not square the condition number.
struct Qr<const N: usize, const D: usize> {
    q: [[f64; N]; D],
    r: [[f64; D]; D],
}

impl<const N: usize, const D: usize> Qr<N, D> {
    /// None if the rank is below D. At most N rows.
    fn decompose(rows: &[Vector3<f64>], axes: [usize; D]) -> Option<Self> {
        let (mut q, mut r) = ([[0.0; N]; D], [[0.0; D]; D]);
        for j in 0..D {
            let mut v = [0.0; N];
            for (vi, row) in v.iter_mut().zip(rows) {
                *vi = row[axes[j]];
            }
            for _ in 0..2 {
                for i in 0..j {
                    let d = dot(&q[i], &v);
                    r[i][j] += d;
                    for (vk, qk) in v.iter_mut().zip(&q[i]) {
                        *vk -= d * qk;
                    }
                }
            }
            let norm = dot(&v, &v).sqrt();
            if norm.is_nan() || norm < RANK_TOLERANCE {
                return None;
            }
            r[j][j] = norm;
            let scale = 1.0 / norm;
            q[j] = v.map(|vk| vk * scale);
        }
        Some(Self { q, r })
    }
}

/// Columns of the 3 x n (pseudo-)inverse of the n x 3 matrix with these rows, or None if the rank is below three. In
/// the plane the y of the rows is ignored, the rank is two and the y of the columns is 0.
pub fn pseudo_inverse(rows: &[Vector3<f64>], planar: bool) -> Option<[Vector3<f64>; MAX_CABLES]> {
    // Most robots have three or four cables and solve this in every cycle.
    if !planar && let Some(columns) = closed::inverse(rows) {
        return Some(columns);
    }
    match (rows.len() <= 4, planar) {
        (true, false) => inverse_columns::<4, 3>(rows, SPACE),
        (false, false) => inverse_columns::<MAX_CABLES, 3>(rows, SPACE),
        (_, true) => inverse_columns::<MAX_CABLES, 2>(rows, PLANE),
    }
}

fn inverse_columns<const N: usize, const D: usize>(
    rows: &[Vector3<f64>],
    axes: [usize; D],
) -> Option<[Vector3<f64>; MAX_CABLES]> {
    let Qr { q, r } = Qr::<N, D>::decompose(rows, axes)?;
    let mut columns = [Vector3::zeros(); MAX_CABLES];
    for (i, column) in columns.iter_mut().enumerate().take(rows.len()) {
        for j in (0..D).rev() {
            let mut rest = q[j][i];
            for later in j + 1..D {
                rest -= r[j][later] * column[axes[later]];
            }
            column[axes[j]] = rest / r[j][j];
        }
    }
    Some(columns)
}

/// The shortest x with A x = b for the 3 x n matrix A of these columns, or None if its rank is below three; in the
/// plane, where y is ignored, below two.
pub fn shortest(columns: &[Vector3<f64>], planar: bool, b: &Vector3<f64>) -> Option<CableVec> {
    if !planar && let Some(shortest) = closed::shortest(columns, b) {
        return Some(shortest);
    }
    match (columns.len() <= 4, planar) {
        (true, false) => shortest_by_qr::<4, 3>(columns, SPACE, b),
        (false, false) => shortest_by_qr::<MAX_CABLES, 3>(columns, SPACE, b),
        (_, true) => shortest_by_qr::<MAX_CABLES, 2>(columns, PLANE, b),
    }
}

/// Aᵀ = Q R, so x = Q y with Rᵀ y = b.
fn shortest_by_qr<const N: usize, const D: usize>(
    columns: &[Vector3<f64>],
    axes: [usize; D],
    b: &Vector3<f64>,
) -> Option<CableVec> {
    let Qr { q, r } = Qr::<N, D>::decompose(columns, axes)?;
    let (mut x, mut y) = ([0.0; N], [0.0; D]);
    for j in 0..D {
        let known: f64 = (0..j).map(|i| r[i][j] * y[i]).sum();
        y[j] = (b[axes[j]] - known) / r[j][j];
        for (xk, qk) in x.iter_mut().zip(&q[j]) {
            *xk += y[j] * qk;
        }
    }
    Some(CableVec::from_fn(columns.len(), |i| x[i]))
}

/// Inner product of two slices of equal length.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Euclidean length of a slice.
pub fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

/// a bᵀ.
pub fn outer(a: &Vector3<f64>, b: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::from_columns(&[a * b.x, a * b.y, a * b.z])
}

/// Cholesky decomposition of a symmetric positive definite matrix.
struct Cholesky {
    /// The lower triangle, by rows.
    l: [f64; 6],
}

impl Cholesky {
    /// None if a pivot is not positive.
    fn decompose(m: &Matrix3<f64>) -> Option<Self> {
        let l00 = positive_root(m[(0, 0)])?;
        let (l10, l20) = (m[(1, 0)] / l00, m[(2, 0)] / l00);
        let l11 = positive_root(m[(1, 1)] - l10 * l10)?;
        let l21 = (m[(2, 1)] - l20 * l10) / l11;
        let l22 = positive_root(m[(2, 2)] - l20 * l20 - l21 * l21)?;
        Some(Self { l: [l00, l10, l11, l20, l21, l22] })
    }

    /// Solves the system with this right-hand side.
    fn solve(&self, b: &Vector3<f64>) -> Vector3<f64> {
        let [l00, l10, l11, l20, l21, l22] = self.l;
        let y0 = b.x / l00;
        let y1 = (b.y - l10 * y0) / l11;
        let y2 = (b.z - l20 * y0 - l21 * y1) / l22;
        let z = y2 / l22;
        let y = (y1 - l21 * z) / l11;
        let x = (y0 - l10 * y - l20 * z) / l00;
        Vector3::new(x, y, z)
    }
}

/// Share of the cube of the mean diagonal entry below which a determinant is left to Cholesky's decomposition: there
/// cofactors lose six digits.
const LEAST_DETERMINANT: f64 = 1e-5;

/// Inverse of a symmetric positive definite matrix.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SymmetricInverse {
    /// xx, xy, xz, yy, yz, zz.
    pub entries: [f64; 6],
}

/// The cofactors and the determinant of a symmetric matrix, whose entries are [xx, xy, xz, yy, yz, zz], as those of the
/// cofactors.
#[inline(always)]
pub(crate) fn cofactors([xx, xy, xz, yy, yz, zz]: &[f64; 6]) -> ([f64; 6], f64) {
    let cofactors = [
        yy * zz - yz * yz,
        xz * yz - xy * zz,
        xy * yz - xz * yy,
        xx * zz - xz * xz,
        xy * xz - xx * yz,
        xx * yy - xy * xy,
    ];
    let determinant = xx * cofactors[0] + xy * cofactors[1] + xz * cofactors[2];
    (cofactors, determinant)
}

impl SymmetricInverse {
    /// None if a pivot is not positive.
    pub fn of(m: &Matrix3<f64>) -> Option<Self> {
        Self::by_cofactors(m).or_else(|| Self::by_cholesky(m))
    }

    /// One division, where decomposition and solution wait for three roots and nine divisions.
    #[inline(always)]
    fn by_cofactors(m: &Matrix3<f64>) -> Option<Self> {
        let entries = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|place| m[place]);
        let [xx, _, _, yy, _, zz] = entries;
        let (cofactors, determinant) = cofactors(&entries);
        let mean = (xx + yy + zz) * (1.0 / 3.0);
        // Also false for NaN.
        let clearly = xx > 0.0 && cofactors[5] > 0.0 && determinant >= LEAST_DETERMINANT * (mean * mean * mean);
        let per_determinant = 1.0 / determinant;
        (clearly && per_determinant.is_normal()).then(|| Self { entries: cofactors.map(|c| c * per_determinant) })
    }

    fn by_cholesky(m: &Matrix3<f64>) -> Option<Self> {
        let factor = Cholesky::decompose(m)?;
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| factor.solve(&axis));
        Some(Self { entries: [x.x, x.y, x.z, y.y, y.z, z.z] })
    }

    /// The inverse as a matrix.
    pub fn matrix(&self) -> Matrix3<f64> {
        let [xx, xy, xz, yy, yz, zz] = self.entries;
        Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    }

    /// Solves the system with this right-hand side.
    #[inline(always)]
    pub fn times(&self, b: &Vector3<f64>) -> Vector3<f64> {
        let [xx, xy, xz, yy, yz, zz] = self.entries;
        Vector3::new(xx * b.x + xy * b.y + xz * b.z, xy * b.x + yy * b.y + yz * b.z, xz * b.x + yz * b.y + zz * b.z)
    }
}

/// Solves a symmetric positive definite system; None if a pivot of its decomposition is not positive.
pub fn solve_spd(m: &Matrix3<f64>, b: &Vector3<f64>) -> Option<Vector3<f64>> {
    match SymmetricInverse::by_cofactors(m) {
        Some(inverse) => Some(inverse.times(b)),
        None => Cholesky::decompose(m).map(|factor| factor.solve(b)),
    }
}

fn positive_root(x: f64) -> Option<f64> {
    // A denormal pivot would overflow the division that follows.
    (x > 1e-290).then(|| x.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn cofactors_give_the_inverse_of_the_decomposition(
            rows in proptest::array::uniform3([-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64].prop_map(Vector3::from)),
            size in -6.0..6.0f64, shift in 0.0..1.0f64,
        ) {
            let root = Matrix3::from_columns(&rows);
            let m = (root * root.transpose() + Matrix3::identity() * (shift * shift)) * libm::pow(10.0, size);
            let both = SymmetricInverse::by_cofactors(&m).zip(SymmetricInverse::by_cholesky(&m));
            if let Some((found, expected)) = both {
                let (found, expected) = (found.matrix(), expected.matrix());
                prop_assert!((found - expected).amax() <= 1e-10 * expected.amax(), "{found} {expected}");
            }
            // An even number of negative eigenvalues does not hide them.
            let negative = outer(&rows[0], &rows[0]) * 3.0 - Matrix3::identity() * rows[0].norm_squared();
            prop_assert!(SymmetricInverse::of(&negative).is_none(), "{negative}");
        }
    }
}
