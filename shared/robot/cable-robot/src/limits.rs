//! Scaling of cable velocities to their limits without changing the path.
//!
//! N cable velocities and N limits in m/s. There are no errors: values that are not finite give standstill.

use crate::CableVec;

/// Cable velocities after scaling.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scaled {
    /// Cable velocities, m/s.
    pub velocities_m_s: CableVec,
    /// The common scale factor, 0 to 1.
    pub factor: f64,
}

/// Scales all cable velocities by one factor so that each keeps its limit, m/s. Limiting one cable alone would change
/// the path and tension the cables against each other. A value that is not finite, or a missing or negative limit,
/// gives standstill and factor 0.
///
/// ```
/// use cable_robot::CableVec;
/// use cable_robot::limits::scale_to_limits;
/// let wanted = CableVec::from_slice(&[0.2, -0.8, 0.4])?;
/// let scaled = scale_to_limits(&wanted, &[0.4, 0.4, 0.4]);
/// assert_eq!(scaled.factor, 0.5);
/// assert_eq!(&scaled.velocities_m_s[..], &[0.1, -0.4, 0.2]);
/// # Ok::<(), cable_robot::cables::TooManyCables>(())
/// ```
pub fn scale_to_limits(velocities_m_s: &CableVec, limits_m_s: &[f64]) -> Scaled {
    let standstill = Scaled { velocities_m_s: CableVec::zeros(velocities_m_s.len()), factor: 0.0 };
    if limits_m_s.len() < velocities_m_s.len() {
        return standstill;
    }
    let mut factor = 1.0f64;
    for (v, limit) in velocities_m_s.iter().zip(limits_m_s) {
        // Also true for NaN.
        if !(v.is_finite() && *limit >= 0.0) {
            return standstill;
        }
        if v.abs() > *limit {
            factor = factor.min(limit / v.abs());
        }
    }
    // The product may exceed a limit by its last bit.
    let velocities_m_s = velocities_m_s.zip_map(limits_m_s, |v, limit| (v * factor).clamp(-limit, limit));
    Scaled { velocities_m_s, factor }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn direction_is_kept_and_limits_hold(v in proptest::collection::vec(-3.0..3.0f64, 3..=8), limit in 0.01..1.0f64) {
            let wanted = CableVec::from_slice(&v).unwrap();
            let scaled = scale_to_limits(&wanted, &vec![limit; v.len()]);
            prop_assert!(scaled.velocities_m_s.max_abs() <= limit);
            for (a, b) in scaled.velocities_m_s.iter().zip(&v) {
                prop_assert!((a - b * scaled.factor).abs() < 1e-15);
            }
            prop_assert!(scaled.factor == 1.0 || (scaled.velocities_m_s.max_abs() - limit).abs() < 1e-15);
        }
    }

    #[test]
    fn what_is_not_a_number_stands_still() {
        for v in [f64::NAN, f64::INFINITY] {
            let scaled = scale_to_limits(&CableVec::from_slice(&[0.1, v]).unwrap(), &[0.4, 0.4]);
            assert_eq!((scaled.factor, &scaled.velocities_m_s[..]), (0.0, &[0.0, 0.0][..]));
        }
        let v = CableVec::from_slice(&[0.1, 0.2]).unwrap();
        assert_eq!(scale_to_limits(&v, &[0.4]).factor, 0.0);
        assert_eq!(scale_to_limits(&v, &[0.4, f64::NAN]).factor, 0.0);
    }
}
