//! Reset of the drives' speed loops at rest.
//!
//! A drive holds with its speed loop, and the loop keeps the integral from braking. Under a taut cable the encoder
//! shows the least motion, and the loop corrects itself. A slack cable does not turn the encoder, so the remaining
//! integral drives the drum on, slowly, without end and unseen. A drive whose loop was open for a moment starts
//! without an integral.

use crate::settings::CoreConfig;
use crate::watch::Watch;
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

impl Still {
    /// Counts a cycle; `at_rest`: the drives hold, and nothing is to move. Returns true in the one cycle in which every
    /// drive gets duty 0 instead of speed 0.
    ///
    /// A load F that the gear does not hold accelerates rotor and gear, a mass m on the cable, in this cycle of length
    /// t: it pays out F t² / 2 m, less what friction and shorted leads brake. For 20 N on the 25 kg of a geared motor
    /// (`load.rs`) that is 0.04 mm at 100 Hz and 1 mm at 20 Hz; for a direct drive of 0.4 kg it is 2.5 mm at 100 Hz.
    /// The encoder counts it, and the speed that remains is for the loop to brake.
    pub(super) fn resets_loops(&mut self, config: &CoreConfig, at_rest: bool) -> bool {
        self.cycles = if at_rest { self.cycles.saturating_add(1) } else { 0 };
        at_rest && RESET_S.iter().any(|seconds| self.cycles == config.cycles(*seconds))
    }

    /// Adds the newest currents to the average of those that hold.
    pub(super) fn average(&mut self, config: &CoreConfig, watch: &Watch) {
        let from = settled_cycles(config) - config.cycles(AVERAGED_S);
        let averaged = self.cycles.saturating_sub(from).clamp(1, config.cycles(AVERAGE_S));
        for (i, mean_a) in self.current_a.iter_mut().enumerate().take(config.cable_count()) {
            *mean_a += (watch.current_a(i) - *mean_a) / f64::from(averaged);
        }
    }

    /// Average currents of the motors, A, once the loops are not reset any more and every current was read while they
    /// held. A single reading is no measure of the load: the loop of a motor with little friction turns it to and fro
    /// by a step of its encoder.
    pub(super) fn currents_a(&self, config: &CoreConfig, watch: &Watch) -> Option<&[f64; CABLES]> {
        let settled = settled_cycles(config);
        let read = |i| self.cycles.saturating_sub(watch.current_age(i)) >= settled;
        (0..config.cable_count()).all(read).then_some(&self.current_a)
    }
}

/// Cycles at rest after which the loops hold.
fn settled_cycles(config: &CoreConfig) -> u32 {
    let [_, last_s] = RESET_S;
    config.cycles(last_s) + config.cycles(SETTLED_S)
}
