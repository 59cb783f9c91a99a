//! Figures of a run that are compared with those of other runs of the same robot: they change as a robot wears.

use crate::accuracy::Distances;
use crate::tracker::Cycle;
use cable_robot::Robot;
use messages::{CABLES, MotorState};
use serde::Serialize;

/// Figures over the cycles in which the setpoint moves.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Wear {
    /// Highest estimated tension of a cable, N.
    pub peak_tension_n: Option<f64>,
    /// Mean estimated tension of all cables, N.
    pub mean_tension_n: Option<f64>,
    /// Root mean square of the motor currents, A.
    pub current_a: Option<f64>,
    /// Root mean square misfit of the lengths, m: grows as drums slip and cables creep.
    pub misfit_m: Option<f64>,
    /// Largest correction of a length where the operator set a known position again, m: how far the lengths had
    /// drifted.
    pub drift_m: Option<f64>,
    /// Stiffness of the cables in the run's robot file, N; `None`: rigid cables.
    pub stiffness_n: Option<f64>,
}

/// Sums for [`Wear`].
#[derive(Debug, Clone, Default)]
pub struct WearSum {
    current: Distances,
    misfit: Distances,
    tension_n: f64,
    tensions: u64,
    peak_tension_n: f64,
    drift_m: Option<f64>,
    last: Option<MotorState>,
}

impl WearSum {
    /// Adds a cycle.
    pub fn cycle(&mut self, cycle: &Cycle<'_>) {
        let count = usize::from(cycle.authority.cable_count).min(CABLES);
        if let Some(state) = cycle.state {
            if let Some(last) = self.last.filter(|last| last.header.life == state.header.life) {
                self.zeroed(&last, state, count);
            }
            self.last = Some(*state);
        }
        if !cycle.moving {
            return;
        }
        if let Some(state) = cycle.state {
            state.current_a[..count].iter().for_each(|current_a| self.current.add(*current_a));
        }
        if let Some(estimate) = cycle.estimate {
            self.misfit.add(estimate.residual_m);
            // A tension that is not finite would hide all others.
            for tension_n in estimate.tension_n[..count].iter().filter(|tension_n| tension_n.is_finite()) {
                self.tension_n += tension_n;
                self.tensions += 1;
                self.peak_tension_n = self.peak_tension_n.max(*tension_n);
            }
        }
    }

    /// Adds the correction of the lengths if the operator set a position that was known before.
    fn zeroed(&mut self, last: &MotorState, now: &MotorState, count: usize) {
        let known = last.position_known != MotorState::POSITION_UNKNOWN;
        let set = (0..count).any(|cable| now.zeroed_m[cable].to_bits() != last.zeroed_m[cable].to_bits());
        if known && set {
            let corrected_m = (0..count).map(|cable| (now.length_m[cable] - last.length_m[cable]).abs());
            let finite_m = corrected_m.filter(|corrected_m| corrected_m.is_finite());
            self.drift_m = finite_m.chain(self.drift_m).reduce(f64::max);
        }
    }

    /// Returns the figures.
    #[must_use]
    pub fn result(&self, robot: Option<&Robot>) -> Wear {
        let some = self.tensions > 0;
        Wear {
            peak_tension_n: some.then_some(self.peak_tension_n),
            mean_tension_n: some.then(|| self.tension_n / self.tensions as f64),
            current_a: self.current.result().map(|sum| sum.rms_m),
            misfit_m: self.misfit.result().map(|sum| sum.rms_m),
            drift_m: self.drift_m,
            stiffness_n: robot.and_then(Robot::stiffness_n),
        }
    }
}
