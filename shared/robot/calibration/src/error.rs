//! Errors of a calibration.
//! ```
//! use calibration::{Measurements, Method, calibrate};
//! let refusal = calibrate(&Measurements::new(3), Method::Survey).unwrap_err();
//! // A sentence for users, a kind for programs.
//! assert!(refusal.to_string().len() > 20);
//! assert!(["invalid_argument", "rank_deficient"].contains(&refusal.kind()));
//! ```

use super::{Ambiguity, Undetermined};
use thiserror::Error;

/// Why a calibration has no result. Every message states what is wrong, where, and what to do; it counts anchors,
/// cables and points from 1.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum CalibrationError {
    /// A wrong count, a value that is not finite, a negative length, or an invalid standard deviation.
    #[error("{0}")]
    InvalidArgument(String),
    /// Ranges that do not form a triangle, or anchors (for the GPS method: points) that coincide or lie on one line.
    #[error("{0}")]
    DegenerateGeometry(String),
    /// Spheres that do not intersect.
    #[error("{0}")]
    Unreachable(String),
    /// Two mirror solutions without a criterion to select one.
    #[error("{0}")]
    Ambiguous(Ambiguity),
    /// The measurements do not determine the anchors.
    #[error("{0}")]
    RankDeficient(Undetermined),
    /// The best fit of the lengths gives an anchor a negative squared height.
    #[error(
        "the lengths fit best with anchor {anchor} at a squared height of {squared_height_m2:.4} m², which no anchor has: \
         the lengths are measured too short or x or y is wrong; check the zero of cable {anchor} and the ranges, or add points"
    )]
    NoRealHeight {
        /// Number of the anchor, from 1.
        anchor: usize,
        /// Squared height, m².
        squared_height_m2: f64,
    },
}

impl CalibrationError {
    /// Error kind for programs: `invalid_argument`, `degenerate_geometry`, `unreachable`, `ambiguous`, `rank_deficient`
    /// or `no_real_height`.
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

/// Checks that a standard deviation is finite and above zero.
pub(super) fn check_sigma(what: &str, sigma: f64) -> Result<(), CalibrationError> {
    if sigma.is_finite() && sigma > 0.0 {
        return Ok(());
    }
    invalid(format!("{what} is {sigma}; give a finite standard deviation above 0"))
}
