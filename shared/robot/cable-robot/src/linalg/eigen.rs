//! Eigenvalues and eigenvectors of symmetric matrices by Jacobi's rotations.

use nalgebra::{Matrix3, Vector3};

/// Bound of the sweeps, each of which at least squares what is left outside of the diagonal; about four are needed.
const SWEEPS: usize = 30;

/// Squared share of the diagonal below which the rest is rounding.
const ROUNDING: f64 = 1e-32;

/// Cotangent above which the square of the tangent is lost beside 1, and 1 beside the square of the cotangent, whose
/// root is the cotangent again. A rotation has the same bits without the two roots and a quotient, each of which waits
/// for the one before.
const STEEP: f64 = 134_217_728.0;

/// Cotangent below which its square does not overflow.
const STEEPEST: f64 = 1e150;

/// Three eigenvalues with their orthonormal eigenvectors, in any order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SymmetricEigen {
    pub values: [f64; 3],
    pub vectors: [Vector3<f64>; 3],
}

impl SymmetricEigen {
    /// Of the upper triangle. None if an entry is not finite.
    pub(crate) fn of(m: &Matrix3<f64>) -> Option<Self> {
        let mut rows = std::array::from_fn(|i| std::array::from_fn(|j| m[(i, j)]));
        let mut vectors = [Vector3::x(), Vector3::y(), Vector3::z()];
        for _ in 0..SWEEPS {
            let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] = rows;
            let (outside, diagonal) = (xy * xy + xz * xz + yz * yz, xx * xx + yy * yy + zz * zz);
            // False for NaN.
            if diagonal < f64::INFINITY && outside <= ROUNDING * diagonal {
                return Some(Self { values: [xx, yy, zz], vectors });
            }
            rotate::<0, 1>(&mut rows, &mut vectors);
            rotate::<0, 2>(&mut rows, &mut vectors);
            rotate::<1, 2>(&mut rows, &mut vectors);
        }
        None
    }

    /// As [`Self::of`], from a right-handed orthonormal basis near the eigenvectors, such as [`Self::vectors`] of a
    /// matrix that differs little: one or two sweeps are left, and none where it differs by rounding.
    pub(crate) fn near(m: &Matrix3<f64>, basis: &[Vector3<f64>; 3]) -> Option<Self> {
        let basis = Matrix3::from_columns(basis);
        let found = Self::of(&(basis.transpose() * m * basis))?;
        // Rounding would add up from call to call.
        let first = (basis * found.vectors[0]).normalize();
        let second = basis * found.vectors[1];
        let second = (second - first * first.dot(&second)).normalize();
        Some(Self { vectors: [first, second, first.cross(&second)], ..found })
    }
}

/// Tangent and cosine of the smaller of the two angles whose double has this cotangent.
#[inline(always)]
fn angle(cotangent: f64) -> (f64, f64) {
    let steep = cotangent.abs();
    if (STEEP..STEEPEST).contains(&steep) {
        return (1.0_f64.copysign(cotangent) / (steep + steep), 1.0);
    }
    let tangent = 1.0_f64.copysign(cotangent) / (steep + (cotangent * cotangent + 1.0).sqrt());
    (tangent, 1.0 / (tangent * tangent + 1.0).sqrt())
}

/// Rotates in the plane of two axes P < Q, so that their entry vanishes.
#[inline(always)]
fn rotate<const P: usize, const Q: usize>(rows: &mut [[f64; 3]; 3], vectors: &mut [Vector3<f64>; 3]) {
    let entry = rows[P][Q];
    if entry == 0.0 {
        return;
    }
    // tan 2φ = 1 / cotangent. A cotangent whose square overflows means none.
    let cotangent = (rows[Q][Q] - rows[P][P]) / (2.0 * entry);
    let (tangent, cosine) = angle(cotangent);
    let sine = tangent * cosine;
    rows[P][P] -= tangent * entry;
    rows[Q][Q] += tangent * entry;
    rows[P][Q] = 0.0;
    let other = 3 - P - Q;
    let of = |axis: usize| if other < axis { (other, axis) } else { (axis, other) };
    let ((ip, jp), (iq, jq)) = (of(P), of(Q));
    let (p, q) = (rows[ip][jp], rows[iq][jq]);
    (rows[ip][jp], rows[iq][jq]) = (cosine * p - sine * q, sine * p + cosine * q);
    (vectors[P], vectors[Q]) = (vectors[P] * cosine - vectors[Q] * sine, vectors[P] * sine + vectors[Q] * cosine);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn value() -> impl Strategy<Value = f64> {
        prop_oneof![Just(1.0), -2.0..2.0f64, (-6.0..0.0f64).prop_map(|e| libm::pow(10.0, e))]
    }

    proptest! {
        /// Without the roots, too.
        #[test]
        fn small_angles_have_the_bits_of_the_whole_formula(mantissa in 1.0..2.0f64, exponent in 20..560i32, negative in any::<bool>()) {
            let cotangent = libm::ldexp(if negative { -mantissa } else { mantissa }, exponent);
            let tangent = 1.0_f64.copysign(cotangent) / (cotangent.abs() + (cotangent * cotangent + 1.0).sqrt());
            let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
            let found = angle(cotangent);
            prop_assert_eq!((found.0.to_bits(), found.1.to_bits()), (tangent.to_bits(), cosine.to_bits()));
        }

        /// Also with equal eigenvalues, and with a stiffness that is 1e6 times another.
        #[test]
        fn eigenvectors_are_orthonormal_and_scaled_by_their_eigenvalues(
            turn in [-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64].prop_map(Vector3::from),
            expected in proptest::array::uniform3(value()),
            size in -3.0..6.0f64,
        ) {
            let turn = nalgebra::Rotation3::new(turn * 3.0).into_inner();
            let m = turn * Matrix3::from_diagonal(&Vector3::from(expected)) * turn.transpose() * libm::pow(10.0, size);
            let largest = m.amax();
            let found = SymmetricEigen::of(&m).unwrap();
            for (value, vector) in found.values.iter().zip(&found.vectors) {
                prop_assert!((m * vector - vector * *value).amax() <= 1e-14 * largest, "{m} {found:?}");
            }
            let basis = Matrix3::from_columns(&found.vectors);
            prop_assert!((basis.transpose() * basis - Matrix3::identity()).amax() <= 1e-14, "{m} {found:?}");
            let sorted = |mut values: [f64; 3]| {
                values.sort_by(f64::total_cmp);
                values
            };
            let expected = sorted(expected.map(|value| value * libm::pow(10.0, size)));
            for (a, e) in sorted(found.values).iter().zip(expected) {
                prop_assert!((a - e).abs() <= 1e-14 * largest.max(e.abs()), "{found:?} {expected:?}");
            }
        }
    }

    /// A matrix that turns and grows from call to call: from the last basis the result is as accurate as from the
    /// beginning, also after a million calls.
    #[test]
    fn a_basis_from_call_to_call_stays_orthonormal() {
        let mut basis = [Vector3::x(), Vector3::y(), Vector3::z()];
        for call in 0..1_000_000 {
            let angle = f64::from(call) * 1e-3;
            let turn = nalgebra::Rotation3::new(Vector3::new(0.3, 0.7, -0.2) * angle).into_inner();
            let m = turn * Matrix3::from_diagonal(&Vector3::new(4.0, 1.0 + 1e-6 * angle, 0.5)) * turn.transpose();
            let found = SymmetricEigen::near(&m, &basis).unwrap();
            basis = found.vectors;
            if call % 1000 == 999 {
                let is = Matrix3::from_columns(&basis);
                assert!((is.transpose() * is - Matrix3::identity()).amax() <= 2e-15 && is.determinant() > 0.0);
                for (value, vector) in found.values.iter().zip(&found.vectors) {
                    assert!((m * vector - vector * *value).amax() <= 1e-14 * m.amax(), "{call} {found:?}");
                }
            }
        }
    }

    #[test]
    fn what_is_not_finite_has_no_eigenvalues() {
        for wrong in [f64::NAN, f64::INFINITY] {
            assert_eq!(SymmetricEigen::of(&(Matrix3::identity() * wrong)), None);
            assert_eq!(SymmetricEigen::of(&Matrix3::new(1.0, wrong, 0.0, wrong, 1.0, 0.0, 0.0, 0.0, 1.0)), None);
        }
        let none = SymmetricEigen::of(&Matrix3::zeros()).unwrap();
        assert_eq!(none.values, [0.0; 3]);
    }
}
