//! Checks of the scale of single cables along a tape.

use calibration::length_check::{self, CableScale, TapeCheck};
use serde::{Deserialize, Serialize};

/// Default standard deviation of a move along a tape, m: two readings of a mark, each good to 2 mm.
const SIGMA_TAPE_M: f64 = 0.0025;

/// A mark on a cable that moved along a tape.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct TapeEntry {
    /// Number of the cable.
    pub cable: usize,
    /// Length by the robot, with `counts_per_m`, m.
    pub counted_m: f64,
    /// Length by the tape, m; without it the cable was not checked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub m: Option<f64>,
    /// Standard deviation of `m`, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma_m: Option<f64>,
    /// Number of points in the file at the time of the answer, in `nims setup`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub after: Option<usize>,
}

/// The scale of each cable that was checked; None for the others. `counts_per_m`: with which the robot counted.
///
/// # Errors
/// One clause without the file name: which entry cannot be used, and what to do.
pub fn scales(
    tape: &[TapeEntry],
    counts_per_m: Option<&[f64]>,
    cables: usize,
) -> Result<Vec<Option<CableScale>>, String> {
    if let Some(entry) = tape.iter().find(|entry| !(1..=cables).contains(&entry.cable)) {
        return Err(say!("a [[tape]] names cable {}; there are {cables} cables", entry.cable));
    }
    let measured = |cable: usize| tape.iter().filter(move |entry| entry.cable == cable && entry.m.is_some());
    let scale = |cable: usize| -> Result<Option<CableScale>, String> {
        if measured(cable).next().is_none() {
            return Ok(None);
        }
        let Some(counts_per_m) = counts_per_m.and_then(|counts| counts.get(cable - 1)) else {
            return Err(say!(
                "the [[tape]] of cable {cable} needs counts_per_m, with which the robot computed its lengths"
            ));
        };
        let moves: Vec<TapeCheck> = measured(cable)
            .map(|entry| TapeCheck {
                counts_before: 0,
                // Beyond the range of counts, the comparison with the tape refuses it.
                counts_after: (entry.counted_m * counts_per_m).round() as i64,
                tape_m: entry.m.unwrap_or(f64::NAN),
                tape_sigma_m: entry.sigma_m.unwrap_or(SIGMA_TAPE_M),
            })
            .collect();
        length_check::scale(&moves, *counts_per_m).map(Some).map_err(|why| say!("[[tape]] of cable {cable}: {why}"))
    };
    (1..=cables).map(scale).collect()
}

/// The scales as in a calibration file, 1 for a cable without a check; None if no cable was checked.
pub fn factors(scales: &[Option<CableScale>]) -> Option<Vec<f64>> {
    scales.iter().any(Option::is_some).then(|| scales.iter().map(|found| found.map_or(1.0, |s| s.scale)).collect())
}

/// The scales as text lines.
pub fn words(scales: &[Option<CableScale>]) -> String {
    let mut text = String::new();
    for (i, found) in scales.iter().enumerate() {
        if let Some(CableScale { scale, std, counts_per_m }) = found {
            text += &say!(
                "cable {}: counts {scale:.4} ±{std:.4} times the tape, {counts_per_m:.1} counts per metre",
                i + 1
            );
            text.push('\n');
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    const COUNTS: [f64; 3] = [43_460.0, -43_460.0, 43_460.0];

    fn entries(tapes: &[(usize, f64, Option<f64>)]) -> Vec<TapeEntry> {
        let entry = |(cable, counted_m, m): &(usize, f64, Option<f64>)| TapeEntry {
            cable: *cable,
            counted_m: *counted_m,
            m: *m,
            sigma_m: None,
            after: None,
        };
        tapes.iter().map(entry).collect()
    }

    #[test]
    fn a_tape_gives_the_scale_of_its_cable() {
        let tapes = entries(&[(1, 5.0, Some(4.95)), (2, 5.0, Some(5.02)), (3, 5.0, None)]);
        let found = scales(&tapes, Some(&COUNTS), 3).unwrap();
        for (factor, expected) in factors(&found).unwrap().iter().zip([5.0 / 4.95, 5.0 / 5.02, 1.0]) {
            assert!((factor - expected).abs() < 1e-5, "{factor} {expected}");
        }
        assert!((found[0].unwrap().std - 0.0005).abs() < 2e-5);
        assert_eq!(words(&found).lines().count(), 2);
        assert_eq!(factors(&scales(&tapes[2..], Some(&COUNTS), 3).unwrap()), None);
    }

    #[test]
    fn unusable_tapes_are_refused_by_cable() {
        let refused = |tapes: &[(usize, f64, Option<f64>)]| scales(&entries(tapes), Some(&COUNTS), 3).unwrap_err();
        assert!(refused(&[(4, 5.0, Some(5.0))]).contains("cable 4"));
        assert!(refused(&[(2, 5.0, Some(3.0))]).contains("cable 2"));
        assert!(refused(&[(2, 5.0, Some(0.5))]).contains("cable 2"));
        assert!(refused(&[(1, 5.0, Some(5.0)), (1, 5.0, Some(4.9))]).contains("cable 1"));
        assert!(scales(&entries(&[(1, 5.0, Some(5.0))]), None, 3).unwrap_err().contains("counts_per_m"));
    }
}
