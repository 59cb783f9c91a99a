//! The scale of one cable from a length that a tape measures: the check over some metres in which a mark on the cable
//! moves along a tape while the encoder counts.
//!
//! The counts of a bare wheel follow from π (D + d) with the diameter D of its groove and d of the cable; d is known
//! to a few tenths of a millimetre, on a wheel of 30 mm about 1 %. A tape over five metres is good to 2.5 mm, 0.05 %.
//! The tape lies along the cable as the idler counts it, under the tension of the check.

use thiserror::Error;

/// Shortest tape that is accepted, m: over less than a metre a reading error of 2 mm is more than 0.2 %.
pub const SHORTEST_M: f64 = 1.0;

/// Largest difference of a scale from 1 that is believed: beyond it, the counts per metre belong to another wheel.
pub const LARGEST_SHARE: f64 = 0.1;

/// Smallest difference between two results that is called a contradiction, as a multiple of its standard deviation.
const CONTRADICTION: f64 = 4.0;

/// One move of a mark along a tape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TapeCheck {
    /// Encoder count before the move.
    pub counts_before: i64,
    /// Encoder count after it.
    pub counts_after: i64,
    /// Distance that the mark moved on the tape, m; positive in either direction.
    pub tape_m: f64,
    /// Standard deviation of that distance, m: of both readings together.
    pub tape_sigma_m: f64,
}

/// Scale of a cable: measured length divided by true length, as in a calibration file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CableScale {
    /// Length by the encoder divided by length by the tape.
    pub scale: f64,
    /// Standard deviation of `scale`: from the tape, or from the scatter of the moves if that is larger.
    pub std: f64,
    /// Counts of one true metre, with the sign of the configured ones.
    pub counts_per_m: f64,
}

/// Why a check gives no scale. Moves count from 1.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum LengthCheckError {
    /// No move was made.
    #[error("no move was measured; move the mark along the tape at least once")]
    NoMove,
    /// The configured counts are zero or not finite.
    #[error(
        "counts_per_m is {counts_per_m}; give the counts of one turn divided by pi (D + d), with the diameters of wheel and cable in metres"
    )]
    CountsPerM {
        /// The value given.
        counts_per_m: f64,
    },
    /// A tape that is too short, or a value that is no length.
    #[error(
        "move {number} is {tape_m} m ±{tape_sigma_m} m; move the mark by {SHORTEST_M} m or more, five metres are good"
    )]
    Tape {
        /// Number of the move.
        number: usize,
        /// Distance on the tape, m.
        tape_m: f64,
        /// Its standard deviation, m.
        tape_sigma_m: f64,
    },
    /// The counts do not fit the tape at all.
    #[error(
        "move {number} counted {counted_m:.3} m for {tape_m} m on the tape; check counts_per_m, its wheel and the encoder"
    )]
    Unlike {
        /// Number of the move.
        number: usize,
        /// Length by the encoder, m.
        counted_m: f64,
        /// Distance on the tape, m.
        tape_m: f64,
    },
    /// Moves contradict each other; the one farthest from all together.
    #[error(
        "move {number} gives a scale of {scale:.5}, and all together {mean:.5} ±{std:.5}; the cable slips over the idler or \
         a reading is wrong: repeat the moves"
    )]
    Contradiction {
        /// Number of the move.
        number: usize,
        /// Its scale.
        scale: f64,
        /// Scale of all moves.
        mean: f64,
        /// Standard deviation of the difference.
        std: f64,
    },
}

/// Computes the scale of a cable from moves along a tape, with the counts per metre with which its lengths are
/// computed.
///
/// ```
/// use calibration::length_check::{TapeCheck, scale};
/// // 217 517 counts for five metres, where 43 460 per metre were configured: 0.1 % more than the tape says.
/// let out = TapeCheck { counts_before: 0, counts_after: 217_517, tape_m: 5.0, tape_sigma_m: 0.0025 };
/// let found = scale(&[out], 43_460.0)?;
/// assert!((found.scale - 1.001).abs() < 1e-5 && (found.counts_per_m - 43_503.4).abs() < 0.1);
/// assert!((found.std - 0.0005).abs() < 1e-5);
/// # Ok::<(), calibration::length_check::LengthCheckError>(())
/// ```
///
/// # Errors
/// See [`LengthCheckError`].
pub fn scale(moves: &[TapeCheck], counts_per_m: f64) -> Result<CableScale, LengthCheckError> {
    if !(counts_per_m.is_finite() && counts_per_m != 0.0) {
        return Err(LengthCheckError::CountsPerM { counts_per_m });
    }
    let (mut weights, mut weighted) = (0.0, 0.0);
    for (i, one) in moves.iter().enumerate() {
        let (scale, std) = scale_of(i + 1, one, counts_per_m)?;
        weights += 1.0 / (std * std);
        weighted += scale / (std * std);
    }
    if moves.is_empty() {
        return Err(LengthCheckError::NoMove);
    }
    let mean = weighted / weights;
    // A move that slipped also moves the mean away from the others, so only the farthest one is named.
    let (mut chi_square, mut farthest, mut contradiction) = (0.0, CONTRADICTION, None);
    for (i, one) in moves.iter().enumerate() {
        let (scale, std) = scale_of(i + 1, one, counts_per_m)?;
        let off = (scale - mean) / std;
        if off.abs() > farthest {
            farthest = off.abs();
            contradiction = Some(LengthCheckError::Contradiction { number: i + 1, scale, mean, std });
        }
        chi_square += off * off;
    }
    if let Some(contradiction) = contradiction {
        return Err(contradiction);
    }
    // Birge's ratio: the scatter of the moves takes the place of a tape that claims to be better.
    let ratio = if moves.len() > 1 { (chi_square / (moves.len() - 1) as f64).max(1.0) } else { 1.0 };
    Ok(CableScale { scale: mean, std: (ratio / weights).sqrt(), counts_per_m: counts_per_m * mean })
}

/// The scale by one move and its standard deviation.
fn scale_of(number: usize, one: &TapeCheck, counts_per_m: f64) -> Result<(f64, f64), LengthCheckError> {
    let TapeCheck { counts_before, counts_after, tape_m, tape_sigma_m } = *one;
    if !(tape_m.is_finite() && tape_m >= SHORTEST_M && tape_sigma_m > 0.0 && tape_sigma_m < tape_m) {
        return Err(LengthCheckError::Tape { number, tape_m, tape_sigma_m });
    }
    let counted_m = counts_after.abs_diff(counts_before) as f64 / counts_per_m.abs();
    let scale = counted_m / tape_m;
    if !((scale - 1.0).abs() <= LARGEST_SHARE) {
        return Err(LengthCheckError::Unlike { number, counted_m, tape_m });
    }
    // Counts are whole numbers: a step even over its width has the variance 1/12 at both ends.
    let count_m = 1.0 / (6.0f64.sqrt() * counts_per_m.abs());
    Ok((scale, (scale * scale * tape_sigma_m * tape_sigma_m + count_m * count_m).sqrt() / tape_m))
}
