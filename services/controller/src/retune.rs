//! Fades from the commands with old parameters to those with new ones, without a step.
//!
//! A law with state cannot be evaluated twice in a cycle. So the law is evaluated with the new parameters only, and the
//! difference to the last command with the old ones decreases linearly to 0. The arbiter fades after a controller has
//! died in the same way.

use cable_robot::CableVec;

/// The fade of the commands for one estimate slot.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Fade {
    /// Cycle and velocities of the last command, m/s.
    last: Option<(u64, CableVec)>,
    state: State,
}

#[derive(Debug, Clone, Copy, Default)]
enum State {
    #[default]
    Inactive,
    /// Starts with the next command.
    Pending {
        fade_s: f64,
    },
    Active {
        began: u64,
        cycles: u64,
        difference_m_s: CableVec,
    },
}

impl Fade {
    /// Starts a fade with the next command, after a change of parameters.
    pub(crate) fn begin(&mut self, fade_s: f64) {
        self.state = State::Pending { fade_s };
    }

    /// Ends the fade at rest, where the last command is 0.
    pub(crate) fn reset(&mut self) {
        *self = Self::default();
    }

    /// Returns the faded command of a cycle in which the present parameters give `new`.
    pub(crate) fn step(&mut self, cycle: u64, period_s: f64, new: &CableVec) -> CableVec {
        if let State::Pending { fade_s } = self.state {
            let cycles = (fade_s / period_s).round().clamp(0.0, 1e4) as u64;
            // An older command is no longer that of the drives.
            let just_before = self.last.filter(|(of, _)| cycle.saturating_sub(*of) <= 1);
            self.state = match just_before {
                Some((_, was)) if cycles > 0 => {
                    State::Active { began: cycle, cycles, difference_m_s: was.zip_map(new, |was, new| was - new) }
                }
                _ => State::Inactive,
            };
        }
        let State::Active { began, cycles, difference_m_s } = self.state else { return *new };
        let passed = cycle.saturating_sub(began).saturating_add(1);
        if cycle < began || passed >= cycles {
            self.state = State::Inactive;
            return *new;
        }
        let share = 1.0 - passed as f64 / cycles as f64;
        new.zip_map(&difference_m_s, |new, difference| new + share * difference)
    }

    /// Records the command that was sent in a cycle.
    pub(crate) fn record(&mut self, cycle: u64, velocities_m_s: &CableVec) {
        self.last = Some((cycle, *velocities_m_s));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(fade: &mut Fade, cycle: u64, new: f64) -> f64 {
        let out = fade.step(cycle, 0.01, &CableVec::repeat(3, new));
        fade.record(cycle, &out);
        out[0]
    }

    #[test]
    fn the_difference_decreases_by_the_same_step_in_every_cycle() {
        let mut fade = Fade::default();
        assert_eq!(run(&mut fade, 1, 0.1), 0.1);
        fade.begin(0.25);
        let mut last = 0.1;
        for cycle in 2..27 {
            let now = run(&mut fade, cycle, 0.2);
            assert!((now - last - 0.1 / 25.0).abs() < 1e-12, "{cycle}: {last} to {now}");
            last = now;
        }
        assert_eq!((last, run(&mut fade, 27, 0.2)), (0.2, 0.2));
    }

    #[test]
    fn there_is_no_fade_at_rest_and_after_a_gap() {
        let mut fade = Fade::default();
        fade.begin(0.25);
        assert_eq!(run(&mut fade, 1, 0.2), 0.2);
        fade.begin(0.25);
        assert_eq!(run(&mut fade, 5, 0.3), 0.3);
        fade.begin(0.25);
        fade.reset();
        assert_eq!(run(&mut fade, 6, 0.4), 0.4);
    }
}
