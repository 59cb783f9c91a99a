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

impl Core {
    /// Returns true in the one cycle in which every drive gets duty 0 instead of speed 0. A gear that does not hold its
    /// cable pays out less than a tenth of a millimetre in it.
    pub(super) fn resets_loops(&mut self, sent: &[f64; CABLES]) -> bool {
        let at_rest = matches!(self.safety.mode(), Mode::Holding | Mode::Faulted | Mode::EmergencyStop);
        let still = at_rest && *sent == [0.0; CABLES];
        self.still = if still { self.still.saturating_add(1) } else { 0 };
        still && RESET_S.iter().any(|seconds| self.still == self.config.cycles(*seconds))
    }

    /// Returns true once the loops are not reset any more and every current was read while they held.
    pub(super) fn currents_hold(&self) -> bool {
        let [_, last_s] = RESET_S;
        let settled = self.config.cycles(last_s) + self.config.cycles(SETTLED_S);
        (0..self.config.cable_count()).all(|i| self.still.saturating_sub(self.watch.current_age(i)) >= settled)
    }
}
