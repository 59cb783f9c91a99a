//! From the answers by the old parameters to those by the new ones, without a step.
//!
//! A law that remembers cannot be asked twice, so the old parameters are not asked any more: what they commanded beyond the new ones in the
//! cycle of the change dies away evenly, as the arbiter lets the command of a controller die away that has died.

use cable_robot::CableVec;

/// The fade of the answers to one estimate.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Fade {
    /// Cycle and velocities of the last answer, m/s.
    last: Option<(u64, CableVec)>,
    state: State,
}

#[derive(Debug, Clone, Copy, Default)]
enum State {
    #[default]
    Over,
    /// Begins with the next answer.
    Due {
        fade_s: f64,
    },
    Runs {
        began: u64,
        cycles: u64,
        difference_m_s: CableVec,
    },
}

impl Fade {
    /// The next answer is one by other parameters.
    pub(crate) fn begin(&mut self, fade_s: f64) {
        self.state = State::Due { fade_s };
    }

    /// Nothing moves, so there is nothing to fade from.
    pub(crate) fn rest(&mut self) {
        *self = Self::default();
    }

    /// What is answered in a cycle in which the present parameters give `new`.
    pub(crate) fn step(&mut self, cycle: u64, period_s: f64, new: &CableVec) -> CableVec {
        if let State::Due { fade_s } = self.state {
            let cycles = (fade_s / period_s).round().clamp(0.0, 1e4) as u64;
            // An answer of long ago is not what the drives do now.
            let just_before = self.last.filter(|(of, _)| cycle.saturating_sub(*of) <= 1);
            self.state = match just_before {
                Some((_, was)) if cycles > 0 => {
                    State::Runs { began: cycle, cycles, difference_m_s: was.zip_map(new, |was, new| was - new) }
                }
                _ => State::Over,
            };
        }
        let State::Runs { began, cycles, difference_m_s } = self.state else { return *new };
        let passed = cycle.saturating_sub(began).saturating_add(1);
        if cycle < began || passed >= cycles {
            self.state = State::Over;
            return *new;
        }
        let share = 1.0 - passed as f64 / cycles as f64;
        new.zip_map(&difference_m_s, |new, difference| new + share * difference)
    }

    /// The answer of a cycle as it went out.
    pub(crate) fn sent(&mut self, cycle: u64, velocities_m_s: &CableVec) {
        self.last = Some((cycle, *velocities_m_s));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(fade: &mut Fade, cycle: u64, new: f64) -> f64 {
        let out = fade.step(cycle, 0.01, &CableVec::repeat(3, new));
        fade.sent(cycle, &out);
        out[0]
    }

    #[test]
    fn no_cycle_steps_by_more_than_its_share_of_the_difference() {
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
    fn at_rest_and_after_a_gap_there_is_nothing_to_fade_from() {
        let mut fade = Fade::default();
        fade.begin(0.25);
        assert_eq!(run(&mut fade, 1, 0.2), 0.2);
        fade.begin(0.25);
        assert_eq!(run(&mut fade, 5, 0.3), 0.3);
        fade.begin(0.25);
        fade.rest();
        assert_eq!(run(&mut fade, 6, 0.4), 0.4);
    }
}
