//! The law: change this file.

use cable_robot::CableVec;
use controller::{CableLaw, LawInput};

/// Desired velocity plus a share of the length error.
pub struct MyLaw {
    /// Velocity per length error, 1/s.
    pub gain_per_s: f64,
}

impl Default for MyLaw {
    fn default() -> Self {
        Self { gain_per_s: 1.5 }
    }
}

impl CableLaw for MyLaw {
    /// Called in every cycle: returns dL/dt of each cable, m/s (above 0: pays out), from position and setpoint.
    fn velocity(&mut self, asked: &LawInput<'_>) -> Option<CableVec> {
        let speed = asked.desired_velocities_m_s()?;
        let (desired, actual) = (asked.desired_lengths_m()?, asked.lengths_m());
        Some(CableVec::from_fn(speed.len(), |i| speed[i] + self.gain_per_s * (desired[i] - actual[i])))
    }

    /// Recorded in the run file, so that a run contains the parameters it used.
    fn parameters(&self) -> String {
        format!("gain_per_s = {:?}\n", self.gain_per_s)
    }
}
