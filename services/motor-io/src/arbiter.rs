//! Whose command is used: two slots of controllers, each answering for two slots of estimators.
//!
//! Every cycle each slot's command gets a verdict, and the first good pair in a fixed order is used: the active controller on the
//! active estimate, then on the other estimate, then the other controller. So the death of either is decided where the command
//! is used, within the same cycle.

use crate::limits::largest;
use messages::{CABLES, MotorAuthority, MotorCommand, MotorInput, SLOTS};

/// A velocity beyond this many times the limit is not a command that saturates but a command that is wrong.
const ABSURD: f64 = 4.0;

/// A controller that joins while the robot moves is heard once it has answered well for so many cycles in a row.
const SHADOW_CYCLES: u32 = 50;

/// The command of one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chosen {
    /// Cable velocities, m/s; finite, zero beyond the robot's cables.
    pub velocity_m_s: [f64; CABLES],
    /// Controller slot.
    pub controller: usize,
    /// Estimator slot.
    pub estimator: usize,
    /// Segment it follows; 0: none.
    pub segment: u32,
    /// Cycles for which it may be used.
    pub ttl_cycles: u32,
    /// Oldest reading it rests on, ns.
    pub oldest_input_ns: u64,
}

/// See the module's text.
#[derive(Debug, Clone)]
pub struct Arbiter {
    cables: usize,
    absurd_m_s: f64,
    active_controller: usize,
    active_estimator: usize,
    incarnation: [u32; SLOTS],
    /// Who answers in each slot without being heard, and for how many cycles in a row.
    shadow: [(u32, u32); SLOTS],
    in_use: usize,
    verdict: [u8; SLOTS],
}

impl Arbiter {
    /// Slot a active in both roles.
    #[must_use]
    pub fn new(cables: usize, cable_speed_m_s: f64) -> Self {
        Self {
            cables,
            absurd_m_s: ABSURD * cable_speed_m_s,
            active_controller: 0,
            active_estimator: 0,
            incarnation: [0; SLOTS],
            shadow: [(0, 0); SLOTS],
            in_use: 0,
            verdict: [MotorAuthority::VERDICT_NONE; SLOTS],
        }
    }

    /// Judges this cycle's commands and chooses. While `moving`, a controller that was started anew is refused: its predecessor's
    /// command is what the robot moves by.
    pub fn choose(&mut self, input: &MotorInput, epoch: u32, moving: bool) -> Option<Chosen> {
        let mut chosen = None;
        for turn in 0..SLOTS {
            let slot = (self.active_controller + turn) % SLOTS;
            if input.command_arrived[slot] == 0 {
                if self.verdict[slot] != MotorAuthority::VERDICT_NONE {
                    self.verdict[slot] = MotorAuthority::VERDICT_ABSENT;
                }
                continue;
            }
            match self.judge(&input.command[slot], input.header.cycle, epoch) {
                Ok(_) if moving && !self.known(slot, input.command[slot].incarnation) => {
                    self.verdict[slot] = MotorAuthority::VERDICT_INCARNATION;
                }
                Ok(good) => {
                    self.shadow[slot] = (0, 0);
                    self.verdict[slot] = MotorAuthority::VERDICT_ACCEPTED;
                    self.incarnation[slot] = input.command[slot].incarnation;
                    chosen = chosen.or(Some(Chosen { controller: slot, ..good }));
                }
                Err(verdict) => {
                    self.shadow[slot] = (0, 0);
                    self.verdict[slot] = verdict;
                }
            }
        }
        self.in_use = chosen.map_or(self.in_use, |chosen: Chosen| chosen.controller);
        chosen
    }

    /// While the robot moves: whether this is the controller that the slot is known for. In the slot that is not in use, a new one becomes
    /// known by answering well for a while; its predecessor's state is not its own, so it is not heard before.
    fn known(&mut self, slot: usize, incarnation: u32) -> bool {
        if incarnation == self.incarnation[slot] {
            return true;
        }
        let (who, cycles) = self.shadow[slot];
        self.shadow[slot] = (incarnation, if who == incarnation { cycles.saturating_add(1) } else { 1 });
        slot != self.in_use && self.shadow[slot].1 > SHADOW_CYCLES
    }

    fn judge(&self, command: &MotorCommand, cycle: u64, epoch: u32) -> Result<Chosen, u8> {
        if command.epoch != epoch {
            return Err(MotorAuthority::VERDICT_EPOCH);
        }
        if command.incarnation == 0 {
            return Err(MotorAuthority::VERDICT_INCARNATION);
        }
        if command.based_on_cycle.checked_add(1) != Some(cycle) {
            return Err(MotorAuthority::VERDICT_STALE);
        }
        let mut refusal = MotorAuthority::VERDICT_NO_ESTIMATE;
        for turn in 0..SLOTS {
            let estimator = (self.active_estimator + turn) % SLOTS;
            if command.valid[estimator] != 1 {
                continue;
            }
            let mut velocity_m_s = [0.0; CABLES];
            velocity_m_s[..self.cables].copy_from_slice(&command.velocity_m_s[estimator * CABLES..][..self.cables]);
            if !velocity_m_s.iter().all(|v| v.is_finite()) {
                refusal = MotorAuthority::VERDICT_NOT_FINITE;
            } else if largest(&velocity_m_s) > self.absurd_m_s {
                refusal = MotorAuthority::VERDICT_OUT_OF_LIMITS;
            } else {
                return Ok(Chosen {
                    velocity_m_s,
                    controller: 0,
                    estimator,
                    segment: command.segment,
                    ttl_cycles: command.ttl_cycles,
                    oldest_input_ns: command.header.oldest_input_ns,
                });
            }
        }
        Err(refusal)
    }

    /// The slot whose command is used first.
    #[must_use]
    pub fn active_controller(&self) -> usize {
        self.active_controller
    }

    /// The slot whose estimate is used first.
    #[must_use]
    pub fn active_estimator(&self) -> usize {
        self.active_estimator
    }

    /// Last verdict on each slot.
    #[must_use]
    pub fn verdict(&self) -> [u8; SLOTS] {
        self.verdict
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn input() -> MotorInput {
        let mut input = MotorInput::default();
        input.header.cycle = 8;
        for slot in 0..SLOTS {
            input.command_arrived[slot] = 1;
            let command = &mut input.command[slot];
            command.based_on_cycle = 7;
            command.epoch = 5;
            command.incarnation = 77;
            command.valid = [1, 1];
            command.velocity_m_s = [0.1 * (slot + 1) as f64; 16];
        }
        input
    }

    #[test]
    fn the_first_good_pair_is_used() {
        let mut arbiter = Arbiter::new(3, 0.8);
        let mut given = input();
        assert_eq!(arbiter.choose(&given, 5, false).unwrap().velocity_m_s[..4], [0.1, 0.1, 0.1, 0.0]);
        given.command[0].valid = [0, 1];
        assert_eq!(arbiter.choose(&given, 5, false).unwrap().estimator, 1);
        given.command[0].valid = [0, 0];
        let other = arbiter.choose(&given, 5, false).unwrap();
        assert_eq!((other.controller, other.estimator), (1, 0));
        assert_eq!(arbiter.verdict(), [MotorAuthority::VERDICT_NO_ESTIMATE, MotorAuthority::VERDICT_ACCEPTED]);
    }

    #[test]
    fn what_is_not_current_finite_and_sane_is_refused_with_its_reason() {
        type Spoil = fn(&mut MotorCommand);
        let cases: [(u8, Spoil); 8] = [
            (MotorAuthority::VERDICT_STALE, |c| c.based_on_cycle = 6),
            (MotorAuthority::VERDICT_STALE, |c| c.based_on_cycle = u64::MAX),
            (MotorAuthority::VERDICT_EPOCH, |c| c.epoch = 4),
            (MotorAuthority::VERDICT_INCARNATION, |c| c.incarnation = 0),
            (MotorAuthority::VERDICT_NOT_FINITE, |c| c.velocity_m_s[2] = f64::NAN),
            (MotorAuthority::VERDICT_NOT_FINITE, |c| c.velocity_m_s = [f64::INFINITY; 16]),
            (MotorAuthority::VERDICT_OUT_OF_LIMITS, |c| c.velocity_m_s[0] = 3.3),
            (MotorAuthority::VERDICT_NO_ESTIMATE, |c| c.valid = [2, 3]),
        ];
        for (verdict, spoil) in cases {
            let mut arbiter = Arbiter::new(3, 0.8);
            let mut given = input();
            given.command_arrived[1] = 0;
            spoil(&mut given.command[0]);
            if verdict == MotorAuthority::VERDICT_NOT_FINITE || verdict == MotorAuthority::VERDICT_OUT_OF_LIMITS {
                given.command[0].valid = [1, 0];
            }
            assert_eq!(arbiter.choose(&given, 5, false), None);
            assert_eq!(arbiter.verdict(), [verdict, MotorAuthority::VERDICT_NONE]);
        }
    }

    #[test]
    fn a_controller_started_anew_is_refused_while_the_robot_moves() {
        let mut arbiter = Arbiter::new(3, 0.8);
        let mut given = input();
        given.command_arrived[1] = 0;
        assert!(arbiter.choose(&given, 5, false).is_some());
        given.command[0].incarnation = 78;
        for _ in 0..2 * SHADOW_CYCLES {
            assert!(arbiter.choose(&given, 5, true).is_none());
        }
        assert_eq!(arbiter.verdict()[0], MotorAuthority::VERDICT_INCARNATION);
        assert!(arbiter.choose(&given, 5, false).is_some());
    }

    #[test]
    fn a_standby_that_joins_while_the_robot_moves_is_heard_after_a_while() {
        let mut arbiter = Arbiter::new(3, 0.8);
        let mut given = input();
        given.command_arrived[1] = 0;
        assert!(arbiter.choose(&given, 5, false).is_some());
        given.command_arrived = [1, 1];
        for who in [91, 92] {
            given.command_arrived[0] = 1;
            given.command[1].incarnation = who;
            for _ in 0..SHADOW_CYCLES {
                assert_eq!(arbiter.choose(&given, 5, true).unwrap().controller, 0);
                assert_eq!(arbiter.verdict()[1], MotorAuthority::VERDICT_INCARNATION);
            }
            given.command_arrived[0] = 0;
            assert_eq!(arbiter.choose(&given, 5, true).map(|chosen| chosen.controller), Some(1));
            arbiter.in_use = 0;
        }
    }
}
