//! Anchors, motors and moves whose energy is computed.

use crate::stand_in;
use anyhow::{Context, Result};
use cable_robot::energy::{Best, Bounds, Cost, WinchEnergy};
use cable_robot::motor::Motor;
use cable_robot::{Anchors, Distribution, Vector3};

/// Intervals of Simpson's rule, with an error of 3e-6.
const INTERVALS: usize = 64;

/// Minimum height of flown parabolas above the ground, m.
pub(super) const CLEARANCE_M: f64 = 0.1;

/// Returns the moves from each corner to the next.
pub(super) fn moves<const N: usize>(corners: &[[f64; 3]; N]) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    (0..N).map(|k| (Vector3::from(corners[k]), Vector3::from(corners[(k + 1) % N]))).collect()
}

/// Anchors and motor for the energy of moves.
pub(super) struct WinchSetup {
    anchors: Anchors,
    motor: Motor,
}

impl WinchSetup {
    pub(super) fn new(anchors: &[[f64; 3]], motor: Motor) -> Result<Self> {
        Ok(Self { anchors: Anchors::new(anchors)?, motor })
    }

    fn winch_energy(&self, method: Distribution) -> WinchEnergy<'_> {
        WinchEnergy {
            anchors: &self.anchors,
            wrench_n: stand_in::weight(),
            drag_n_s2_m2: 0.0,
            cable_weight_n_m: 0.0,
            limits_n: stand_in::LIMITS_N,
            method,
            current: &self.motor,
        }
    }

    /// Returns the costs of the straight line and of the optimal parabola.
    pub(super) fn line_and_best(
        &self,
        method: Distribution,
        ends: (Vector3<f64>, Vector3<f64>),
    ) -> Result<(Cost, Best)> {
        self.line_and_best_above(0.0, method, ends)
    }

    /// The same with the ground at this height, m.
    pub(super) fn line_and_best_above(
        &self,
        ground_m: f64,
        method: Distribution,
        ends: (Vector3<f64>, Vector3<f64>),
    ) -> Result<(Cost, Best)> {
        let bounds = Bounds { ground_m: Some(ground_m), time_weight_w: 0.0 };
        let winch_energy = self.winch_energy(method);
        let best = winch_energy.best_parabola(&ends.0, &ends.1, stand_in::SPEED_M_S, INTERVALS, &bounds)?;
        Ok((best.line.context("the straight line cannot be flown")?, best))
    }
}
