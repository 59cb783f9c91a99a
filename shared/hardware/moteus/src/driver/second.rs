//! The second encoder of a unit: a reading within one turn, continued over turns.

use drives::{CommandName, Error, Timed, reply_text};
use serial::Transport;

use super::Bus;
use super::question::{CLOCK, cycle};
use super::round::Reading;
use crate::codec::COUNTS_PER_TURN;

/// A turn of the encoder, in the steps of a 16-bit position.
const TURN: i32 = 10_000;
const STEP: i32 = COUNTS_PER_TURN as i32 / TURN;
/// Counts of a step of a second encoder.
pub const SECOND_STEP_COUNTS: f64 = STEP as f64;
/// A step of the unit's clock, ns.
const CLOCK_STEP_NS: u64 = 1_000_000;

/// Motion between two readings within a turn, by the shorter way.
pub(super) fn moved(from: i32, to: i32) -> i32 {
    (to - from + TURN / 2).rem_euclid(TURN) - TURN / 2
}

impl<T: Transport> Bus<T> {
    /// Uses the reading of a second encoder, of the same answer as a position that was used. One that was never read is
    /// an error of the configuration; one that fails later has no new reading, and the unit stays in use.
    pub(super) fn use_second(&mut self, index: usize, reading: &Reading) -> Result<(), Error> {
        let Some(unit) = self.units.get_mut(index) else { return Ok(()) };
        let Some(second) = unit.config.second else { return Ok(()) };
        let Some(raw) = reading.values[cycle::SECOND] else {
            if unit.second_seen {
                return Ok(());
            }
            let asked = CommandName { words: "read second encoder", code: None };
            let said = reply_text(format_args!("no position of source {}", second.source));
            return Err(self.error(index, |port, unit| Error::Unexpected { port, unit, asked, said }));
        };
        let at_ns = reading.at_ns;
        let now_ms = reading.values[CLOCK].unwrap_or(0);
        unit.second_seen = true;
        let report = &mut unit.report.second;
        let since = unit.last_second.replace((raw, now_ms));
        let counted = since.filter(|(_, then_ms)| {
            // Beyond half a turn the shorter way may be the wrong one. The unit's clock has the time between readings.
            let passed_ms = u64::try_from(now_ms.wrapping_sub(*then_ms)).unwrap_or(u64::MAX / CLOCK_STEP_NS - 1);
            let passed_ns = (passed_ms + 1) * CLOCK_STEP_NS;
            second.bound.counts_s <= 0.0 || !second.bound.explains(f64::from(STEP * TURN / 2), passed_ns)
        });
        match counted {
            Some((from, _)) => {
                let value = report.counts.value + i64::from(STEP * moved(from, raw));
                report.counts = Timed { value, at_ns };
            }
            None => {
                report.breaks = report.breaks.wrapping_add(1);
                report.counts.at_ns = at_ns;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Motions below half a turn are found from any angle, in both directions.
        #[test]
        fn motions_within_half_a_turn_are_found(angle in 0..TURN, motion in -TURN / 2 + 1..TURN / 2) {
            prop_assert_eq!(moved(angle, (angle + motion).rem_euclid(TURN)), motion);
        }
    }
}
