//! What can go wrong with drives and lines, watched cycle by cycle: stall, runaway, slack, over-tension, over-current, supply,
//! drive errors, lost units.
//!
//! Each condition has to persist for a number of cycles, because one reading is noise. Time is counted in cycles: a machine that
//! stands still for a moment must not look like a fault of the robot.

use crate::config::CoreConfig;
use crate::faults::Faults;
use messages::{CABLES, MotorAuthority, MotorInput, MotorState, UNITS};
use roboclaw::Status;

/// Cycles without an answer before a unit is lost: one may be noise, two a coincidence.
const LOST_CYCLES: u32 = 3;
/// A resynchronisation takes 50 to 100 ms (quiet line, then a fence); after this it will not succeed, s.
const RESYNC_S: f64 = 0.25;
/// Below this commanded velocity nothing is said about a cable that does not move, m/s.
const STALL_COMMAND_M_S: f64 = 0.01;
/// A cable slower than this share of its command does not move.
const STALL_SHARE: f64 = 0.05;
/// Time constant with which an old command stops being an excuse for motion: drives lag by up to 0.16 s.
const EXCUSE_S: f64 = 0.3;
/// Measured velocity beyond what commands excuse, m/s and share of the limit: encoder steps and overshoot of the drive's loop.
const RUNAWAY_M_S: f64 = 0.03;
const RUNAWAY_SHARE: f64 = 0.25;
/// Tension above the robot's limit by this factor and this much, N, is a fault: the planner plans up to the limit.
const TENSION_FACTOR: f64 = 1.25;
const TENSION_MARGIN_N: f64 = 2.0;
/// Fresh readings of a low supply before it counts: a motor that starts pulls it down for a moment.
const SUPPLY_READINGS: u32 = 5;

/// What the safety machine tells the watch about this cycle.
#[derive(Debug, Clone, Copy)]
pub struct Situation {
    /// The drives hold or move: faults count.
    pub energised: bool,
    /// The robot moves by command of a controller: slack counts.
    pub following: bool,
    /// Velocities sent in this cycle, m/s.
    pub sent_m_s: [f64; CABLES],
    /// Cables at duty 0.
    pub released: [bool; CABLES],
    /// The estimate slot in use.
    pub estimator: usize,
}

/// See the module's text.
#[derive(Debug, Clone)]
pub struct Watch {
    silent: [u32; UNITS],
    resync: [u32; UNITS],
    low_supply: [u32; UNITS],
    stalled: [u32; CABLES],
    runaway: [u32; CABLES],
    slack: [u32; CABLES],
    tight: [u32; CABLES],
    hot: [u32; CABLES],
    straining: [u32; CABLES],
    excuse_high: [f64; CABLES],
    excuse_low: [f64; CABLES],
    current_a: [f64; CABLES],
    duty: [f64; CABLES],
    supply_v: [f64; UNITS],
    status: [u32; UNITS],
}

impl Watch {
    /// Nothing seen yet.
    #[must_use]
    pub fn new() -> Self {
        Self {
            silent: [0; UNITS],
            resync: [0; UNITS],
            low_supply: [0; UNITS],
            stalled: [0; CABLES],
            runaway: [0; CABLES],
            slack: [0; CABLES],
            tight: [0; CABLES],
            hot: [0; CABLES],
            straining: [0; CABLES],
            excuse_high: [0.0; CABLES],
            excuse_low: [0.0; CABLES],
            current_a: [0.0; CABLES],
            duty: [0.0; CABLES],
            supply_v: [0.0; UNITS],
            status: [0; UNITS],
        }
    }

    /// Looks at the drives' replies: units first, before the odometry uses them. True for a unit that had been lost and is back.
    pub fn units(&mut self, config: &CoreConfig, input: &MotorInput, found: &mut Faults) -> [bool; UNITS] {
        let mut back = [false; UNITS];
        let patience = config.cycles(RESYNC_S).max(LOST_CYCLES);
        for (unit, back) in back.iter_mut().enumerate().take(config.unit_count) {
            let was_lost = self.silent[unit] >= LOST_CYCLES || self.resync[unit] >= patience;
            match input.unit[unit] {
                MotorInput::UNIT_OK => {
                    *back = was_lost;
                    (self.silent[unit], self.resync[unit]) = (0, 0);
                }
                MotorInput::UNIT_RESYNC => self.resync[unit] = self.resync[unit].saturating_add(1),
                MotorInput::UNIT_REBOOTED => {
                    (self.silent[unit], self.resync[unit]) = (0, 0);
                    found.unit(MotorAuthority::FAULT_UNIT_REBOOT, unit);
                }
                _ => self.silent[unit] = self.silent[unit].saturating_add(1),
            }
            if self.silent[unit] >= LOST_CYCLES || self.resync[unit] >= patience {
                found.unit(MotorAuthority::FAULT_LOST_UNIT, unit);
            }
            if input.slow_fresh[unit] == 1 {
                self.status[unit] = input.status[unit];
                // Not a number: not read yet.
                if plausible(input.supply_v[unit]) {
                    self.supply_v[unit] = input.supply_v[unit];
                    count(&mut self.low_supply[unit], self.supply_v[unit] < config.supply_min_v);
                }
            }
            if self.low_supply[unit] >= SUPPLY_READINGS {
                found.unit(MotorAuthority::FAULT_SUPPLY, unit);
            }
            let status = Status(self.status[unit]);
            if status.has(Status::EMERGENCY_STOP) {
                found.unit(MotorAuthority::FAULT_EMERGENCY_INPUT, unit);
            }
            if status.has(Status::ERRORS & !Status::EMERGENCY_STOP) {
                found.unit(MotorAuthority::FAULT_DRIVE_ERROR, unit);
            }
        }
        back
    }

    /// Looks at each cable. `velocity_m_s` is the measured one; `fresh` tells whether it is of this cycle.
    pub fn cables(
        &mut self,
        config: &CoreConfig,
        input: &MotorInput,
        situation: &Situation,
        velocity_m_s: &[f64; CABLES],
        fresh: &[bool; CABLES],
        found: &mut Faults,
    ) {
        let keep = libm::exp(-config.period_s / EXCUSE_S);
        let tolerance = RUNAWAY_M_S + RUNAWAY_SHARE * config.cable_speed_m_s;
        let strongest = config.robot.tension_limits_n()[1] * TENSION_FACTOR + TENSION_MARGIN_N;
        let tensions = &input.estimate_tension_n[situation.estimator * CABLES..][..CABLES];
        let estimate_valid = input.estimate_valid[situation.estimator] == 1
            && input.estimate_cycle[situation.estimator].checked_add(1) == Some(input.header.cycle);
        for i in 0..config.cable_count() {
            let unit = config.unit_of_cable[i];
            if input.slow_fresh[unit] == 1 && plausible(input.current_a[i]) && plausible(input.duty[i]) {
                self.current_a[i] = input.current_a[i];
                self.duty[i] = input.duty[i];
            }
            let (sent, v) = (situation.sent_m_s[i], velocity_m_s[i]);
            self.excuse_high[i] = sent.max(sent + (self.excuse_high[i] - sent) * keep);
            self.excuse_low[i] = sent.min(sent + (self.excuse_low[i] - sent) * keep);
            let driven = situation.energised && !situation.released[i];
            // Without this cycle's reading a counter stays where it is: it neither proves nor excuses.
            if fresh[i] {
                let still = v.abs() < STALL_SHARE * sent.abs();
                let pushing = self.duty[i].abs() > config.stall_duty;
                count(&mut self.stalled[i], driven && sent.abs() > STALL_COMMAND_M_S && still && pushing);
                let wild = v > self.excuse_high[i] + tolerance || v < self.excuse_low[i] - tolerance;
                count(&mut self.runaway[i], driven && wild);
            }
            if self.stalled[i] >= config.stall_cycles {
                found.cable(MotorAuthority::FAULT_STALL, i);
            }
            if self.runaway[i] >= config.stall_cycles {
                found.cable(MotorAuthority::FAULT_RUNAWAY, i);
            }
            count(&mut self.hot[i], driven && self.current_a[i].abs() > config.current_limit_a);
            if self.hot[i] >= config.stall_cycles {
                found.cable(MotorAuthority::FAULT_OVER_CURRENT, i);
            }
            // The most a line at its limit can draw at this speed: reeling in against the whole friction of the gear.
            let motor = config.robot.motor();
            let most = (strongest * (1.0 + motor.gear_friction) + motor.coulomb_n + motor.viscous_n_s_m * v.abs())
                / motor.force_constant_n_a;
            count(&mut self.straining[i], driven && self.current_a[i].abs() > most);
            if estimate_valid && tensions[i].is_finite() {
                count(&mut self.slack[i], situation.following && tensions[i] < config.slack_n);
                count(&mut self.tight[i], situation.following && tensions[i] > strongest);
            }
            if self.slack[i] >= config.slack_cycles {
                found.cable(MotorAuthority::FAULT_SLACK, i);
            }
            if self.tight[i] >= config.slack_cycles || self.straining[i] >= config.slack_cycles {
                found.cable(MotorAuthority::FAULT_OVER_TENSION, i);
            }
        }
    }

    /// Forgets what persisted, after a reset.
    pub fn forget(&mut self) {
        for counters in
            [&mut self.stalled, &mut self.runaway, &mut self.slack, &mut self.tight, &mut self.hot, &mut self.straining]
        {
            *counters = [0; CABLES];
        }
    }

    /// Last current of a motor, A.
    #[must_use]
    pub fn current_a(&self, cable: usize) -> f64 {
        self.current_a[cable]
    }

    /// Last output of a drive, -1 to 1.
    #[must_use]
    pub fn duty(&self, cable: usize) -> f64 {
        self.duty[cable]
    }

    /// Last supply voltages, V.
    #[must_use]
    pub fn supply_v(&self) -> [f64; UNITS] {
        self.supply_v
    }

    /// Last status bits.
    #[must_use]
    pub fn status(&self) -> [u32; UNITS] {
        self.status
    }
}

impl Default for Watch {
    fn default() -> Self {
        Self::new()
    }
}

/// A reading that the protocol can carry at all.
fn plausible(reading: f64) -> bool {
    reading.abs() < 1e4
}

fn count(counter: &mut u32, condition: bool) {
    *counter = if condition { counter.saturating_add(1) } else { 0 };
}

/// True where the position may be used as a length that has limits.
#[must_use]
pub fn lengths_mean_something(position: u8) -> bool {
    position != MotorState::POSITION_UNKNOWN
}
