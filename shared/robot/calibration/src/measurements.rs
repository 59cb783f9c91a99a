//! Measurements of a site, and the calibration that results from them. Lengths and ranges in m with standard deviations
//! in m; anchors, cables and points count from 0.

use super::covariance::{AnchorCovariance, LengthCovariance};
use super::joint::{DirectHeight, Loss};
use super::survey::{Range, Side};
use cable_robot::CableVec;

/// Default limit of the standard deviation of every coordinate, m: beyond it the motion of the node would
/// not be predictable.
pub const DEFAULT_REFUSE_ABOVE_STD_M: f64 = 0.5;

/// Default standard deviation of a length, m: encoder, winding of the cable on its drum, and an uneven floor.
pub const DEFAULT_SIGMA_LENGTH_M: f64 = 0.01;

/// Default standard deviation of a GPS position, m: real-time kinematic GPS.
pub const DEFAULT_SIGMA_GPS_M: f64 = 0.02;

/// Calibration method.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// The method of the paper: x and y from ranges, heights from the closed form of (4)-(5).
    #[default]
    Survey,
    /// Maximum likelihood estimate of all unknowns together, with scale, encoder zeros and outliers.
    Joint,
    /// The baseline of the paper: every anchor from points with known positions.
    Gps,
}

/// Measurements for a calibration. Anchors count from 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Measurements {
    /// Number of cables.
    pub cable_count: usize,
    /// Known radius of the swivelling pulley at each anchor, m; 0 for an eye, empty if all are eyes. The lengths then
    /// include the part of the cable on the wheel.
    pub pulley_radius_m: Vec<f64>,
    /// For [`Method::Joint`]: standard deviation of a common deviation of all radii from `pulley_radius_m`, m; None for
    /// radii that are exact. Only with pulleys.
    pub sigma_pulley_radius_m: Option<f64>,
    /// Standard deviation of the scale of each cable about the common one: its wheel, and slip. None for no difference.
    pub sigma_cable_scale: Option<f64>,
    /// Standard deviation, per axis, of the point where each cable is tied from the point of the node that is held on
    /// the plane, m. None for cables that meet there exactly.
    pub sigma_attachment_m: Option<f64>,
    /// The part of `sigma_length_m` that is the height of the floor at a point, m: vertical, and the same for all
    /// cables of the point. None for a plane. It changes the joint estimate and the test of residuals.
    pub sigma_floor_m: Option<f64>,
    /// Ranges between plumb lines.
    pub ranges: Vec<Range>,
    /// Side of each anchor, for an anchor with only two ranges; may be shorter.
    pub sides: Vec<Option<Side>>,
    /// Lengths, one set per point of the reference plane, m.
    pub lengths_m: Vec<CableVec>,
    /// Positions of the points, m; empty if unknown. One per point for [`Method::Gps`].
    pub gps_m: Vec<[f64; 3]>,
    /// Heights measured directly.
    pub heights: Vec<DirectHeight>,
    /// Standard deviation of a length, m.
    pub sigma_length_m: f64,
    /// Standard deviation of each coordinate of a known position, m; may be 0.
    pub sigma_gps_m: f64,
    /// For [`Method::Joint`]: standard deviation of the scale about 1; None for a scale of exactly 1.
    pub sigma_scale: Option<f64>,
    /// For [`Method::Joint`]: standard deviation of the encoder zeros, m; None for zeros of exactly 0.
    pub sigma_offset_m: Option<f64>,
    /// For [`Method::Joint`]: weighting of lengths that do not fit.
    pub loss: Loss,
    /// A result with a less certain coordinate is rejected, m.
    pub refuse_above_std_m: f64,
}

impl Measurements {
    /// Empty measurements with the documented defaults.
    pub fn new(cable_count: usize) -> Self {
        Self {
            cable_count,
            pulley_radius_m: Vec::new(),
            sigma_pulley_radius_m: None,
            sigma_cable_scale: None,
            sigma_attachment_m: None,
            sigma_floor_m: None,
            ranges: Vec::new(),
            sides: Vec::new(),
            lengths_m: Vec::new(),
            gps_m: Vec::new(),
            heights: Vec::new(),
            sigma_length_m: DEFAULT_SIGMA_LENGTH_M,
            sigma_gps_m: DEFAULT_SIGMA_GPS_M,
            sigma_scale: None,
            sigma_offset_m: None,
            loss: Loss::Squared,
            refuse_above_std_m: DEFAULT_REFUSE_ABOVE_STD_M,
        }
    }
}

/// A length that does not fit the calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outlier {
    /// Index of the cable, from 0.
    pub cable: usize,
    /// Index of the point, from 0.
    pub point: usize,
    /// Measured minus modelled length, m.
    pub residual_m: f64,
}

/// A calibrated robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Method of the calibration.
    pub method: Method,
    /// Anchors, m; z is the height above the plane of the points.
    pub anchors_m: Vec<[f64; 3]>,
    /// Covariance of the anchors, widened by `widened_by`.
    pub covariance: AnchorCovariance,
    /// Covariance of what the lengths depend on, widened alike. None unless the joint method knows how exact the scales
    /// of the cables and the points are where they are tied.
    pub lengths: Option<LengthCovariance>,
    /// Positions of the points, m.
    pub points_m: Vec<[f64; 3]>,
    /// Measured minus modelled length, one set per point, m.
    pub residuals_m: Vec<CableVec>,
    /// Measured divided by true length; 1 if it was not estimated.
    pub scale: f64,
    /// Standard deviation of the scale.
    pub scale_std: f64,
    /// Measured length at true length zero, by cable, m; 0 if not estimated.
    pub offsets_m: CableVec,
    /// Standard deviations of the offsets, m.
    pub offset_std_m: CableVec,
    /// Radius of the pulley at each anchor, m: as measured, or with the estimated deviation; empty if all are eyes.
    pub pulley_radius_m: Vec<f64>,
    /// Standard deviation of the common deviation of the radii, m; 0 if it was not estimated.
    pub pulley_radius_std_m: f64,
    /// Scatter of the measurements divided by their stated standard deviation; about 1 if that is correct. None without
    /// redundant measurements.
    pub noise_ratio: Option<f64>,
    /// 1, or `noise_ratio` if it is larger than chance explains: the stated standard deviations were too small.
    pub widened_by: f64,
    /// Lengths that do not fit.
    pub outliers: Vec<Outlier>,
}

impl Calibration {
    /// Root mean square of all residuals, m; 0 without points. This is not the accuracy: see the covariance.
    pub fn rms_residual_m(&self) -> f64 {
        let (sum, count) =
            self.residuals_m.iter().flat_map(|r| r.iter()).fold((0.0, 0usize), |(s, n), r| (s + r * r, n + 1));
        if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
    }
}
