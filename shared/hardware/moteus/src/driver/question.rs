//! Questions, and how an answer shows which one it answers.
//!
//! A unit answers registers in the order in which it was asked. The driver asks in another order each time, so the
//! order of the answer is a tag that costs no byte: 720 and more for the question of a cycle. An older answer with the
//! same order is told by the millisecond counter, which is part of every question.

use arrayvec::ArrayVec;

use crate::codec::{Frame, Register, Resolution, Subframe, Value};

/// Most registers of a question.
pub(super) const MAX_READS: usize = 7;

/// Answer to a question, in the order of [`Question::reads`]; `None` for a register without a number. Of a float it
/// holds the bits.
pub(super) type Values = [Option<i32>; MAX_READS];

/// What a unit is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Question {
    /// What the control cycle needs: clock, mode, position, the command as the unit has it, and the contact of
    /// a stop button.
    Cycle {
        /// The command is a torque instead of a velocity.
        torque: bool,
        /// Source of a second encoder that is read too.
        second: Option<u8>,
    },
    /// What changes slowly.
    Slow,
    /// What a unit is.
    Identity,
}

/// Reason why an answer is not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unfit {
    /// It answers another question.
    Other,
    /// The unit does not have a register.
    Refused { register: u16 },
}

/// Place of the clock in every answer.
pub(super) const CLOCK: usize = 0;
/// Places in the answer to [`Question::Cycle`].
pub(super) mod cycle {
    pub(in crate::driver) const MODE: usize = 1;
    pub(in crate::driver) const POSITION: usize = 2;
    /// The velocity, or the bits of the torque.
    pub(in crate::driver) const COMMAND: usize = 3;
    pub(in crate::driver) const TIMEOUT: usize = 4;
    pub(in crate::driver) const PINS: usize = 5;
    pub(in crate::driver) const SECOND: usize = 6;
}
/// Places in the answer to [`Question::Slow`].
pub(super) mod slow {
    pub(in crate::driver) const FAULT: usize = 1;
    pub(in crate::driver) const CURRENT: usize = 2;
    pub(in crate::driver) const POWER: usize = 3;
    pub(in crate::driver) const VOLTAGE: usize = 4;
    pub(in crate::driver) const TEMPERATURE: usize = 5;
}
/// Place in the answer to [`Question::Identity`].
pub(super) const FIRMWARE: usize = 1;

impl Question {
    /// Registers, the clock first.
    fn reads(self) -> ArrayVec<(u16, Resolution), MAX_READS> {
        use Resolution::{F32, I8, I16, I32};
        const SLOW: &[(u16, Resolution)] = &[
            (Register::MILLISECONDS, I32),
            (Register::FAULT, I8),
            (Register::Q_CURRENT, I32),
            (Register::POWER, I32),
            (Register::VOLTAGE, I16),
            (Register::TEMPERATURE, I16),
        ];
        const IDENTITY: &[(u16, Resolution)] =
            &[(Register::MILLISECONDS, I32), (Register::FIRMWARE, I32), (Register::REGISTER_MAP, I32)];
        match self {
            Question::Cycle { torque, second } => [
                (Register::MILLISECONDS, I32),
                (Register::MODE, I8),
                (Register::POSITION, I32),
                if torque { (Register::COMMAND_TORQUE, F32) } else { (Register::COMMAND_VELOCITY, I32) },
                (Register::COMMAND_TIMEOUT, I16),
                (Register::AUX2_GPIO, I8),
            ]
            .into_iter()
            .chain(second.map(|source| (Register::encoder_position(source), I16)))
            .collect(),
            Question::Slow => SLOW.iter().copied().collect(),
            Question::Identity => IDENTITY.iter().copied().collect(),
        }
    }

    /// Order in which the registers are asked for: a permutation, another one for each of n! tags in a row.
    fn order(self, tag: u32) -> ArrayVec<usize, MAX_READS> {
        let mut left: ArrayVec<usize, MAX_READS> = (0..self.reads().len()).collect();
        let mut order = ArrayVec::new();
        let mut rest = tag as usize;
        while !left.is_empty() {
            let place = rest % left.len();
            rest /= left.len();
            order.push(left.remove(place));
        }
        order
    }

    /// Appends the question to a frame.
    pub(super) fn ask(self, tag: u32, frame: &mut Frame) {
        let reads = self.reads();
        for place in self.order(tag) {
            let (register, resolution) = reads[place];
            frame.read(register, resolution);
        }
    }

    /// Reads the answer to the question with this tag.
    pub(super) fn answer(self, tag: u32, frame: &Frame) -> Result<Values, Unfit> {
        let mut values = [None; MAX_READS];
        let mut subframes = frame.subframes();
        let reads = self.reads();
        for place in self.order(tag) {
            let (register, resolution) = reads[place];
            match subframes.next() {
                Some(Ok(Subframe::Reply { register: answered, value }))
                    if answered == register && value.resolution() == resolution =>
                {
                    values[place] = match value {
                        Value::F32(value) => Some(value.to_bits().cast_signed()),
                        value => value.integer(),
                    };
                }
                Some(Ok(Subframe::Error { register: refused, .. })) if refused == register => {
                    return Err(Unfit::Refused { register });
                }
                _ => return Err(Unfit::Other),
            }
        }
        if subframes.next().is_some() { Err(Unfit::Other) } else { Ok(values) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn consecutive_questions_are_asked_in_different_orders() {
        let cycle = |torque, second| Question::Cycle { torque, second };
        let of_cycle = [(cycle(false, None), 720), (cycle(true, None), 720), (cycle(true, Some(1)), 5040)];
        for (question, orders) in of_cycle.into_iter().chain([(Question::Slow, 720), (Question::Identity, 6)]) {
            let seen: BTreeSet<Vec<usize>> = (0..orders).map(|tag| question.order(tag).to_vec()).collect();
            assert_eq!(seen.len(), orders as usize, "{question:?}");
        }
    }
}
