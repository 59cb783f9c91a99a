//! Faulty controllers: they answer every cycle in time, as a sound one does, but with wrong velocities.

use super::random::Random;
use messages::{CABLES, MotorCommand, SLOTS};

/// Kind of fault of a controller.
#[derive(Debug, Clone, Copy)]
pub enum Astray {
    /// Its velocities are multiplied: a factor below 0 leads away, 0 stops, above 1 overshoots.
    Factor(f64),
    /// One cable gets this additional velocity, m/s.
    Bias(usize, f64),
    /// Repeats its first command for ever.
    Stuck(Option<[f64; SLOTS * CABLES]>),
    /// Every velocity is this value.
    All(f64),
}

impl Astray {
    /// A random fault. With more cables than dimensions (`redundant`), cables are never moved against each other: that
    /// ends in a stalled motor or a slack cable, and the recovery requires loosening the cables by hand. A law with too
    /// high a gain excites their elasticity.
    pub(super) fn by_chance(random: &mut Random, redundant: bool) -> Self {
        match random.below(if redundant { 3 } else { 5 }) {
            0 => Self::Factor(random.choose(&[-3.0, -1.0, -0.3, 0.0, if redundant { 0.5 } else { 2.0 }])),
            1 => Self::Stuck(None),
            2 => Self::All(random.choose(&[f64::NAN, f64::INFINITY, 1e300])),
            3 => Self::All(random.choose(&[-0.2, 0.2])),
            _ => Self::Bias(random.below(3), random.choose(&[-0.3, -0.1, -0.03, 0.03, 0.1, 0.3])),
        }
    }

    /// The velocities that it sends instead.
    pub(super) fn alter(&mut self, command: &mut MotorCommand) {
        let velocity_m_s = &mut command.velocity_m_s;
        match self {
            Self::Factor(factor) => velocity_m_s.iter_mut().for_each(|v| *v *= *factor),
            Self::Bias(cable, by_m_s) => (0..SLOTS).for_each(|row| velocity_m_s[row * CABLES + *cable] += *by_m_s),
            Self::Stuck(said) => *velocity_m_s = *said.get_or_insert(*velocity_m_s),
            Self::All(all_m_s) => velocity_m_s.fill(*all_m_s),
        }
    }
}
