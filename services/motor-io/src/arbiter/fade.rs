//! Bumpless change from one source of commands to another.
//!
//! In a planned swap both sources answer, and the command is their mixture, whose share moves from the old to the
//! new one. If the old one no longer answers, its last difference from the new one decays in the same time. Both
//! are one formula: the new command plus a shrinking share of the difference, which is updated in each cycle in
//! which both answer.

use messages::CABLES;

/// Slots of a controller and an estimator.
pub type Pair = (usize, usize);

/// State of a fade.
#[derive(Debug, Clone)]
pub struct Fade {
    cycles: u32,
    pair: Option<Pair>,
    left: u32,
    /// The pair that was swapped out, while it answers.
    old: Option<Pair>,
    difference: [f64; CABLES],
}

impl Fade {
    /// A fade over this many cycles.
    #[must_use]
    pub fn new(cycles: u32) -> Self {
        Self { cycles, pair: None, left: 0, old: None, difference: [0.0; CABLES] }
    }

    /// Ends the fade: the robot is at rest.
    pub fn rest(&mut self, pair: Option<Pair>) {
        (self.pair, self.left, self.old) = (pair.or(self.pair), 0, None);
    }

    /// Computes the command of a cycle in which this pair is used. `sent` is the previous command to the
    /// drives, `planned` is true if the change in this cycle was announced, and `answer` returns the good
    /// answers of this cycle.
    pub fn step(
        &mut self,
        pair: Pair,
        sent: &[f64; CABLES],
        planned: bool,
        answer: impl Fn(Pair) -> Option<[f64; CABLES]>,
    ) -> Option<[f64; CABLES]> {
        let new = answer(pair)?;
        if self.pair != Some(pair) {
            // In the middle of another fade, the drives were not sent either pair's command.
            self.old = self.pair.filter(|_| planned && self.left == 0);
            self.difference = std::array::from_fn(|i| sent[i] - new[i]);
            self.left = if self.pair.is_some() { self.cycles } else { 0 };
            self.pair = Some(pair);
        }
        if self.left == 0 {
            self.old = None;
            return Some(new);
        }
        if let Some(old) = self.old.and_then(&answer) {
            self.difference = std::array::from_fn(|i| old[i] - new[i]);
        }
        self.left -= 1;
        debug_assert!(self.left < self.cycles, "{} cycles are left of a fade of {}", self.left, self.cycles);
        let share = f64::from(self.left) / f64::from(self.cycles);
        Some(std::array::from_fn(|i| new[i] + share * self.difference[i]))
    }

    /// Progress of the fade, 0 to 1.
    #[must_use]
    pub fn done(&self) -> f64 {
        1.0 - f64::from(self.left) / f64::from(self.cycles.max(1))
    }

    /// The pair that a planned swap fades out, while both are mixed.
    #[must_use]
    pub fn old(&self) -> Option<Pair> {
        self.old.filter(|_| self.left > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OLD: [f64; CABLES] = [0.1; CABLES];
    const NEW: [f64; CABLES] = [0.2; CABLES];

    #[test]
    fn a_planned_swap_mixes_both_commands_and_a_failover_fades_the_difference_out() {
        for (planned, dies) in [(true, u32::MAX), (true, 7), (false, 0)] {
            let mut fade = Fade::new(25);
            assert_eq!(fade.step((0, 0), &OLD, false, |_| Some(OLD)), Some(OLD));
            let mut last = OLD;
            for cycle in 0..25 {
                let answer = |pair| match pair {
                    (1, 0) => Some(NEW),
                    _ => (cycle < dies).then_some(OLD),
                };
                let now = fade.step((1, 0), &last, planned && cycle == 0, answer).unwrap();
                assert!((now[0] - last[0] - 0.1 / 25.0).abs() < 1e-9, "{cycle}: {} {}", last[0], now[0]);
                last = now;
            }
            assert_eq!((last, fade.done()), (NEW, 1.0));
        }
    }

    #[test]
    fn at_rest_there_is_no_fade() {
        let mut fade = Fade::new(25);
        fade.step((0, 0), &OLD, false, |_| Some(OLD));
        fade.rest(Some((1, 0)));
        assert_eq!(fade.step((1, 0), &OLD, false, |_| Some(NEW)), Some(NEW));
    }
}
