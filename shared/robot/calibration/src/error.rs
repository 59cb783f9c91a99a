//! Why a calibration is refused.
//! ```
//! use calibration::{Measurements, Method, calibrate};
//! let refusal = calibrate(&Measurements::new(3), Method::Survey).unwrap_err();
//! // A sentence for people, a word for programs.
//! assert!(refusal.to_string().len() > 20);
//! assert!(["invalid_argument", "rank_deficient"].contains(&refusal.kind()));
//! ```

use super::{TwoPlaces, Undetermined};
use thiserror::Error;

/// What a calibration cannot answer; every message names what was wrong, where, and what to do. Anchors, cables and
/// points are counted from 1.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum CalibrationError {
    /// A wrong count, a NaN, a negative length, a standard deviation that is none.
    #[error("{0}")]
    InvalidArgument(String),
    /// Ranges that form no triangle, or anchors (for the GPS method: points) that coincide or lie on one line.
    #[error("{0}")]
    DegenerateGeometry(String),
    /// Spheres that do not meet.
    #[error("{0}")]
    Unreachable(String),
    /// Two mirror solutions and nothing to choose by.
    #[error("{0}")]
    Ambiguous(TwoPlaces),
    /// The measurements do not determine the anchors.
    #[error("{0}")]
    RankDeficient(Undetermined),
    /// The best fit of the lengths puts an anchor at a negative squared height.
    #[error(
        "the lengths fit best with anchor {anchor} at a squared height of {squared_height_m2:.4} m², which no anchor has: \
         the lines are measured too short or an x, y is wrong; check the zero of line {anchor} and the ranges, or add points"
    )]
    NoRealHeight {
        /// The anchor, counted from 1.
        anchor: usize,
        /// The squared height, m².
        squared_height_m2: f64,
    },
}

impl CalibrationError {
    /// The kind as a short word for other programs: `invalid_argument`, `degenerate_geometry`, `unreachable`,
    /// `ambiguous`, `rank_deficient` or `no_real_height`.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::InvalidArgument(_) => "invalid_argument",
            Self::DegenerateGeometry(_) => "degenerate_geometry",
            Self::Unreachable(_) => "unreachable",
            Self::Ambiguous(_) => "ambiguous",
            Self::RankDeficient(_) => "rank_deficient",
            Self::NoRealHeight { .. } => "no_real_height",
        }
    }
}

pub(super) fn invalid<T>(sentence: impl Into<String>) -> Result<T, CalibrationError> {
    Err(CalibrationError::InvalidArgument(sentence.into()))
}

pub(super) fn degenerate<T>(sentence: impl Into<String>) -> Result<T, CalibrationError> {
    Err(CalibrationError::DegenerateGeometry(sentence.into()))
}

pub(super) fn undetermined<T>(why: Undetermined) -> Result<T, CalibrationError> {
    Err(CalibrationError::RankDeficient(why))
}

/// A standard deviation: finite and above zero.
pub(super) fn check_sigma(what: &str, sigma: f64) -> Result<(), CalibrationError> {
    if sigma.is_finite() && sigma > 0.0 {
        return Ok(());
    }
    invalid(format!("{what} is {sigma}; give a finite standard deviation above 0"))
}
