//! The touch-down of a node that the robot lowers onto the floor, from the lengths that it counts.
//!
//! When the floor carries the node, the tension of its cables drops to zero. From then on no cable pulls its idler
//! along, so its length stands still although its winch still pays out. That moment is sharp, and the length is the one
//! of a straight cable without stretch, whatever it carried before. The current of the motor says less: a gear that
//! nearly locks needs about the same current to pay out with load and without.

use std::collections::VecDeque;

use cable_robot::CableVec;

/// Cable that a winch has to pay out while its length stands still, m: several steps of an encoder, and less than
/// motor-io pays out before it stops for a slack cable.
const STANDING_M: f64 = 0.001;

/// Share of what the winch pays out up to which a length stands still; a cable under tension follows whole.
const STANDING_SHARE: f64 = 0.25;

/// Share from which a length follows its winch, and cable over which it has to, m.
const FOLLOWING_SHARE: f64 = 0.75;
const FOLLOWING_M: f64 = 0.01;

/// Longest time over which a length is compared with its winch, s: at 2 mm/s.
const LONGEST_S: f64 = 6.0;

/// Pause of all winches after which a cable that stood still is judged again, s: a robot that holds because some cables
/// are slack goes on within it.
const PAUSE_S: f64 = 2.0;

/// The cables in one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Paying {
    /// Time, s.
    pub time_s: f64,
    /// Velocity sent to each winch, m/s; positive pays out.
    pub command_m_s: CableVec,
    /// Length of each cable by its encoder, m.
    pub lengths_m: CableVec,
}

/// Detector of a touch-down: it takes every cycle.
#[derive(Debug, Clone, Default)]
pub struct TouchDown {
    past: VecDeque<Paying>,
    followed: Vec<bool>,
    standing: Vec<bool>,
    paused_since_s: Option<f64>,
}

impl TouchDown {
    /// Takes a cycle. Returns the lengths once every cable of the motion stands still, after it followed its winch.
    pub fn step(&mut self, now: &Paying) -> Option<CableVec> {
        let n = now.lengths_m.len();
        let gap = self.past.back().is_some_and(|last| !(last.time_s < now.time_s && last.lengths_m.len() == n));
        if gap || self.followed.len() != n {
            *self = Self { followed: vec![false; n], standing: vec![false; n], ..Self::default() };
        }
        if now.command_m_s.iter().all(|v| *v == 0.0) {
            let since_s = *self.paused_since_s.get_or_insert(now.time_s);
            if now.time_s - since_s > PAUSE_S {
                self.standing.fill(false);
            }
            // Drives lag behind their commands, so a length stands still for a moment at every start.
            if !self.standing.contains(&true) {
                self.followed.fill(false);
                self.past.clear();
            }
        } else {
            self.paused_since_s = None;
        }
        self.past.push_back(*now);
        while self.past.front().is_some_and(|first| now.time_s - first.time_s > LONGEST_S) {
            self.past.pop_front();
        }
        for cable in 0..n {
            self.judge(cable);
        }
        self.standing.iter().all(|standing| *standing).then_some(now.lengths_m)
    }

    /// The cables, from 0, that stand still although their winches pay out.
    pub fn standing(&self) -> impl Iterator<Item = usize> {
        self.standing.iter().enumerate().filter(|(_, standing)| **standing).map(|(cable, _)| cable)
    }

    /// Compares the length of a cable with what its winch paid out.
    fn judge(&mut self, cable: usize) {
        let Some(now) = self.past.back() else { return };
        if now.command_m_s[cable] < 0.0 {
            (self.followed[cable], self.standing[cable]) = (false, false);
            return;
        }
        let mut paid_m = 0.0;
        let mut later_s = now.time_s;
        for then in self.past.iter().rev().skip(1) {
            if then.command_m_s[cable] < 0.0 {
                return;
            }
            paid_m += then.command_m_s[cable] * (later_s - then.time_s);
            later_s = then.time_s;
            let counted_m = now.lengths_m[cable] - then.lengths_m[cable];
            if self.followed[cable] && paid_m >= STANDING_M && !self.standing[cable] {
                self.standing[cable] = counted_m < STANDING_SHARE * paid_m;
            }
            if paid_m >= FOLLOWING_M {
                let follows = counted_m > FOLLOWING_SHARE * paid_m;
                self.followed[cable] |= follows;
                self.standing[cable] &= !follows;
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_start_after_a_pause_in_the_air_is_no_touch_down() {
        const DELAY_S: f64 = 0.1;
        for pause_s in [0.05, 0.5, 1.9, 3.0] {
            let speed_m_s = |time_s: f64| {
                let paused = (2.0..2.0 + pause_s).contains(&time_s);
                if paused || time_s < 0.0 { 0.0 } else { 0.1 }
            };
            let mut detector = TouchDown::default();
            let mut length_m = 3.0;
            for cycle in 0..600 {
                let time_s = f64::from(cycle) * 0.01;
                length_m += 0.01 * speed_m_s(time_s - DELAY_S);
                let now = Paying {
                    time_s,
                    command_m_s: CableVec::repeat(3, speed_m_s(time_s)),
                    lengths_m: CableVec::repeat(3, length_m),
                };
                assert_eq!(detector.step(&now), None, "{time_s} s, pause of {pause_s} s");
            }
        }
    }

    /// Winches that pay out with a delay; cable i stands from `stands_m[i]` on.
    fn run(
        speed_m_s: f64,
        delay_s: f64,
        stands_m: &[f64],
        step_m: f64,
        seconds: f64,
    ) -> (Option<(f64, CableVec)>, TouchDown) {
        let mut detector = TouchDown::default();
        let mut time_s = 0.0;
        while time_s < seconds {
            let paid_m = speed_m_s * (time_s - delay_s).max(0.0);
            let counted = |i: usize| ((3.0 + paid_m.min(stands_m[i])) / step_m).floor() * step_m;
            let now = Paying {
                time_s,
                command_m_s: CableVec::repeat(stands_m.len(), speed_m_s),
                lengths_m: CableVec::from_fn(stands_m.len(), counted),
            };
            if let Some(lengths_m) = detector.step(&now) {
                return (Some((time_s, lengths_m)), detector);
            }
            time_s += 0.01;
        }
        (None, detector)
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        /// Whatever speed, delay and step of the encoder: the lengths at which all cables stand, soon after the last.
        #[test]
        fn the_lengths_are_those_at_which_the_cables_stand(
            speed_m_s in 0.005..0.15f64, delay_s in 0.0..0.15f64, step_m in 1e-5..4e-4f64,
            stands_m in prop::collection::vec(0.03..0.3f64, 3..5),
        ) {
            let (found, _) = run(speed_m_s, delay_s, &stands_m, step_m, 100.0);
            let (time_s, lengths_m) = found.unwrap();
            let last_m = stands_m.iter().copied().fold(0.0, f64::max);
            let after_s = time_s - delay_s - last_m / speed_m_s;
            prop_assert!((0.0..0.02 + 0.008 / speed_m_s).contains(&after_s), "{after_s} s");
            for (length_m, stands_m) in lengths_m.iter().zip(&stands_m) {
                prop_assert!((length_m - 3.0 - stands_m).abs() <= step_m, "{length_m} {stands_m}");
            }
        }

        /// One cable that goes on, as when another jams or touches something, is no touch-down.
        #[test]
        fn one_cable_that_follows_is_enough_to_go_on(speed_m_s in 0.005..0.15f64, stands_m in 0.03..0.1f64) {
            let (found, detector) = run(speed_m_s, 0.07, &[stands_m, 1e9, stands_m], 1e-4, 0.5 / speed_m_s);
            prop_assert!(found.is_none());
            prop_assert_eq!(detector.standing().collect::<Vec<_>>(), [0, 2]);
        }

        /// Drives that do not answer from the beginning, and motions up, are no touch-down.
        #[test]
        fn only_a_cable_that_followed_can_stand(speed_m_s in 0.005..0.15f64) {
            prop_assert!(run(speed_m_s, 0.07, &[0.0; 3], 1e-4, 10.0).0.is_none());
            prop_assert!(run(-speed_m_s, 0.07, &[0.1; 3], 1e-4, 10.0).0.is_none());
        }
    }
}
