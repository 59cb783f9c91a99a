//! Figures 3 to 6 and Table II: heights of the anchors from lengths to points on the floor.

mod experiment;
mod simulated;

pub use experiment::{fig5, fig6, table2};
pub use simulated::{fig3, fig4};

use super::random::Random;
use super::stand_in;
use anyhow::Result;
use cable_robot::CableVec;
use calibration::heights::closed_form;
use calibration::{Side, survey_anchors};

/// Standard deviation of a range in the simulations, from the paper's text, m.
pub const SIGMA_RANGE_M: f64 = 0.02;
/// Standard deviation of the laser of the experiment, from the paper's text, m.
pub const SIGMA_LASER_M: f64 = 0.0015;
/// Share of the triangle of the anchors over which points are distributed.
const REACH: f64 = 0.9;

/// Scales a triangle about its centroid.
pub fn scaled(triangle: [[f64; 2]; 3], share: f64) -> [[f64; 2]; 3] {
    let middle = [0, 1].map(|k| (triangle[0][k] + triangle[1][k] + triangle[2][k]) / 3.0);
    triangle.map(|p| [0, 1].map(|k| middle[k] + share * (p[k] - middle[k])))
}

/// Returns random points under the robot, m.
pub fn random_points(random: &mut Random, count: usize) -> Vec<[f64; 2]> {
    let triangle = scaled(stand_in::three_cable_anchors_xy(), REACH);
    (0..count).map(|_| random.in_triangle(triangle)).collect()
}

/// Errors of the measured lengths.
#[derive(Debug, Clone, Copy)]
pub struct Encoders {
    /// Standard deviation, m.
    pub sigma_m: f64,
    /// Ratio of measured to true length.
    pub scale: f64,
    /// Measured value at length zero per cable, m.
    pub zero_m: [f64; 3],
}

impl Encoders {
    /// Creates encoders with noise only.
    pub fn noisy(sigma_m: f64) -> Self {
        Self { sigma_m, scale: 1.0, zero_m: [0.0; 3] }
    }

    /// Measures the lengths to points on the floor.
    pub fn measure(&self, random: &mut Random, points: &[[f64; 2]]) -> Vec<CableVec> {
        let anchors = stand_in::three_cable_anchors();
        points
            .iter()
            .map(|point| {
                CableVec::from_fn(3, |i| {
                    let [x, y, z] = anchors[i];
                    let (dx, dy) = (x - point[0], y - point[1]);
                    let length = (dx * dx + dy * dy + z * z).sqrt();
                    self.scale * length + self.zero_m[i] + self.sigma_m * random.normal()
                })
            })
            .collect()
    }
}

/// Computes x and y of the anchors from ranges with noise, (1)-(2).
pub fn survey(random: &mut Random, sigma_m: f64) -> Result<[[f64; 2]; 3]> {
    let ranges = stand_in::RANGES_M.map(|range| range + sigma_m * random.normal());
    Ok(survey_anchors(ranges, Side::Left)?)
}

/// The paper's calibration, (1)-(5). A squared height below zero, caused by noise, is replaced by zero; the second
/// result reports it.
pub fn calibrate(anchors_xy: &[[f64; 2]; 3], lengths: &[CableVec]) -> Result<([[f64; 3]; 3], bool)> {
    let found = closed_form(anchors_xy, lengths)?;
    let squared = [0, 1, 2].map(|i| found.squared_heights_m2[i]);
    let anchors = [0, 1, 2].map(|i| [anchors_xy[i][0], anchors_xy[i][1], squared[i].max(0.0).sqrt()]);
    Ok((anchors, squared.iter().any(|w| *w < 0.0)))
}

/// Returns the mean error over the anchors of the heights and of the positions, m.
pub fn errors(found: &[[f64; 3]; 3]) -> [f64; 2] {
    let truth = stand_in::three_cable_anchors();
    let mut sums = [0.0; 2];
    for (found, truth) in found.iter().zip(&truth) {
        let d = [0, 1, 2].map(|k| found[k] - truth[k]);
        sums[0] += d[2].abs() / 3.0;
        sums[1] += (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt() / 3.0;
    }
    sums
}
