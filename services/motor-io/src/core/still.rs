//! Reset of the drives' speed loops at rest.
//!
//! A drive holds with its speed loop, and the loop keeps the integral from braking. Under a taut cable the encoder
//! shows the least motion, and the loop corrects itself. A slack cable does not turn the encoder, so the remaining
//! integral drives the drum on, slowly, without end and unseen. A drive whose loop was open for a moment starts
//! without an integral.

use super::Core;
use crate::mode::Mode;
use messages::CABLES;

/// Times at rest at which the loops are reset, s: once the drums stand, and again when the node no longer swings.
const RESET_S: [f64; 2] = [0.5, 3.0];
/// Time after a reset until the loop holds its load again, s: drives react after up to 0.16 s, and their integral takes
/// several times that.
const SETTLED_S: f64 = 1.0;
/// The last part of it, from which on currents are averaged, s.
const AVERAGED_S: f64 = 0.5;
/// Time over which the currents that hold are averaged, s: several periods in which a node swings on its cables, and in
/// which a loop turns its motor to and fro by a step of the encoder.
const AVERAGE_S: f64 = 1.0;

/// What the drives do at rest.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Still {
    /// Cycles at rest with the drives on, in any mode.
    cycles: u32,
    /// Average current of each motor since the loops hold, A.
    current_a: [f64; CABLES],
}

impl Core {
    /// Returns true in the one cycle in which every drive gets duty 0 instead of speed 0. A gear that does not hold its
    /// cable pays out less than a tenth of a millimetre in it.
    pub(super) fn resets_loops(&mut self, sent: &[f64; CABLES]) -> bool {
        let at_rest = matches!(self.safety.mode(), Mode::Holding | Mode::Faulted | Mode::EmergencyStop);
        let still = at_rest && *sent == [0.0; CABLES];
        self.still.cycles = if still { self.still.cycles.saturating_add(1) } else { 0 };
        still && RESET_S.iter().any(|seconds| self.still.cycles == self.config.cycles(*seconds))
    }

    /// Cycles at rest after which the loops hold.
    fn settled_cycles(&self) -> u32 {
        let [_, last_s] = RESET_S;
        self.config.cycles(last_s) + self.config.cycles(SETTLED_S)
    }

    /// Adds the newest currents to the average of those that hold.
    pub(super) fn average_currents(&mut self) {
        let from = self.settled_cycles() - self.config.cycles(AVERAGED_S);
        let averaged = self.still.cycles.saturating_sub(from).clamp(1, self.config.cycles(AVERAGE_S));
        for i in 0..self.config.cable_count() {
            let mean_a = &mut self.still.current_a[i];
            *mean_a += (self.watch.current_a(i) - *mean_a) / f64::from(averaged);
        }
    }

    /// Average currents of the motors, A, once the loops are not reset any more and every current was read while they
    /// held. A single reading is no measure of the load: the loop of a motor with little friction turns it to and fro
    /// by a step of its encoder.
    pub(super) fn currents_that_hold_a(&self) -> Option<&[f64; CABLES]> {
        let settled = self.settled_cycles();
        let read = |i| self.still.cycles.saturating_sub(self.watch.current_age(i)) >= settled;
        (0..self.config.cable_count()).all(read).then_some(&self.still.current_a)
    }
}
