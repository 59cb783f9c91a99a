//! Whether the measurements determine what was set free: a radius, a scale, a zero.
//!
//! An unknown with a standard deviation stated beforehand always has an estimate. Where the measurements say less about
//! it than that statement, the estimate repeats the statement, and an error of the model elsewhere moves it unseen.

use super::joint::Loss;
use super::measurements::{Calibration, Measurements, Method};
use super::model::{Layout, Model, State};

/// An unknown is determined if its standard deviation is below this share of the stated one: the measurements alone
/// then say as much as the statement.
const DETERMINED: f64 = core::f64::consts::FRAC_1_SQRT_2;

/// Least uncertainty of an anchor by an undetermined unknown that is refused, m: the limit of a good calibration.
const HARMFUL_M: f64 = 0.02;

/// An unknown that was set free.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Freed {
    /// The common deviation of the radii.
    PulleyRadius,
    /// The common scale.
    Scale,
    /// The zero of a cable, from 0.
    Zero(usize),
}

/// An unknown that the measurements do not determine, and that makes an anchor uncertain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Undecided {
    /// The unknown.
    pub unknown: Freed,
    /// Standard deviation with the measurements (m; of the scale: a share), and the one that was stated.
    pub std: f64,
    /// Stated standard deviation.
    pub stated: f64,
    /// The coordinate that it makes most uncertain: anchor from 0.
    pub anchor: usize,
    /// Axis of that coordinate: 0 x, 1 y, 2 z.
    pub axis: usize,
    /// Standard deviation of that coordinate by this unknown, m.
    pub shift_m: f64,
}

/// Finds the unknown of a joint calibration that the measurements do not determine and that does most harm.
#[must_use]
pub fn undecided(measured: &Measurements, found: &Calibration) -> Option<Undecided> {
    if found.method != Method::Joint {
        return None;
    }
    let layout = Layout::new(measured, Method::Joint);
    let model = Model { measured, layout, loss: Loss::Squared };
    let covariance = model.reduce(&State::from_calibration(found), 0, |_, _, _| Vec::new())?.solve()?.covariance;
    let mut freed = vec![
        (Freed::PulleyRadius, layout.radius(), measured.sigma_pulley_radius_m),
        (Freed::Scale, layout.scale(), measured.sigma_scale),
    ];
    freed.extend((0..layout.n).map(|i| (Freed::Zero(i), layout.offset(i), measured.sigma_offset_m)));
    let mut worst: Option<Undecided> = None;
    for (unknown, at, stated) in freed {
        let (Some(p), Some(stated)) = (at, stated) else { continue };
        let std = covariance[(p, p)].max(0.0).sqrt();
        if std <= DETERMINED * stated {
            continue;
        }
        for anchor in 0..layout.n {
            for axis in 0..3 {
                let Some(q) = layout.anchor(anchor, axis) else { continue };
                let shift_m = covariance[(p, q)].abs() / std;
                if shift_m > HARMFUL_M && worst.as_ref().is_none_or(|worst| shift_m > worst.shift_m) {
                    worst = Some(Undecided { unknown, std, stated, anchor, axis, shift_m });
                }
            }
        }
    }
    worst
}
