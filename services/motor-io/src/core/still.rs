//! At rest the speed loops of the drives start anew.
//!
//! A drive holds with its speed loop, and that loop keeps what it has summed up while it braked. Under a taut line the encoder shows
//! the least motion, and the loop corrects itself. A slack line does not turn the encoder: what is left in the loop then drives the
//! drum on, slowly, without end, and nobody sees it. A drive whose loop was open for a moment begins with nothing summed up.

use super::Core;
use crate::mode::Mode;
use messages::CABLES;

/// Times at rest at which it happens, s: once the drums stand, and once more when a node that was thrown about hangs still.
const ANEW_S: [f64; 2] = [0.5, 3.0];

impl Core {
    /// True in the one cycle in which every line is at duty 0 instead of speed 0. A gear that does not hold its line lets out less than a
    /// tenth of a millimetre in it.
    pub(super) fn loops_begin_anew(&mut self, sent: &[f64; CABLES]) -> bool {
        let at_rest = matches!(self.safety.mode(), Mode::Holding | Mode::Faulted | Mode::EmergencyStop);
        let still = at_rest && *sent == [0.0; CABLES];
        self.still = if still { self.still.saturating_add(1) } else { 0 };
        still && ANEW_S.iter().any(|seconds| self.still == self.config.cycles(*seconds))
    }
}
