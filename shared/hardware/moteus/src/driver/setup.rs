//! Bringing units into use.

use std::fmt::Write as _;

use arrayvec::ArrayString;
use drives::{Error, PAUSE_NS, Recognised, SetupStep, Timed};
use serial::Transport;

use super::question::{FIRMWARE, Question, cycle, slow};
use super::round::{Order, Plan, Plans, Reading};
use super::{Bus, MAX_UNITS, Unit};
use crate::codec::Mode;
use crate::status::{native, neutral};

/// Step of the setup of each unit, if one is due.
type Steps = [Option<SetupStep>; MAX_UNITS];

/// Difference of a time limit that is read back, ms: it is a float in the unit, and cut off.
const TIME_STEP_MS: i32 = 1;
/// Least current at which power and current give the drive output, A: below, it is mostly noise.
const TELLING_A: f64 = 0.05;

impl<T: Transport> Bus<T> {
    /// Connects and sets up units as far as `deadline_ns` allows; `Ok` once every unit is in use.
    pub(super) fn settle_units(&mut self, deadline_ns: u64) -> Result<(), Error> {
        self.read_stop();
        self.connect()?;
        let now_ns = self.transport.now_ns();
        // One step is always begun: no call would otherwise be long enough at a low baud.
        self.bring_back(deadline_ns.max(now_ns + self.likely_ns(MAX_UNITS)));
        let verdict = (0..self.units.len()).find_map(|unit| self.not_ready(unit)).map_or(Ok(()), Err);
        if verdict.is_err() {
            let now_ns = self.transport.now_ns();
            self.transport.wait_until(deadline_ns.min(now_ns + PAUSE_NS).max(now_ns));
        }
        verdict
    }

    /// Advances every unit that is not in use, all at once, as far as the time allows.
    pub(super) fn bring_back(&mut self, deadline_ns: u64) {
        loop {
            let now_ns = self.transport.now_ns();
            let (plans, steps) = self.next_steps(now_ns);
            let count = plans.iter().flatten().count();
            if count == 0 || now_ns + self.likely_ns(count) > deadline_ns || self.discard().is_err() {
                return;
            }
            // A silent unit is asked once, and not repeatedly.
            let results = self.round(&plans, now_ns, false);
            let mut progress = false;
            for (unit, result) in results.into_iter().enumerate() {
                match result {
                    Some(Ok(reading)) => {
                        self.answered(unit);
                        self.step(unit, steps[unit], &reading);
                        progress = true;
                    }
                    Some(Err(error)) => self.unanswered(unit, &error),
                    None => {}
                }
            }
            if !progress {
                return;
            }
        }
    }

    /// What the units that are not in use are asked next, and for which step; no step for one whose clock is in doubt.
    fn next_steps(&mut self, now_ns: u64) -> (Plans, Steps) {
        let (mut plans, mut steps) = ([None; MAX_UNITS], [None; MAX_UNITS]);
        for ((plan, step), unit) in plans.iter_mut().zip(&mut steps).zip(&mut self.units) {
            if !unit.setup.is_asked(now_ns) {
                continue;
            }
            if unit.suspect.is_some() {
                *plan = Some(Plan::QUERY);
                continue;
            }
            *step = unit.setup.due(now_ns);
            *plan = match *step {
                Some(SetupStep::Recognise) => Some(Plan::QUERY),
                Some(SetupStep::Identify { .. }) => Some(Plan { order: None, question: Question::Identity }),
                Some(SetupStep::SetWatchdog) => Some(Plan::order(Order::Stop)),
                Some(SetupStep::Readings) => Some(Plan { order: None, question: Question::Slow }),
                None => None,
            };
        }
        (plans, steps)
    }

    /// Uses the answer to a step of the setup.
    fn step(&mut self, index: usize, step: Option<SetupStep>, reading: &Reading) {
        let kept = self.has_watchdog(index, reading);
        let now_ns = self.transport.now_ns();
        let Some(unit) = self.units.get_mut(index) else { return };
        match step {
            None if unit.setup.is_ready() => drop(self.use_cycle(index, reading)),
            None => {}
            Some(SetupStep::Recognise) => match unit.setup.recognised(kept, &mut unit.report) {
                Recognised::Same => drop(self.use_cycle(index, reading)),
                // The position of a unit that has restarted continues no counts.
                Recognised::Restarted => unit.forget_position(),
            },
            Some(SetupStep::Identify { same }) => {
                unit.firmware = reading.values[FIRMWARE].map(firmware);
                unit.setup.identified(same);
            }
            Some(SetupStep::SetWatchdog) => {
                let got_ms = reading.values[cycle::TIMEOUT].unwrap_or(0).max(0).cast_unsigned();
                unit.setup.watchdog_read(kept, got_ms, now_ns);
                drop(self.use_cycle(index, reading));
                if let Some(unit) = self.units.get_mut(index) {
                    // The mode is that of before the stop.
                    unit.mode = Mode::STOPPED;
                }
            }
            Some(SetupStep::Readings) => {
                unit.setup.finished(&mut unit.report);
                self.use_slow(index, reading);
            }
        }
    }

    /// True where the command that the unit has is limited to the watchdog's time.
    pub(super) fn has_watchdog(&self, index: usize, reading: &Reading) -> bool {
        let wanted_ms = self.units.get(index).map_or(0, |unit| i32::from(unit.config.watchdog_ms));
        reading.values[cycle::TIMEOUT].is_some_and(|got_ms| (got_ms - wanted_ms).abs() <= TIME_STEP_MS)
    }

    /// Uses readings that change slowly.
    pub(super) fn use_slow(&mut self, index: usize, reading: &Reading) {
        let at_ns = reading.at_ns;
        let value = |place: usize, step: f64| reading.values[place].map_or(f64::NAN, |steps| f64::from(steps) * step);
        let Some(unit) = self.units.get_mut(index) else { return };
        let (current_a, supply_v) = (value(slow::CURRENT, 0.001), value(slow::VOLTAGE, 0.1));
        let share = value(slow::POWER, 0.000_1) / (supply_v * current_a);
        // The share of the supply that a motor with brushes would get, with this power and this current.
        let duty = if current_a.abs() < TELLING_A || !share.is_finite() { 0.0 } else { share.clamp(-1.0, 1.0) };
        let report = &mut unit.report;
        report.currents_a = Timed { value: [current_a, 0.0], at_ns };
        report.duties = Timed { value: [duty, 0.0], at_ns };
        report.supply_v = Timed { value: supply_v, at_ns };
        report.temperature_c = Timed { value: value(slow::TEMPERATURE, 0.1), at_ns };
        unit.fault = reading.values[slow::FAULT].unwrap_or(0);
        self.state_status(index, at_ns);
    }

    pub(super) fn state_status(&mut self, index: usize, at_ns: u64) {
        let Some(unit) = self.units.get_mut(index) else { return };
        unit.report.status = Timed { value: neutral(unit.mode, unit.fault, unit.pins), at_ns };
        unit.report.native_status = native(unit.mode, unit.fault, unit.pins);
    }

    /// Records a restart of the unit: it is stopped, and its position is another one.
    pub(super) fn has_restarted(&mut self, index: usize) {
        if let Some(unit) = self.units.get_mut(index) {
            unit.setup.restarted(&mut unit.report);
            unit.forget_position();
        }
    }

    pub(super) fn answered(&mut self, index: usize) {
        if let Some(unit) = self.units.get_mut(index) {
            unit.setup.answered();
        }
    }

    /// Records a round without a usable answer.
    pub(super) fn unanswered(&mut self, index: usize, error: &Error) {
        let now_ns = self.transport.now_ns();
        if let Some(unit) = self.units.get_mut(index) {
            unit.setup.unanswered(error, now_ns);
        }
    }

    /// Reason why a unit is not in use.
    pub(super) fn not_ready(&self, index: usize) -> Option<Error> {
        let unit = self.units.get(index)?;
        let now_ns = self.transport.now_ns();
        let wanted_ms = u32::from(unit.config.watchdog_ms);
        unit.setup.not_ready(self.transport.name(), &unit.name, wanted_ms, &self.noise, now_ns)
    }
}

impl Unit {
    /// The unit's counts are unrelated to those before: the totals stay where they were.
    fn forget_position(&mut self) {
        (self.last_raw, self.last_second, self.held_back) = (None, None, false);
    }
}

/// Firmware version, byte by byte: 0x010304 is 1.3.4.
fn firmware(version: i32) -> ArrayString<48> {
    let [_, major, minor, micro] = version.to_be_bytes();
    let mut text = ArrayString::new();
    // Three numbers of one byte fit.
    let _ = write!(text, "moteus {major}.{minor}.{micro}");
    text
}
