//! What a law is asked in a cycle, and the place for a law of one's own.

use cable_control::law::PFeedforward;
use cable_robot::elastic::Realisation;
use cable_robot::{CableVec, Jacobian, Robot, Setpoint};
use messages::NodeEstimate;

/// A law of one's own: asked in every cycle, once for each estimate that is alive.
///
/// Around it everything stays as it is: motions, the plan clock, slots, epochs, limits (the whole vector is scaled), and
/// that a law that gives nothing or something that is not finite has no say in that cycle. It runs in the control cycle: no
/// waiting, no input or output, and no allocation.
pub trait CableLaw: Send {
    /// Cable velocities dL/dt, m/s, one per cable; `None`: no answer to this estimate.
    ///
    /// What a law remembers from cycle to cycle it remembers per [`LawInput::slot`]: with two estimators alive it is asked twice in a
    /// cycle.
    fn velocity(&mut self, asked: &LawInput<'_>) -> Option<CableVec>;

    /// Its parameters as TOML, `key = value` in each line: what flew is in the run, also of a law that nims does not know.
    fn parameters(&self) -> String {
        String::new()
    }
}

/// One cycle, one estimate.
#[derive(Debug, Clone, Copy)]
pub struct LawInput<'a> {
    /// The estimate's slot, 0 or 1.
    pub slot: usize,
    /// The robot.
    pub robot: &'a Robot,
    /// One control cycle, s.
    pub period_s: f64,
    /// From `now` to `ahead`, s.
    pub horizon_s: f64,
    /// Where the node is, how long the lines are, how they pull.
    pub estimate: &'a NodeEstimate,
    /// Where the node should be at the instant of the estimate.
    pub now: &'a Setpoint,
    /// Where it should be at the end of the horizon.
    pub ahead: &'a Setpoint,
    /// Unstretched lengths and tensions that belong to `now`; `None` where the lines cannot hold the node.
    pub now_held: Option<&'a Realisation>,
    /// Those that belong to `ahead`.
    pub ahead_held: Option<&'a Realisation>,
}

impl LawInput<'_> {
    /// Unstretched lengths as they should be now, m.
    pub fn desired_lengths_m(&self) -> Option<CableVec> {
        self.now_held.map(|held| held.unstretched_m)
    }

    /// Unstretched lengths as they are, m.
    pub fn lengths_m(&self) -> CableVec {
        CableVec::from_array8(&self.estimate.predicted_m, self.robot.cable_count())
    }

    /// How fast the unstretched lengths should change now, m/s: (14) at the setpoint, and what stretch does over the horizon. (Tensions
    /// jump where the acceleration does, so their part is not taken at an instant.)
    pub fn desired_velocities_m_s(&self) -> Option<CableVec> {
        let (now, ahead) = (self.now_held?, self.ahead_held?);
        let straight = Jacobian::at(self.robot.anchors(), &self.now.position).ok()?.cable_velocity(&self.now.velocity);
        let stretch = |held: &Realisation, i: usize| held.lengths_m[i] - held.unstretched_m[i];
        Some(CableVec::from_fn(straight.len(), |i| {
            straight[i] - (stretch(ahead, i) - stretch(now, i)) / self.horizon_s
        }))
    }
}

impl CableLaw for PFeedforward {
    fn velocity(&mut self, asked: &LawInput<'_>) -> Option<CableVec> {
        let (speed, desired) = (asked.desired_velocities_m_s()?, asked.desired_lengths_m()?);
        Some(PFeedforward::velocity(self, &speed, &desired, &asked.lengths_m()))
    }
}
