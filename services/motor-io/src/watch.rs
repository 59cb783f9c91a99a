//! Faults of drives and cables, detected cycle by cycle: stall, runaway, slack, over-tension, over-current, supply,
//! drive errors, lost units.
//!
//! A cable without load shows in two ways. Estimated tensions come from lengths, and a broken cable keeps its length,
//! so they are not enough. While a cable is reeled in, the current of its motor is compared with the current of the
//! estimated tension (`load.rs`). While it is paid out, the gear carries nearly all of the tension and the current says
//! little; there, a cable that does not move although it is paid out is one that nothing pulls. At standstill neither
//! shows.
//!
//! Each condition must persist for a number of cycles, because one reading is noise. Time is counted in cycles, so that
//! a short stop of the computer does not count as a fault of the robot. Where the number stands for a time, it is that
//! of 250 Hz at higher rates ([`CoreConfig::lasting`]).

use crate::load::{LoadEvidence, Winding};
use crate::settings::CoreConfig;
use drives::DriveStatus;
use messages::faults::Faults;
use messages::{CABLES, MotorAuthority, MotorInput, UNITS};

/// Cycles without a port or a unit before it is lost: one may be noise, two a coincidence. These are attempts and no
/// time; answers that are only late or garbled have `RESYNC_S`.
const LOST_CYCLES: u32 = 3;
/// Longest resynchronisation, s. It usually takes 50 to 100 ms (silence, then a fence), and several times that where
/// answers are late.
const RESYNC_S: f64 = 0.4;
/// Longest time for which a lack of processor time, or a port that does not return, excuses missing replies and low
/// tensions, s.
const AWAY_S: f64 = 3.0;
/// Least commanded velocity at which a cable that does not move is a stall, m/s.
const STALL_COMMAND_M_S: f64 = 0.01;
/// Share of its command below which a cable counts as not moving.
const STALL_SHARE: f64 = 0.05;
/// A tension above the robot's limit by this factor and margin is a fault: the planner plans up to the limit.
const TENSION_FACTOR: f64 = 1.25;
const TENSION_MARGIN_N: f64 = 2.0;
/// Readings of a low supply before it is a fault: a starting motor pulls it down for a moment.
const SUPPLY_READINGS: u32 = 5;

/// Time over which a velocity is smoothed to measure its change, s: the encoder's steps are 1 cm/s at 100 Hz.
const SMOOTHED_S: f64 = 0.1;
/// Least readings for a condition on a slowly read value, however long it lasts.
const LEAST_READINGS: u32 = 3;
/// Share of the current limit from which the motion slows down.
const EASE_CURRENT_SHARE: f64 = 0.9;
/// Least speed factor of a slowed motion: it must leave the condition, or reach the fault.
const EASE_LEAST: f64 = 0.1;

/// A condition on a value that is not read in every cycle: it lasts from its first reading until a reading contradicts
/// it.
#[derive(Debug, Clone, Copy, Default)]
struct Lasting {
    cycles: u32,
    readings: u32,
}

impl Lasting {
    /// Advances by one cycle; `reading` is the condition by a new reading, if there was one.
    fn advance(&mut self, reading: Option<bool>) {
        match reading {
            Some(true) => self.readings = self.readings.saturating_add(1),
            Some(false) => *self = Self::default(),
            None => {}
        }
        if self.readings > 0 {
            self.cycles = self.cycles.saturating_add(1);
        }
    }

    fn over(&self, cycles: u32) -> bool {
        self.cycles >= cycles && self.readings >= LEAST_READINGS
    }
}

/// State of the safety machine in this cycle, as far as the watch needs it.
#[derive(Debug, Clone, Copy)]
pub struct SafetySnapshot {
    /// The drives hold or move: faults count.
    pub energised: bool,
    /// The robot moves by command of a controller: slack counts.
    pub following: bool,
    /// Velocities sent in this cycle, m/s.
    pub sent_m_s: [f64; CABLES],
    /// Cables at duty 0.
    pub released: [bool; CABLES],
    /// Radius of each drum relative to that of the bare one, of which the motor model is.
    pub radius_ratio: [f64; CABLES],
    /// Least and largest velocity that commands explain, m/s.
    pub excused_m_s: [[f64; 2]; CABLES],
    /// The computer had no processor in this cycle for this process or for those that answer it, so a low estimated
    /// tension may come from late readings.
    pub starved: bool,
    /// The estimate slot in use.
    pub estimator: usize,
}

impl SafetySnapshot {
    /// True if the motor of this cable holds or moves it.
    fn drives(&self, cable: usize) -> bool {
        self.energised && !self.released[cable]
    }
}

/// Detector of faults of drives and cables.
#[derive(Debug, Clone)]
pub struct Watch {
    silent: [u32; UNITS],
    resync: [u32; UNITS],
    /// Cycles without an answer that the computer can have caused.
    away: [u32; UNITS],
    low_supply: [u32; UNITS],
    stalled: [Lasting; CABLES],
    runaway: [u32; CABLES],
    slack: [u32; CABLES],
    tight: [u32; CABLES],
    hot: [Lasting; CABLES],
    straining: [Lasting; CABLES],
    load: [LoadEvidence; CABLES],
    /// Smoothed velocity of each cable, m/s.
    smooth_m_s: [f64; CABLES],
    /// Factor for the speed of the motion.
    ease: f64,
    late: u32,
    /// Consecutive cycles in which this process was too late for each unit.
    late_unit: [u32; UNITS],
    /// Cycles in a row in which estimates could not be judged.
    unjudged: u32,
    current_a: [f64; CABLES],
    /// Cycles since each current was read.
    current_age: [u32; CABLES],
    duty: [f64; CABLES],
    supply_v: [f64; UNITS],
    status: [u32; UNITS],
}

impl Watch {
    /// A watch without readings.
    #[must_use]
    pub fn new() -> Self {
        Self {
            silent: [0; UNITS],
            resync: [0; UNITS],
            away: [0; UNITS],
            low_supply: [0; UNITS],
            stalled: [Lasting::default(); CABLES],
            runaway: [0; CABLES],
            slack: [0; CABLES],
            tight: [0; CABLES],
            hot: [Lasting::default(); CABLES],
            straining: [Lasting::default(); CABLES],
            load: [LoadEvidence::default(); CABLES],
            smooth_m_s: [0.0; CABLES],
            ease: 1.0,
            late: 0,
            late_unit: [0; UNITS],
            unjudged: 0,
            current_a: [0.0; CABLES],
            current_age: [u32::MAX; CABLES],
            duty: [0.0; CABLES],
            supply_v: [0.0; UNITS],
            status: [0; UNITS],
        }
    }

    /// Checks the drives' replies before the odometry uses them; returns true for each unit that was lost and is back.
    /// `starved`: the computer had no processor for this process, so a missing reply is no evidence against its unit.
    pub fn units(
        &mut self,
        config: &CoreConfig,
        input: &MotorInput,
        starved: bool,
        found: &mut Faults,
    ) -> [bool; UNITS] {
        let mut back = [false; UNITS];
        let late = input.unit[..config.unit_count].contains(&MotorInput::UNIT_LATE);
        count(&mut self.late, late);
        for (unit, back) in back.iter_mut().enumerate().take(config.unit_count) {
            let was_lost = self.is_lost(config, unit);
            let late = input.unit[unit] == MotorInput::UNIT_LATE;
            count(&mut self.late_unit[unit], late);
            match input.unit[unit] {
                MotorInput::UNIT_OK => {
                    *back = was_lost;
                    (self.silent[unit], self.resync[unit], self.away[unit]) = (0, 0, 0);
                }
                MotorInput::UNIT_REBOOTED => {
                    (self.silent[unit], self.resync[unit], self.away[unit]) = (0, 0, 0);
                    found.unit(MotorAuthority::FAULT_UNIT_REBOOT, unit);
                }
                // This process was late or did not receive the answer, or a driver of the kernel keeps the port.
                _ if late || starved => self.away[unit] = self.away[unit].saturating_add(1),
                MotorInput::UNIT_RESYNC | MotorInput::UNIT_SILENT => {
                    self.resync[unit] = self.resync[unit].saturating_add(1)
                }
                _ => self.silent[unit] = self.silent[unit].saturating_add(1),
            }
            if self.is_lost(config, unit) {
                found.unit(MotorAuthority::FAULT_LOST_UNIT, unit);
            }
            if has(input, unit, MotorInput::SLOW_STATUS) {
                self.status[unit] = input.status[unit];
            }
            if has(input, unit, MotorInput::SLOW_SUPPLY) {
                // NaN: not read yet.
                if plausible(input.supply_v[unit]) {
                    self.supply_v[unit] = input.supply_v[unit];
                    count(&mut self.low_supply[unit], self.supply_v[unit] < config.supply_min_v);
                }
            }
            if self.low_supply[unit] >= config.lasting(SUPPLY_READINGS) {
                found.unit(MotorAuthority::FAULT_SUPPLY, unit);
            }
            let status = DriveStatus(self.status[unit]);
            if status.has(DriveStatus::EMERGENCY_STOP) {
                found.unit(MotorAuthority::FAULT_EMERGENCY_INPUT, unit);
            }
            if status.has(DriveStatus::ERRORS & !DriveStatus::EMERGENCY_STOP) {
                found.unit(MotorAuthority::FAULT_DRIVE_ERROR, unit);
            }
        }
        back
    }

    fn is_lost(&self, config: &CoreConfig, unit: usize) -> bool {
        let patience = config.cycles(RESYNC_S).max(LOST_CYCLES);
        self.silent[unit] >= LOST_CYCLES || self.resync[unit] >= patience || self.away[unit] >= config.cycles(AWAY_S)
    }

    /// Checks each cable. `velocity_m_s` is measured; `fresh`: it is of this cycle.
    pub fn cables(
        &mut self,
        config: &CoreConfig,
        input: &MotorInput,
        situation: &SafetySnapshot,
        velocity_m_s: &[f64; CABLES],
        fresh: &[bool; CABLES],
        found: &mut Faults,
    ) {
        let strongest = config.robot.tension_limits_n()[1] * TENSION_FACTOR + TENSION_MARGIN_N;
        let tensions = &input.estimate_tension_n[situation.estimator * CABLES..][..CABLES];
        let estimate_valid = input.estimate_valid[situation.estimator] == 1
            && input.estimate_cycle[situation.estimator].checked_add(1) == Some(input.header.cycle);
        let (stall_cycles, slack_cycles) = (config.lasting(config.stall_cycles), config.lasting(config.slack_cycles));
        self.ease = 1.0;
        count(&mut self.unjudged, situation.starved);
        let judged = self.unjudged == 0 || self.unjudged >= config.cycles(AWAY_S);
        for i in 0..config.cable_count() {
            let (new_current, new_duty) = self.read(config, input, i);
            let (sent, v) = (situation.sent_m_s[i], velocity_m_s[i]);
            let driven = situation.drives(i);
            // Without a reading of this cycle the counters stay.
            if fresh[i] {
                self.motion(config, i, v, situation, new_duty);
            }
            if self.stalled[i].over(stall_cycles) {
                found.cable(MotorAuthority::FAULT_STALL, i);
                if sent > 0.0 {
                    // Nothing can hold back a cable that is paid out, so no load pulls this one.
                    found.cable(MotorAuthority::FAULT_SLACK, i);
                }
            }
            if self.runaway[i] >= stall_cycles {
                found.cable(MotorAuthority::FAULT_RUNAWAY, i);
            }
            let current = self.current_a[i].abs();
            self.hot[i].advance(new_current.then_some(driven && current > config.current_limit_a));
            if self.hot[i].over(stall_cycles) {
                found.cable(MotorAuthority::FAULT_OVER_CURRENT, i);
            }
            // Largest current of a cable at its limit at this speed: reeling in against the whole friction of the gear.
            let motor = config.robot.motor();
            let ratio = situation.radius_ratio[i];
            let friction_n = motor.coulomb_n + motor.viscous_n_s_m * v.abs() / ratio;
            let most = (strongest * ratio * (1.0 + motor.gear_friction) + friction_n) / motor.force_constant_n_a;
            self.straining[i].advance(new_current.then_some(driven && current > most));
            if situation.following {
                let limit = config.current_limit_a.min(most);
                self.ease = self.ease.min(headroom(current, EASE_CURRENT_SHARE * limit, limit));
            }
            if estimate_valid && tensions[i].is_finite() {
                if situation.following {
                    let [least, largest] = config.robot.tension_limits_n();
                    self.ease = self.ease.min(headroom(tensions[i], largest, strongest));
                    self.ease = self.ease.min(headroom(-tensions[i], -least, -config.slack_n));
                }
                if judged {
                    let ratio = situation.radius_ratio[i];
                    let winding = Winding {
                        tension_n: tensions[i] * ratio,
                        reel_in_m_s: -v / ratio,
                        // The velocity of a cable rises when it is reeled in more slowly.
                        slowing_m_s2: ((v - self.smooth_m_s[i]) / SMOOTHED_S).max(0.0) / ratio,
                        current_a: new_current.then_some(self.current_a[i]),
                    };
                    self.load(i, config, &winding, situation.following && driven);
                    count(&mut self.slack[i], situation.following && tensions[i] < config.slack_n);
                }
                count(&mut self.tight[i], situation.following && tensions[i] > strongest);
            }
            if self.slack[i] >= slack_cycles || self.load[i].is_unloaded() {
                found.cable(MotorAuthority::FAULT_SLACK, i);
            }
            if self.tight[i] >= slack_cycles || self.straining[i].over(slack_cycles) {
                found.cable(MotorAuthority::FAULT_OVER_TENSION, i);
            }
        }
    }

    /// Stores the plausible readings of a cable; returns whether there is a new current, and a new duty.
    fn read(&mut self, config: &CoreConfig, input: &MotorInput, i: usize) -> (bool, bool) {
        let unit = config.unit_of_cable[i];
        let new_current = has(input, unit, MotorInput::SLOW_CURRENT) && plausible(input.current_a[i]);
        let new_duty = has(input, unit, MotorInput::SLOW_DUTY) && plausible(input.duty[i]);
        count(&mut self.current_age[i], !new_current);
        if new_current {
            self.current_a[i] = input.current_a[i];
        }
        if new_duty {
            self.duty[i] = input.duty[i];
        }
        (new_current, new_duty)
    }

    /// Compares the measured velocity of a cable, m/s, with its command: stall and runaway.
    fn motion(&mut self, config: &CoreConfig, i: usize, v: f64, situation: &SafetySnapshot, new_duty: bool) {
        let sent = situation.sent_m_s[i];
        let driven = situation.drives(i);
        self.smooth_m_s[i] += (v - self.smooth_m_s[i]) * config.period_s / (SMOOTHED_S + config.period_s);
        let still = v.abs() < STALL_SHARE * sent.abs();
        let pushing = self.duty[i].abs() > config.stall_duty;
        let stalled = driven && sent.abs() > STALL_COMMAND_M_S && still && pushing;
        // The encoder is read in every cycle, the duty is known from its last reading.
        self.stalled[i].advance((new_duty || !stalled).then_some(stalled));
        let [low, high] = situation.excused_m_s[i];
        count(&mut self.runaway[i], driven && !(low..=high).contains(&v));
    }

    /// Clears persisting conditions after a reset.
    pub fn clear(&mut self) {
        for counters in [&mut self.runaway, &mut self.slack, &mut self.tight] {
            *counters = [0; CABLES];
        }
        for lasting in [&mut self.stalled, &mut self.hot, &mut self.straining] {
            *lasting = [Lasting::default(); CABLES];
        }
        self.load.iter_mut().for_each(LoadEvidence::clear);
    }

    /// Compares the current of a cable that the motion reels in with its estimated tension, both as on the bare drum.
    fn load(&mut self, i: usize, config: &CoreConfig, winding: &Winding, counts: bool) {
        if !counts {
            self.load[i].clear();
            return;
        }
        self.load[i].advance(config.robot.motor(), winding, config.period_s);
    }

    /// Factor for the speed of the motion, because a tension or a current approaches its fault; 1: full speed.
    #[must_use]
    pub fn slowdown(&self) -> f64 {
        self.ease
    }

    /// Consecutive cycles in which this process was too late for the drives.
    #[must_use]
    pub fn late(&self) -> u32 {
        self.late
    }

    /// Consecutive cycles in which it was too late for one and the same unit, the largest of all units.
    #[must_use]
    pub fn late_for_a_unit(&self) -> u32 {
        self.late_unit.iter().copied().max().unwrap_or(0)
    }

    /// Last current of a motor, A.
    #[must_use]
    pub fn current_a(&self, cable: usize) -> f64 {
        self.current_a[cable]
    }

    /// Cycles since the current of a motor was read; the largest number: never.
    #[must_use]
    pub fn current_age(&self, cable: usize) -> u32 {
        self.current_age[cable]
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

fn has(input: &MotorInput, unit: usize, value: u8) -> bool {
    input.slow_fresh[unit] & value != 0
}

/// Returns 1 up to `soft`, falling to [`EASE_LEAST`] at `hard`.
fn headroom(value: f64, soft: f64, hard: f64) -> f64 {
    if value <= soft || hard <= soft { 1.0 } else { ((hard - value) / (hard - soft)).clamp(EASE_LEAST, 1.0) }
}

/// True for a reading within the range of any drive; NaN is not.
fn plausible(reading: f64) -> bool {
    reading.abs() < 1e4
}

fn count(counter: &mut u32, condition: bool) {
    *counter = if condition { counter.saturating_add(1) } else { 0 };
}
