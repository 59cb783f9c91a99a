//! The angle of a direction in a plane, from sine and cosine together.
//!
//! A general `atan2` divides, and decides by branches for every pair of numbers. For a unit vector the sum theorem
//! sin(φ - φₖ) = sin φ cos φₖ - cos φ sin φₖ reduces the angle to that from a near direction of a table, whose arc sine
//! is a short series. The result has the error of a few roundings, and needs only sums and products, so it is the same
//! on every processor.

use core::f64::consts::{FRAC_PI_2, PI};

/// Steps of the table over the sines of the first octant.
const STEPS: f64 = 11.0;

/// Directions whose sines are k / 11, for k of 0 to 8: angle, sine, cosine. The last of these is
/// beyond 45 degrees; the rest is never used and makes the number of entries a power of two.
const TABLE: [[f64; 3]; 16] = [
    [0.0, 0.0, 1.0],
    [0.091_034_778_037_415_08, 0.090_909_090_909_090_91, 0.995_859_195_463_938_4],
    [0.182_835_136_992_908_74, 0.181_818_181_818_181_82, 0.983_332_166_035_633_4],
    [0.276_226_630_763_591_55, 0.272_727_272_727_272_7, 0.962_091_385_841_669_3],
    [0.372_168_533_960_325_95, 0.363_636_363_636_363_65, 0.931_540_978_723_599_9],
    [0.471_861_837_279_641_87, 0.454_545_454_545_454_53, 0.890_723_542_830_246_6],
    [0.576_931_345_236_456_8, 0.545_454_545_454_545_4, 0.838_140_405_208_444_4],
    [0.689_775_000_785_499_7, 0.636_363_636_363_636_4, 0.771_389_215_839_870_1],
    [0.814_339_942_126_525_3, 0.727_272_727_272_727_3, 0.686_348_585_024_613_6],
    [0.0; 3],
    [0.0; 3],
    [0.0; 3],
    [0.0; 3],
    [0.0; 3],
    [0.0; 3],
    [0.0; 3],
];

/// Angle at which each octant begins or ends, and the direction in which the reduced angle counts in it; by whether the
/// sine is the larger one (1) and whether the cosine is negative (2).
const OCTANTS: [[f64; 2]; 4] = [[0.0, 1.0], [FRAC_PI_2, -1.0], [PI, -1.0], [FRAC_PI_2, 1.0]];

/// Computes the angle of the unit vector (cos φ, sin φ), from -π to π.
#[inline]
pub(crate) fn from_unit(sine: f64, cosine: f64) -> f64 {
    let (a, b) = (sine.abs(), cosine.abs());
    let (low, high) = if a > b { (b, a) } else { (a, b) };
    // A unit vector gives at most 8; NaN gives 0 here and NaN below.
    let [near, near_sine, near_cosine] = TABLE[(low * STEPS + 0.5) as i32 as usize & 15];
    // At most 0.062: the first omitted term of the series is below 4e-18.
    let s = low * near_cosine - high * near_sine;
    let q = s * s;
    let qq = q * q;
    let first = 1.0 / 6.0 + q * (3.0 / 40.0);
    let last = (5.0 / 112.0 + q * (35.0 / 1152.0)) + qq * (63.0 / 2816.0);
    let octant = near + (s + s * (q * (first + qq * last)));
    let [start, sign] = OCTANTS[usize::from(a > b) | usize::from(cosine < 0.0) << 1];
    let half = start + sign * octant;
    if sine < 0.0 { -half } else { half }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_table_has_the_angles_of_its_sines() {
        for (k, [angle, sine, cosine]) in TABLE[..9].iter().enumerate() {
            assert_eq!(*sine, k as f64 / STEPS);
            assert!((angle.sin() - sine).abs() < 2e-16 && (angle.cos() - cosine).abs() < 2e-16, "{k}");
        }
    }

    #[test]
    fn the_axes_and_diagonals_are_exact_to_rounding() {
        for k in -8..=8 {
            let angle = f64::from(k) * std::f64::consts::FRAC_PI_8;
            assert!((from_unit(angle.sin(), angle.cos()) - angle).abs() < 1e-15, "{angle}");
        }
        assert!(from_unit(f64::NAN, 0.5).is_nan() && from_unit(0.5, f64::NAN).is_nan());
    }

    proptest! {
        #[test]
        fn it_is_the_arc_tangent(angle in -3.1..3.1f64, share in 0.0..1.0f64) {
            // Near multiples of 45 degrees too, where the octants meet.
            let near = (angle / std::f64::consts::FRAC_PI_4).round() * std::f64::consts::FRAC_PI_4 + 1e-9 * (share - 0.5);
            for angle in [angle, near] {
                let (sine, cosine) = (angle.sin(), angle.cos());
                let off = (from_unit(sine, cosine) - libm::atan2(sine, cosine)).abs();
                prop_assert!(off < 1e-15 * angle.abs().max(0.5), "{angle}: {off:e}");
            }
        }
    }
}
