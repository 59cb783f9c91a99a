//! Computes the anchors from measurements that a field team can make: section III of the paper, and improvements on it.
//!
//! Offline work: unlike `cable-robot` this crate allocates. It does no I/O.
//!
//! * [`survey`]: x and y of the anchors from horizontal ranges between plumb lines, (1)-(2), for any number of anchors.
//! * [`heights`]: heights from lengths to points of the reference plane, (4)-(5), as a linear regression: the global
//!   minimum without a search.
//! * [`joint`]: everything at once by maximum likelihood, with scale, encoder zeros and outliers.
//! * [`gps`]: the baseline of the paper, anchors from points whose positions are known.
//! * [`holdout`]: how well points that were left out are predicted.
//! * [`placement`]: where to put the points, and the expected uncertainty, before anything is measured.
//! * [`motor_fit`]: motor current over speed and tension, from recorded runs.
//! * [`Measurements`] and [`calibrate`] combine these: measurements in, anchors with covariance or a refusal out.
//!
//! # What lengths determine
//! The positions of the points need not be measured, but there have to be three points that are not collinear,
//! **whatever the number of cables**. Collinear points can all be shifted sideways and the squared heights changed with
//! them (`w_i += 2 a_i.e - 2 c.e - e.e`) without changing any length; counting equations (four cables, two points) does
//! not reveal this. Nearly collinear points determine the heights in theory only: such data are rejected by the
//! standard deviation they predict.
//!
//! A residual is not an accuracy: a cable that stretches by 0.3 % leaves residuals of millimetres and heights wrong by
//! centimetres. Every answer therefore carries the covariance of every anchor.
//!
//! # Gauge
//! Anchor 1 stands at the origin and anchor 2 on the positive x axis; z = 0 is the plane of the points.
//!
//! # Example
//! ```
//! use calibration::{Measurements, Method, Range, calibrate};
//! use cable_robot::CableVec;
//!
//! // What would be measured with anchors at (0, 0, 3.0), (10, 0, 3.2) and (5, 8, 2.9).
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
//! // Two points determine nothing, with any number of cables.
//! let too_few = Measurements { lengths_m: measured.lengths_m[..2].to_vec(), ..measured };
//! let refusal = calibrate(&too_few, Method::Survey).unwrap_err();
//! assert_eq!(refusal.kind(), "rank_deficient");
//! # Ok::<(), calibration::CalibrationError>(())
//! ```

#![forbid(unsafe_code)]
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "`!(a <= b)` also refuses NaN, which `a > b` would let pass")]
#![allow(clippy::needless_range_loop, reason = "matrix kernels read like their formulas, with indices")]

mod covariance;
mod error;
pub mod gps;
pub mod heights;
pub mod holdout;
pub mod joint;
mod measurements;
pub mod motor_fit;
pub mod placement;
pub mod survey;
mod undetermined;

pub use covariance::AnchorCovariance;
pub use error::CalibrationError;
pub use gps::gps_anchor;
pub use heights::{calibrate_heights, points_from_rows};
pub use holdout::{Holdout, hold_out};
pub use joint::{DirectHeight, Joint, JointInput, Loss, calibrate_joint};
pub use measurements::{
    Calibration, DEFAULT_REFUSE_ABOVE_STD_M, DEFAULT_SIGMA_GPS_M, DEFAULT_SIGMA_LENGTH_M, Measurements, Method,
    Outlier, calibrate,
};
pub use survey::{Range, Side, Survey, fourth_anchor, survey_anchors, survey_network};
pub use undetermined::{TwoPlaces, Undetermined};
