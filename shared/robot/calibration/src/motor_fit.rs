//! Motor current table from recordings of raising and lowering loads.
//!
//! Each sample has a reel-in speed, a tension and the measured current. The fit minimises the squared current error
//! of the bilinear table over all samples, with a weak regularisation towards straight lines, so that few samples do
//! not cause oscillations. A table point without samples is not extrapolated: [`fit`] rejects it, and [`covered`]
//! does not select it.
//!
//! # Example
//! ```
//! use cable_robot::energy::{Current, CurrentTable};
//! use calibration::motor_fit::{Sample, covered, fit};
//! use cable_robot::motor::Motor;
//! let motor = Motor::default();
//! let samples: Vec<Sample> = (0..4000)
//!     .map(|i| {
//!         let (reel_in_m_s, tension_n) = (f64::from(i % 81 - 40) * 0.01, f64::from(i / 81) * 0.8 + 2.0);
//!         Sample { reel_in_m_s, tension_n, current_a: motor.current_a(tension_n, reel_in_m_s) }
//!     })
//!     .collect();
//! let (speeds, tensions) = covered(&samples)?;
//! let found = fit(&samples, &speeds, &tensions)?;
//! let table = CurrentTable::new(speeds, tensions, &found.currents_a, motor.resistance_ohm)?;
//! assert!((table.current_a(20.0, 0.25)? - motor.current_a(20.0, 0.25)).abs() < 0.02);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use nalgebra::{DMatrix, DVector};
use thiserror::Error;

use cable_robot::energy::table::{MAX_SPEEDS, MAX_TENSIONS, locate};

/// Possible speeds of a table in either direction, m/s: closer together where friction changes its sign.
const SPEEDS_M_S: [f64; 11] = [0.01, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8];

/// Possible steps between the tensions of a table, N; the finest that keeps the number of tensions within
/// the limit is used.
const TENSION_STEPS_N: [f64; 8] = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0];

/// Number of samples required around each point of the table.
pub const NEEDED: usize = 3;

/// Least number of speeds of a selected table in either direction: with one, a straight line from standstill to it
/// replaces the bend of the friction, which was 24 % wrong in flights with a motor for each cable.
const LEAST_SPEEDS: usize = 2;

/// Weight of the regularisation towards straight lines, in samples per point.
const STRAIGHTNESS: f64 = 0.02;

/// A measurement of one winch at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Reel-in speed -dL/dt, m/s.
    pub reel_in_m_s: f64,
    /// Cable tension, N.
    pub tension_n: f64,
    /// Armature current, A.
    pub current_a: f64,
}

/// The currents of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// Currents, a row per speed, A.
    pub currents_a: Vec<Vec<f64>>,
    /// Number of samples inside the table.
    pub samples: usize,
    /// Root mean square difference of samples and table, A.
    pub rms_residual_a: f64,
}

/// Why samples do not determine a table.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum FitError {
    /// No samples, or far too few.
    #[error(
        "there are {given} usable samples of steady motion, and a table needs hundreds; record runs that raise and lower known loads at several speeds"
    )]
    TooFew {
        /// Number of samples.
        given: usize,
    },
    /// Too few samples in one direction.
    #[error(
        "the runs have too few samples of {missing} at different speeds and tensions; record runs that raise and lower known loads at several speeds"
    )]
    OneWay {
        /// Missing direction: `reeling in` or `paying out`.
        missing: &'static str,
    },
    /// Enough samples at too few speeds.
    #[error(
        "the runs have enough samples at the speeds {} m/s only, and a table needs {LEAST_SPEEDS} in each direction; record runs with steady moves of this cable at more speeds, or use all motors together", list(.speeds_m_s)
    )]
    FewSpeeds {
        /// Speeds that are covered, m/s.
        speeds_m_s: Vec<f64>,
    },
    /// Too small a range of tensions.
    #[error(
        "the runs contain tensions from {low_n:.1} to {high_n:.1} N only; record runs with lighter and heavier loads, at large and small heights"
    )]
    OneTension {
        /// Lowest tension, N.
        low_n: f64,
        /// Highest tension, N.
        high_n: f64,
    },
    /// A point of the table without enough samples.
    #[error(
        "the runs have {given} samples near {reel_in_m_s} m/s and {tension_n} N, and {NEEDED} are needed there; record a run with this speed and tension, or request fewer speeds or tensions"
    )]
    Uncovered {
        /// Speed of the point, m/s.
        reel_in_m_s: f64,
        /// Tension of the point, N.
        tension_n: f64,
        /// Number of samples at the point.
        given: usize,
    },
    /// Invalid axes of a table.
    #[error("speeds and tensions of a table rise, two or more of each, and at most {MAX_SPEEDS} and {MAX_TENSIONS}")]
    Axes,
}

fn list(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ")
}

/// Selects speeds (m/s) and tensions (N) of the largest table that the samples cover completely. For every range of
/// tensions it takes the speeds covered over all of it; of these tables, the one with the largest product of the ranges
/// of speed (in both directions) and tension. A table has at least two speeds in each direction.
pub fn covered(samples: &[Sample]) -> Result<(Vec<f64>, Vec<f64>), FitError> {
    let (low_n, high_n) = samples
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), s| (low.min(s.tension_n), high.max(s.tension_n)));
    if samples.len() < 10 * NEEDED || !(high_n - low_n).is_finite() {
        return Err(FitError::TooFew { given: samples.len() });
    }
    let ticks = |step: f64| {
        let (first, last) = ((low_n / step).ceil() as i64, (high_n / step).floor() as i64);
        (first..=last).map(|i| i as f64 * step).collect::<Vec<f64>>()
    };
    let tensions =
        TENSION_STEPS_N.iter().map(|step| ticks(*step)).find(|ticks| ticks.len() <= MAX_TENSIONS).unwrap_or_default();
    if tensions.len() < 2 {
        return Err(FitError::OneTension { low_n, high_n });
    }
    let all: Vec<f64> = SPEEDS_M_S.iter().rev().map(|v| -v).chain([0.0]).chain(SPEEDS_M_S.iter().copied()).collect();
    let mut best: Option<(f64, Vec<f64>, &[f64])> = None;
    let mut coarse: Option<Vec<f64>> = None;
    for first in 0..tensions.len() {
        for last in first + 1..tensions.len() {
            let tensions = &tensions[first..=last];
            let speeds = covered_speeds(samples, all.clone(), tensions);
            let (Some(slowest), Some(fastest)) = (speeds.first(), speeds.last()) else { continue };
            let reach = fastest.min(-slowest) * (tensions[tensions.len() - 1] - tensions[0]);
            if reach > 0.0 && !are_enough(&speeds) {
                coarse = coarse.filter(|most| most.len() >= speeds.len()).or(Some(speeds));
            } else if reach > 0.0 && best.as_ref().is_none_or(|(most, ..)| reach > *most) {
                best = Some((reach, speeds, tensions));
            }
        }
    }
    match (best, coarse) {
        (Some((_, speeds, tensions)), _) => Ok((speeds, tensions.to_vec())),
        (None, Some(speeds_m_s)) => Err(FitError::FewSpeeds { speeds_m_s }),
        (None, None) => {
            let paid_out = samples.iter().filter(|sample| sample.reel_in_m_s < 0.0).count();
            let missing = if 2 * paid_out < samples.len() { "paying out" } else { "reeling in" };
            Err(FitError::OneWay { missing })
        }
    }
}

fn are_enough(speeds_m_s: &[f64]) -> bool {
    let number = |of: fn(&&f64) -> bool| speeds_m_s.iter().filter(of).count();
    number(|v| **v > 0.0).min(number(|v| **v < 0.0)) >= LEAST_SPEEDS
}

/// Speeds that are covered at all of these tensions.
fn covered_speeds(samples: &[Sample], mut speeds: Vec<f64>, tensions: &[f64]) -> Vec<f64> {
    while speeds.len() >= 2 {
        let counts = counts(samples, &speeds, tensions);
        let kept: Vec<f64> = speeds
            .iter()
            .zip(counts.chunks(tensions.len()))
            .filter(|(_, row)| row.iter().all(|count| *count >= NEEDED))
            .map(|(speed, _)| *speed)
            .collect();
        // Samples of a removed speed count for its neighbours: count them again.
        if kept.len() == speeds.len() {
            return speeds;
        }
        speeds = kept;
    }
    Vec::new()
}

/// Fits the currents of a table to the samples inside it. Every point needs [`NEEDED`] samples that are nearer to it
/// than to any other.
pub fn fit(samples: &[Sample], speeds_m_s: &[f64], tensions_n: &[f64]) -> Result<Fit, FitError> {
    let rises = |axis: &[f64], most: usize| {
        (2..=most).contains(&axis.len())
            && axis.iter().all(|v| v.is_finite())
            && axis.windows(2).all(|pair| pair[0] < pair[1])
    };
    if !rises(speeds_m_s, MAX_SPEEDS) || !rises(tensions_n, MAX_TENSIONS) {
        return Err(FitError::Axes);
    }
    let (rows, columns) = (speeds_m_s.len(), tensions_n.len());
    let counts = counts(samples, speeds_m_s, tensions_n);
    if let Some(at) = counts.iter().position(|count| *count < NEEDED) {
        let (reel_in_m_s, tension_n) = (speeds_m_s[at / columns], tensions_n[at % columns]);
        return Err(FitError::Uncovered { reel_in_m_s, tension_n, given: counts[at] });
    }
    let mut normal = DMatrix::<f64>::zeros(rows * columns, rows * columns);
    let mut right = DVector::<f64>::zeros(rows * columns);
    let mut add = |terms: &[(usize, f64)], value: f64, weight: f64| {
        for (a, x) in terms {
            right[*a] += weight * x * value;
            for (b, y) in terms {
                normal[(*a, *b)] += weight * x * y;
            }
        }
    };
    let inside: Vec<([(usize, f64); 4], f64)> = samples
        .iter()
        .filter_map(|sample| Some((corners(sample, speeds_m_s, tensions_n)?, sample.current_a)))
        .filter(|(_, current)| current.is_finite())
        .collect();
    for (terms, current) in &inside {
        add(terms, *current, 1.0);
    }
    // Second differences over the uneven axes, scaled so that a bend of 1 A over neighbouring points counts as 1 A.
    let weight = STRAIGHTNESS * inside.len() as f64 / (rows * columns) as f64;
    let mut straighten = |axis: &[f64], i: usize, at: &dyn Fn(usize) -> usize| {
        let (before, after) = (axis[i] - axis[i - 1], axis[i + 1] - axis[i]);
        let share = after / (before + after);
        add(&[(at(i - 1), share), (at(i), -1.0), (at(i + 1), 1.0 - share)], 0.0, weight);
    };
    for j in 0..columns {
        // Around standstill the current does bend: there only the samples count.
        for i in (1..rows - 1).filter(|i| speeds_m_s[i - 1] >= 0.0 || speeds_m_s[i + 1] <= 0.0) {
            straighten(speeds_m_s, i, &|i| i * columns + j);
        }
    }
    for i in 0..rows {
        for j in 1..columns - 1 {
            straighten(tensions_n, j, &|j| i * columns + j);
        }
    }
    let found = normal.cholesky().ok_or(FitError::TooFew { given: inside.len() })?.solve(&right);
    let squares: f64 = inside
        .iter()
        .map(|(terms, current)| (terms.iter().map(|(at, share)| share * found[*at]).sum::<f64>() - current).powi(2))
        .sum();
    Ok(Fit {
        currents_a: (0..rows).map(|i| (0..columns).map(|j| found[i * columns + j]).collect()).collect(),
        samples: inside.len(),
        rms_residual_a: (squares / inside.len() as f64).sqrt(),
    })
}

/// The four points around a sample with their weights; None outside the table.
fn corners(sample: &Sample, speeds_m_s: &[f64], tensions_n: &[f64]) -> Option<[(usize, f64); 4]> {
    let (i, u) = locate(speeds_m_s, sample.reel_in_m_s, "speed", "m/s").ok()?;
    let (j, w) = locate(tensions_n, sample.tension_n, "tension", "N").ok()?;
    let at = |i: usize, j: usize| i * tensions_n.len() + j;
    Some([
        (at(i, j), (1.0 - u) * (1.0 - w)),
        (at(i, j + 1), (1.0 - u) * w),
        (at(i + 1, j), u * (1.0 - w)),
        (at(i + 1, j + 1), u * w),
    ])
}

/// Number of samples inside the table that are nearest to each of its points, row by row.
fn counts(samples: &[Sample], speeds_m_s: &[f64], tensions_n: &[f64]) -> Vec<usize> {
    let mut counts = vec![0; speeds_m_s.len() * tensions_n.len()];
    for terms in samples.iter().filter_map(|sample| corners(sample, speeds_m_s, tensions_n)) {
        if let Some((at, _)) = terms.iter().max_by(|a, b| a.1.total_cmp(&b.1)) {
            counts[*at] += 1;
        }
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;
    use cable_robot::energy::{Current, CurrentTable};
    use cable_robot::motor::Motor;
    use proptest::prelude::*;

    /// Quasi-random samples over a range, with a current error of up to `noise_a`.
    fn samples(count: u32, fastest: f64, tensions: [f64; 2], noise_a: f64) -> Vec<Sample> {
        let motor = Motor::default();
        // Fractions of multiples of the golden ratio and of its square cover the unit square evenly.
        let spread = |i: u32, step: f64| (f64::from(i) * step).fract();
        (0..count)
            .map(|i| {
                let reel_in_m_s = fastest * (2.0 * spread(i, 0.754_877_666) - 1.0);
                let tension_n = tensions[0] + (tensions[1] - tensions[0]) * spread(i, 0.569_840_291);
                let noise = noise_a * (2.0 * spread(i, 0.414_213_562) - 1.0);
                Sample { reel_in_m_s, tension_n, current_a: motor.current_a(tension_n, reel_in_m_s) + noise }
            })
            .collect()
    }

    #[test]
    fn a_motor_is_recovered_from_noisy_samples() {
        let motor = Motor::default();
        let given = samples(6000, 0.42, [1.5, 42.0], 0.1);
        let (speeds, tensions) = covered(&given).unwrap();
        assert_eq!((speeds[0], speeds[speeds.len() - 1]), (-0.4, 0.4));
        assert!(tensions[0] <= 5.0 && tensions[tensions.len() - 1] >= 40.0, "{tensions:?}");
        let found = fit(&given, &speeds, &tensions).unwrap();
        assert!((0.03..0.08).contains(&found.rms_residual_a), "{}", found.rms_residual_a);
        let table = CurrentTable::new(speeds, tensions, &found.currents_a, 1.2).unwrap();
        for (v, t) in [(-0.3, 10.0), (-0.1, 30.0), (0.02, 20.0), (0.25, 38.0), (0.4, 6.0)] {
            let (read, truth) = (table.current_a(t, v).unwrap(), motor.current_a(t, v));
            assert!((read - truth).abs() < 0.06, "{v} {t}: {read} {truth}");
        }
    }

    #[test]
    fn uncovered_points_are_excluded_or_named() {
        // Fast reeling in of heavy loads is missing.
        let given: Vec<Sample> = samples(6000, 0.4, [2.0, 40.0], 0.0)
            .into_iter()
            .filter(|s| s.reel_in_m_s < 0.15 || s.tension_n < 22.0)
            .collect();
        let (speeds, tensions) = covered(&given).unwrap();
        let corner = (speeds[speeds.len() - 1], tensions[tensions.len() - 1]);
        assert!(corner.0 <= 0.2 || corner.1 <= 24.0, "{corner:?}");
        assert!(fit(&given, &speeds, &tensions).is_ok());
        let error = fit(&given, &[-0.4, 0.0, 0.4], &[2.0, 20.0, 40.0]).unwrap_err();
        assert_eq!(error, FitError::Uncovered { reel_in_m_s: 0.4, tension_n: 40.0, given: 0 });
        assert!(["0.4 m/s", "40 N"].iter().all(|number| error.to_string().contains(number)), "{error}");
    }

    #[test]
    fn runs_with_too_few_samples_are_refused() {
        let all = samples(2000, 0.4, [2.0, 40.0], 0.0);
        let only = |keep: fn(&Sample) -> bool| covered(&all.iter().copied().filter(keep).collect::<Vec<_>>());
        assert_eq!(only(|s| s.reel_in_m_s > 0.03), Err(FitError::OneWay { missing: "paying out" }));
        assert_eq!(only(|s| s.reel_in_m_s < -0.03), Err(FitError::OneWay { missing: "reeling in" }));
        assert!(matches!(only(|s| (s.tension_n - 20.0).abs() < 0.4), Err(FitError::OneTension { .. })));
        let slow_or_fast = only(|s| s.reel_in_m_s.abs() < 0.002 || s.reel_in_m_s.abs() > 0.36).unwrap_err();
        assert!(matches!(&slow_or_fast, FitError::FewSpeeds { .. }), "{slow_or_fast}");
        assert!(matches!(covered(&all[..5]), Err(FitError::TooFew { given: 5 })));
        assert_eq!(fit(&all, &[0.1, 0.0], &[2.0, 40.0]), Err(FitError::Axes));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]

        /// For any samples: the selected table can be fitted, and reproduces bilinear data.
        #[test]
        fn a_covered_table_can_be_fitted(count in 200u32..3000, fastest in 0.05..0.8f64, low in 0.0..20.0f64, width in 5.0..60.0f64) {
            let mut given = samples(count, fastest, [low, low + width], 0.0);
            for sample in &mut given {
                sample.current_a = 0.3 + 2.0 * sample.reel_in_m_s + 0.05 * sample.tension_n;
            }
            if let Ok((speeds, tensions)) = covered(&given) {
                let found = fit(&given, &speeds, &tensions).unwrap();
                prop_assert!(found.rms_residual_a < 1e-9, "{}", found.rms_residual_a);
            }
        }
    }
}
