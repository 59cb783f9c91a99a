//! Calibration of the anchors from field measurements: section III of the paper, and methods that improve on it.
//!
//! Offline computations: unlike `cable-robot` this crate allocates. It does no input or output.
//!
//! * [`survey`]: x and y of the anchors from horizontal ranges between plumb lines, (1)-(2), for any number of anchors.
//! * [`heights`]: heights from lengths to points of the reference plane, (4)-(5), as a linear regression: the global
//!   minimum without a search.
//! * [`joint`]: maximum likelihood estimate of all unknowns together, with scale, encoder zeros and outliers.
//! * [`length_check`]: the scale of one cable from moves of a mark along a tape.
//! * [`gps`]: the baseline of the paper, anchors from points with known positions.
//! * [`undecided`]: whether the measurements determine a radius, a scale or a zero that was set free.
//! * [`mod@loads`]: stiffness, routed length and weight of the node from a known weight.
//! * [`flight`]: stiffness from the record of a flight, as far as it tells it.
//! * [`holdout`]: prediction of points that a calibration did not use.
//! * [`pattern`]: whether the residuals have a pattern that the model does not explain.
//! * [`unmeasured_radius`]: what wheels that were not measured would change.
//! * [`radius_check`]: whether a measured radius may be the diameter, or half the radius.
//! * [`touch_down`]: when a node that is lowered touches the floor, and the lengths there.
//! * [`placement`]: positions of the points, and the accuracy to expect before measuring.
//! * [`motor_fit`]: the motor current over speed and tension, from recorded runs.
//! * [`Measurements`] and [`calibrate`] combine them: from measurements to anchors with covariance, or an error.
//!
//! # Information in lengths
//! The positions of the points need not be known, but there must be at least three points, not on one line, **whatever
//! the number of cables**. If all points are on one line, they can be shifted sideways and the squared heights changed
//! with them (`w_i += 2 a_i.e - 2 c.e - e.e`) without changing any length; counting equations (four cables, two points)
//! does not reveal this. Points nearly on a line determine the heights only in theory: the predicted standard deviation
//! rejects such data.
//!
//! A residual is not an accuracy: a cable that stretches by 0.3 % leaves residuals of millimetres and height errors of
//! centimetres. Therefore every result includes the covariance of every anchor.
//!
//! # Gauge
//! Anchor 1 is at the origin and anchor 2 on the positive x axis; z = 0 is the plane of the points.
//!
//! # Example
//! ```
//! use calibration::{Measurements, Method, Range, calibrate};
//! use cable_robot::CableVec;
//!
//! // Exact measurements for anchors at (0, 0, 3.0), (10, 0, 3.2) and (5, 8, 2.9).
//! let anchors = [[0.0, 0.0, 3.0], [10.0, 0.0, 3.2], [5.0, 8.0, 2.9f64]];
//! let range = |i: usize, j: usize| {
//!     let (dx, dy) = (anchors[i][0] - anchors[j][0], anchors[i][1] - anchors[j][1]);
//!     Range { from: i, to: j, m: (dx * dx + dy * dy).sqrt(), sigma_m: 0.002 }
//! };
//! let lengths = |x: f64, y: f64| {
//!     CableVec::from_fn(3, |i| {
//!         let [ax, ay, az] = anchors[i];
//!         ((ax - x) * (ax - x) + (ay - y) * (ay - y) + az * az).sqrt()
//!     })
//! };
//! let points = [(1.0, 0.5), (9.0, 0.5), (5.0, 7.0), (5.0, 3.0)];
//! let measured = Measurements {
//!     ranges: vec![range(0, 1), range(0, 2), range(1, 2)],
//!     lengths_m: points.iter().map(|(x, y)| lengths(*x, *y)).collect(),
//!     ..Measurements::new(3)
//! };
//! let found = calibrate(&measured, Method::Survey)?;
//! for (found, true_) in found.anchors_m.iter().zip(anchors) {
//!     for k in 0..3 {
//!         assert!((found[k] - true_[k]).abs() < 1e-9);
//!     }
//! }
//! assert!(found.covariance.std_m()[2][2] < 0.02);
//!
//! // Two points are not sufficient for any number of cables.
//! let too_few = Measurements { lengths_m: measured.lengths_m[..2].to_vec(), ..measured };
//! let refusal = calibrate(&too_few, Method::Survey).unwrap_err();
//! assert_eq!(refusal.kind(), "rank_deficient");
//! # Ok::<(), calibration::CalibrationError>(())
//! ```

#![forbid(unsafe_code)]
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "`!(a <= b)` also rejects NaN, which `a > b` would accept")]
#![allow(clippy::needless_range_loop, reason = "matrix kernels read like their formulas, with indices")]

/// A sentence about measurements with a weight, as `format!`. The page translates what stands in this macro, as it does
/// for those of the guided calibration.
macro_rules! say {
    ($($sentence:tt)*) => {
        ::std::fmt::format(::std::format_args!($($sentence)*))
    };
}

mod covariance;
mod determination;
mod error;
mod estimate;
mod fisher;
pub mod flight;
pub mod gps;
pub mod heights;
pub mod holdout;
pub mod joint;
pub mod length_check;
pub mod loads;
mod measurements;
mod model;
pub mod motor_fit;
pub mod pattern;
pub mod placement;
mod refine;
mod slip;
mod straight;
pub mod survey;
pub mod touch_down;
mod undetermined;
mod unmeasured;
mod up_and_down;
mod wheels;

pub use covariance::{AnchorCovariance, LengthCovariance};
pub use determination::{Freed, Undecided, undecided};
pub use error::CalibrationError;
pub use estimate::calibrate;
pub use gps::gps_anchor;
pub use heights::{calibrate_heights, points_from_rows};
pub use holdout::{Holdout, hold_out};
pub use joint::{DirectHeight, Joint, JointInput, Loss, calibrate_joint};
pub use loads::{FORCE_CONSTANT, Found, LoadMeasurements, Loads, Sinking, Weighing, loads};
pub use measurements::{
    Calibration, DEFAULT_REFUSE_ABOVE_STD_M, DEFAULT_SIGMA_GPS_M, DEFAULT_SIGMA_LENGTH_M, Measurements, Method, Outlier,
};
pub use pattern::{Effect, Misfit, misfit};
pub use slip::{RadiusCheck, RadiusSlip, radius_check};
pub use survey::{Range, Side, Survey, fourth_anchor, survey_anchors, survey_network};
pub use touch_down::{Paying, TouchDown};
pub use undetermined::{Ambiguity, Undetermined};
pub use unmeasured::{LARGEST_RADIUS_M, UnmeasuredRadius, unmeasured_radius};
pub use up_and_down::{Moving, UpAndDown};
pub use wheels::{calibrate_heights_with_pulleys, calibrate_joint_with_pulleys};
