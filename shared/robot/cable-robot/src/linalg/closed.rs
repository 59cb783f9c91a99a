//! Closed forms for three and four cables in space, from determinants of their unit vectors.
//!
//! Without column k, the other three of a 3 x 4 matrix A have the determinant D_k. The vector n_k = (-1)^k D_k is its
//! null vector, and by Cauchy and Binet |n|² is the determinant of A Aᵀ. The shortest x with A x = b is the mean of the
//! four solutions with one zero, weighted by n_k² / |n|². In each, Cramer's rule divides by D_k, which cancels, so
//! x_j = Σ_k ± n_k b · (a_p x a_q) / |n|² with the two other columns p and q. One division is left, and only
//! determinants are squared: the error is about that of an orthogonal decomposition.

use nalgebra::Vector3;

use crate::{CableVec, MAX_CABLES};

/// Least |n|² at which these forms are used: a volume of 1e-4 of unit vectors. Below it the pose is nearly singular,
/// and a decomposition that finds the rank decides.
const LEAST_SQUARE: f64 = 1e-8;

/// Most |n|², because columns that are no unit vectors could overflow it.
const MOST_SQUARE: f64 = 1e8;

/// The columns of the (pseudo-)inverse of the matrix with these rows; None for another number of rows than three or
/// four, and if they are nearly dependent.
#[inline(always)]
pub(super) fn inverse(rows: &[Vector3<f64>]) -> Option<[Vector3<f64>; MAX_CABLES]> {
    let mut columns = [Vector3::zeros(); MAX_CABLES];
    match *rows {
        [a, b, c] => columns[..3].copy_from_slice(&inverse_of_three(&[a, b, c])?),
        [a, b, c, d] => columns[..4].copy_from_slice(&Four::of(&[a, b, c, d])?.inverse_columns()),
        _ => return None,
    }
    Some(columns)
}

/// The shortest x with A x = b for the matrix A of these columns; None as for [`inverse`].
#[inline(always)]
pub(super) fn shortest(columns: &[Vector3<f64>], b: &Vector3<f64>) -> Option<CableVec> {
    match *columns {
        [u, v, w] => Some(CableVec::from_array(inverse_of_three(&[u, v, w])?.map(|column| column.dot(b)))),
        [u, v, w, x] => Some(CableVec::from_array(Four::of(&[u, v, w, x])?.shortest(b))),
        _ => None,
    }
}

/// The columns of the inverse of the 3 x 3 matrix with these rows; None if they are nearly dependent.
#[inline(always)]
fn inverse_of_three([u, v, w]: &[Vector3<f64>; 3]) -> Option<[Vector3<f64>; 3]> {
    let across = [v.cross(w), w.cross(u), u.cross(v)];
    let volume = u.dot(&across[0]);
    // Also true for NaN.
    if !(LEAST_SQUARE..=MOST_SQUARE).contains(&(volume * volume)) {
        return None;
    }
    let per_volume = 1.0 / volume;
    Some(across.map(|across| across * per_volume))
}

/// What the closed forms of four columns share.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Four {
    /// Cross products of the columns 01, 02, 03, 12, 13 and 23.
    across: [Vector3<f64>; 6],
    /// The null vector n.
    pub null: [f64; 4],
    /// |n|².
    pub square: f64,
}

impl Four {
    /// None if the columns are nearly dependent.
    #[inline(always)]
    pub(crate) fn of([a, b, c, d]: &[Vector3<f64>; 4]) -> Option<Self> {
        let across = [a.cross(b), a.cross(c), a.cross(d), b.cross(c), b.cross(d), c.cross(d)];
        let null = [b.dot(&across[5]), -a.dot(&across[5]), d.dot(&across[0]), -c.dot(&across[0])];
        let square = (null[0] * null[0] + null[1] * null[1]) + (null[2] * null[2] + null[3] * null[3]);
        // False for NaN.
        (LEAST_SQUARE..=MOST_SQUARE).contains(&square).then_some(Self { across, null, square })
    }

    /// The shortest x with A x = b.
    #[inline(always)]
    pub(crate) fn shortest(&self, b: &Vector3<f64>) -> [f64; 4] {
        let [ab, ac, ad, bc, bd, cd] = self.across.each_ref().map(|across| across.dot(b));
        let [n0, n1, n2, n3] = self.weights();
        [
            n2 * bd - n1 * cd - n3 * bc,
            n0 * cd - n2 * ad + n3 * ac,
            n1 * ad - n0 * bd - n3 * ab,
            n0 * bc - n1 * ac + n2 * ab,
        ]
    }

    /// The columns of the pseudo-inverse of Aᵀ: x_j of [`Self::shortest`] is column j · b.
    #[inline(always)]
    pub(crate) fn inverse_columns(&self) -> [Vector3<f64>; 4] {
        let [ab, ac, ad, bc, bd, cd] = &self.across;
        let [n0, n1, n2, n3] = self.weights();
        [
            bd * n2 - cd * n1 - bc * n3,
            cd * n0 - ad * n2 + ac * n3,
            ad * n1 - bd * n0 - ab * n3,
            bc * n0 - ac * n1 + ab * n2,
        ]
    }

    /// n / |n|².
    #[inline(always)]
    fn weights(&self) -> [f64; 4] {
        let per_square = 1.0 / self.square;
        self.null.map(|n| n * per_square)
    }
}

/// Determinant of three columns.
fn det3(a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>) -> f64 {
    a.dot(&b.cross(c))
}

/// The null vector, also of nearly dependent columns.
pub(crate) fn null_vector([a, b, c, d]: &[Vector3<f64>; 4]) -> [f64; 4] {
    [det3(b, c, d), -det3(a, c, d), det3(a, b, d), -det3(a, b, c)]
}
