//! The scale of a cable from a tape, compared with moves whose truth is known.

use calibration::length_check::{LengthCheckError, TapeCheck, scale};
use proptest::prelude::*;

const COUNTS_PER_M: f64 = 43_460.0;

fn one(counted_m: f64, tape_m: f64) -> TapeCheck {
    let counts_after = 1_000 + (counted_m * COUNTS_PER_M).round() as i64;
    TapeCheck { counts_before: 1_000, counts_after, tape_m, tape_sigma_m: 0.0025 }
}

/// Sum of twelve even numbers: mean 0, variance 1.
fn normal(even: &[f64]) -> f64 {
    even.iter().sum::<f64>() - 6.0
}

proptest! {
    #[test]
    fn exact_moves_give_the_true_scale_in_either_direction(
        truth in 0.92..1.08f64, tapes in prop::collection::vec(1.0..20.0f64, 1..5), sign in prop_oneof![Just(1.0), Just(-1.0)],
    ) {
        let out: Vec<TapeCheck> = tapes.iter().map(|tape| one(truth * tape, *tape)).collect();
        let found = scale(&out, sign * COUNTS_PER_M).unwrap();
        // Half a count at either end of a metre.
        prop_assert!((found.scale - truth).abs() < 1.01 / COUNTS_PER_M, "{found:?}");
        prop_assert!((found.counts_per_m / (sign * COUNTS_PER_M * truth) - 1.0).abs() < 2.0 / COUNTS_PER_M);
        // A mark that moves back counts the same.
        let back: Vec<TapeCheck> = out
            .iter()
            .map(|one| TapeCheck { counts_before: one.counts_after, counts_after: one.counts_before, ..*one })
            .collect();
        prop_assert_eq!(scale(&back, sign * COUNTS_PER_M).unwrap(), found);
        // The longer the tape, the better, and every further move helps.
        let fewer = scale(&out[..1], COUNTS_PER_M).unwrap();
        prop_assert!(found.std <= fewer.std && (fewer.std * tapes[0] / 0.0025 / truth - 1.0).abs() < 0.01);
    }
}

#[test]
fn the_stated_deviation_is_that_of_repeated_checks() {
    let mut state = 7_u64;
    let mut even = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let (mut sum, mut inside, rounds) = (0.0, 0, 2_000);
    for _ in 0..rounds {
        let truth = 1.004;
        let moves: Vec<TapeCheck> = (0..2)
            .map(|_| {
                let draws: Vec<f64> = (0..12).map(|_| even()).collect();
                one(truth * (5.0 + 0.0025 * normal(&draws)), 5.0)
            })
            .collect();
        let Ok(found) = scale(&moves, COUNTS_PER_M) else { continue };
        let off = (found.scale - truth) / (1.004 * 0.0025 / 5.0 / 2.0f64.sqrt());
        sum += off * off;
        inside += usize::from((found.scale - truth).abs() < 2.0 * found.std);
    }
    let (variance, share) = (sum / f64::from(rounds), inside as f64 / f64::from(rounds));
    assert!((variance - 1.0).abs() < 0.12, "{variance}");
    // 95 % of a normal distribution, and more because the scatter only ever widens the interval.
    assert!((0.945..0.995).contains(&share), "{share}");
}

#[test]
fn moves_that_tell_nothing_or_contradict_are_refused() {
    let good = one(5.0, 5.0);
    assert_eq!(scale(&[], COUNTS_PER_M), Err(LengthCheckError::NoMove));
    for counts_per_m in [0.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(scale(&[good], counts_per_m), Err(LengthCheckError::CountsPerM { .. })));
    }
    for (tape_m, tape_sigma_m) in
        [(0.5, 0.002), (-5.0, 0.002), (f64::NAN, 0.002), (5.0, 0.0), (5.0, f64::NAN), (5.0, 6.0)]
    {
        let bad = TapeCheck { tape_m, tape_sigma_m, ..good };
        assert!(matches!(scale(&[good, bad], COUNTS_PER_M), Err(LengthCheckError::Tape { number: 2, .. })), "{bad:?}");
    }
    // The encoder did not count, or feet were typed for metres.
    for counted_m in [0.0, 5.0 * 0.3048] {
        assert!(matches!(scale(&[one(counted_m, 5.0)], COUNTS_PER_M), Err(LengthCheckError::Unlike { number: 1, .. })));
    }
    let extreme = TapeCheck { counts_before: i64::MIN, counts_after: i64::MAX, ..good };
    assert!(matches!(scale(&[extreme], COUNTS_PER_M), Err(LengthCheckError::Unlike { .. })));
    // One of three moves slipped by 5 cm.
    let slipped = [good, one(5.05, 5.0), good];
    let why = scale(&slipped, COUNTS_PER_M).unwrap_err();
    let LengthCheckError::Contradiction { number: 2, scale, mean, std } = why else { panic!("{why:?}") };
    assert!(std > 0.0 && (scale - mean).abs() > 2.0 * std, "{why}");
}
