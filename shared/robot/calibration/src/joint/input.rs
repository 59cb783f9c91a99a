//! Input of the joint estimate.

use crate::survey::Range;
use cable_robot::CableVec;

/// Lower bound for the squared height that a measured height is compared with, m²: the square root has no
/// derivative at zero.
pub(super) const LEAST_SQUARED_HEIGHT_M2: f64 = 1e-6;

/// Constants of Huber and Cauchy for 95 % efficiency with normal errors, in standard deviations (Zhang, "Parameter
/// estimation techniques", 1997).
const HUBER: f64 = 1.345;
const CAUCHY: f64 = 2.3849;

/// Weighting of lengths that do not fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Loss {
    /// Squared: best if all errors are normal.
    #[default]
    Squared,
    /// Squared up to 1.345 standard deviations, linear beyond.
    Huber,
    /// Logarithmic beyond 2.385 standard deviations: gross outliers have almost no weight.
    Cauchy,
}

impl Loss {
    /// Computes rho(r) and the weight rho'(r) / r, with rho = r²/2 near zero. r in standard deviations.
    pub(crate) fn evaluate(self, r: f64) -> (f64, f64) {
        match self {
            Self::Squared => (0.5 * r * r, 1.0),
            Self::Huber if r.abs() <= HUBER => (0.5 * r * r, 1.0),
            Self::Huber => (HUBER * (r.abs() - 0.5 * HUBER), HUBER / r.abs()),
            Self::Cauchy => {
                let t = r / CAUCHY;
                (0.5 * CAUCHY * CAUCHY * libm::log1p(t * t), 1.0 / (1.0 + t * t))
            }
        }
    }
}

/// A height measured directly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DirectHeight {
    /// Index of the anchor, from 0.
    pub anchor: usize,
    /// Height above the plane of the points, m.
    pub m: f64,
    /// Standard deviation, m.
    pub sigma_m: f64,
    /// Whether the height was measured with the cable itself, released until it touches the floor: then it has the
    /// scale and the zero of that cable. Otherwise by laser or tape.
    pub by_line: bool,
}

/// Input of [`calibrate_joint`](super::calibrate_joint).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointInput<'a> {
    /// x and y of the anchors, m: fixed without ranges, otherwise an initial guess.
    pub anchors_xy_m: &'a [[f64; 2]],
    /// Lengths, one set per point, m.
    pub lengths_m: &'a [CableVec],
    /// Standard deviation of a length, m.
    pub sigma_length_m: f64,
    /// Ranges between plumb lines; if there are any, x and y are estimated too, with anchor 1 at the origin and
    /// anchor 2 on the x axis.
    pub ranges: &'a [Range],
    /// Heights measured directly.
    pub heights: &'a [DirectHeight],
    /// Standard deviation of the scale about 1; None for a scale of exactly 1.
    pub sigma_scale: Option<f64>,
    /// Standard deviation of the encoder zeros about 0, m; None for zeros of exactly 0.
    pub sigma_offset_m: Option<f64>,
    /// The loss of the lengths. Ranges, heights and priors have a squared loss.
    pub loss: Loss,
}

impl<'a> JointInput<'a> {
    /// Input of lengths only: x and y fixed, no scale, no zeros, squared loss.
    pub fn new(anchors_xy_m: &'a [[f64; 2]], lengths_m: &'a [CableVec], sigma_length_m: f64) -> Self {
        Self {
            anchors_xy_m,
            lengths_m,
            sigma_length_m,
            ranges: &[],
            heights: &[],
            sigma_scale: None,
            sigma_offset_m: None,
            loss: Loss::Squared,
        }
    }
}
