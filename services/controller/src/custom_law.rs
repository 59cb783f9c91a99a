//! The interface of a control law for each cable, for custom laws too.

use cable_control::law::PFeedforward;
use cable_robot::elastic::Realisation;
use cable_robot::{CableVec, Jacobian, Robot, Setpoint};
use messages::NodeEstimate;

/// A control law, called in every cycle once for each live estimate.
///
/// The controller handles motions, the plan clock, slots, epochs and limits (it scales the whole vector). It ignores a
/// law in a cycle in which its result is `None` or not finite. The law runs in the control cycle: it must not wait, use
/// input or output, or allocate.
pub trait CableLaw: Send {
    /// Computes the cable velocities dL/dt, m/s, one per cable; `None`: no answer to this estimate.
    ///
    /// A law must keep its state per [`LawInput::slot`]: with two running estimators it is called twice in a cycle.
    fn velocity(&mut self, input: &LawInput<'_>) -> Option<CableVec>;

    /// Returns the parameters as TOML, one `key = value` per text line. The run stores them, also those of a custom
    /// law.
    fn parameters(&self) -> String {
        String::new()
    }
}

/// Input of a control law for one estimate in one cycle.
#[derive(Debug, Clone, Copy)]
pub struct LawInput<'a> {
    /// Slot of the estimate, 0 or 1.
    pub slot: usize,
    /// The robot.
    pub robot: &'a Robot,
    /// Period of the control cycle, s.
    pub period_s: f64,
    /// Time from `now` to `ahead`, s.
    pub horizon_s: f64,
    /// Position, cable lengths and tensions.
    pub estimate: &'a NodeEstimate,
    /// Setpoint at the instant of the estimate.
    pub now: &'a Setpoint,
    /// Setpoint at the end of the horizon.
    pub ahead: &'a Setpoint,
    /// Unstretched lengths and tensions at `now`; `None` if the cables cannot hold the node there.
    pub now_held: Option<&'a Realisation>,
    /// Unstretched lengths and tensions at `ahead`.
    pub ahead_held: Option<&'a Realisation>,
}

impl LawInput<'_> {
    /// Returns the desired unstretched lengths, m.
    pub fn desired_lengths_m(&self) -> Option<CableVec> {
        self.now_held.map(|held| held.unstretched_m)
    }

    /// Returns the estimated unstretched lengths, m.
    pub fn lengths_m(&self) -> CableVec {
        CableVec::from_array8(&self.estimate.predicted_m, self.robot.cable_count())
    }

    /// Returns the desired velocities of the unstretched lengths, m/s: (14) at the setpoint, and the mean change of the
    /// stretch over the horizon. (Tensions are discontinuous where the acceleration is, so the stretch has no velocity
    /// at an instant.)
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
    fn velocity(&mut self, input: &LawInput<'_>) -> Option<CableVec> {
        let (speed, desired) = (input.desired_velocities_m_s()?, input.desired_lengths_m()?);
        Some(PFeedforward::velocity(self, &speed, &desired, &input.lengths_m()))
    }
}
