//! Bringing units into use.

use std::fmt::Write as _;

use arrayvec::ArrayString;
use drives::{ASK_SILENT_EVERY_NS, BABBLE_NS, Error, PAUSE_NS, SILENT_AFTER, Timed};
use serial::Transport;

use super::question::{FIRMWARE, Question, cycle, slow};
use super::round::{Order, Plan, Plans, Reading};
use super::{Bus, MAX_UNITS, Phase};
use crate::codec::Mode;
use crate::status::{native, neutral};

/// Time in which a unit has to be without an answer to be silent, ns: an adapter may be slow for a while.
const SILENT_NS: u64 = 250_000_000;
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
            let plans = self.next_steps(now_ns);
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
                        self.step(unit, &reading);
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

    fn next_steps(&mut self, now_ns: u64) -> Plans {
        let mut plans = [None; MAX_UNITS];
        for (plan, unit) in plans.iter_mut().zip(&mut self.units) {
            if now_ns < unit.due_ns {
                continue;
            }
            *plan = match unit.phase {
                _ if unit.suspect.is_some() => Some(Plan::QUERY),
                Phase::Recognise => Some(Plan::QUERY),
                Phase::Identify { .. } => Some(Plan { order: None, question: Question::Identity }),
                Phase::SetWatchdog => Some(Plan::order(Order::Stop)),
                Phase::Readings => Some(Plan { order: None, question: Question::Slow }),
                Phase::Unusable { due_ns, .. } if now_ns >= due_ns => {
                    unit.phase = Phase::SetWatchdog;
                    Some(Plan::order(Order::Stop))
                }
                Phase::Unusable { .. } | Phase::Ready => None,
            };
        }
        plans
    }

    /// Uses the answer to a step of the setup.
    fn step(&mut self, index: usize, reading: &Reading) {
        let Some(unit) = self.units.get(index) else { return };
        let phase = unit.phase;
        let whole = unit.report.setups == 0 || unit.interlocked;
        match phase {
            Phase::Ready => drop(self.use_cycle(index, reading)),
            Phase::Recognise => {
                let same = self.has_watchdog(index, reading);
                let restarted = !same && self.units.get(index).is_some_and(|unit| unit.watchdog_set);
                // The position of a unit that has restarted continues no counts.
                if !restarted {
                    drop(self.use_cycle(index, reading));
                }
                let Some(unit) = self.units.get_mut(index) else { return };
                if unit.report.setups == 0 && !unit.watchdog_set {
                    unit.report.was_alive = same;
                }
                if restarted {
                    self.has_restarted(index);
                } else if same && !whole {
                    unit.restart_counted = false;
                    self.set_phase(index, Phase::Ready);
                } else {
                    unit.watchdog_set |= same;
                    self.set_phase(index, Phase::Identify { same });
                }
            }
            Phase::Identify { same } => {
                let firmware = reading.values[FIRMWARE].map(firmware);
                if let Some(unit) = self.units.get_mut(index) {
                    unit.firmware = firmware;
                    unit.phase = if same { Phase::Readings } else { Phase::SetWatchdog };
                }
            }
            Phase::SetWatchdog => {
                drop(self.use_cycle(index, reading));
                let got_ms = reading.values[cycle::TIMEOUT].unwrap_or(0).max(0).cast_unsigned();
                let kept = self.has_watchdog(index, reading);
                let due_ns = self.transport.now_ns() + ASK_SILENT_EVERY_NS;
                if let Some(unit) = self.units.get_mut(index) {
                    // The mode is that of before the stop.
                    unit.mode = Mode::STOPPED;
                    unit.watchdog_set = kept;
                    unit.phase = if kept { Phase::Readings } else { Phase::Unusable { got_ms, due_ns } };
                }
            }
            Phase::Readings => {
                self.use_slow(index, reading);
                if let Some(unit) = self.units.get_mut(index) {
                    unit.report.setups += 1;
                    unit.restart_counted = false;
                    unit.phase = Phase::Ready;
                }
            }
            Phase::Unusable { .. } => {}
        }
    }

    fn set_phase(&mut self, index: usize, phase: Phase) {
        if let Some(unit) = self.units.get_mut(index) {
            unit.phase = phase;
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
        unit.pins = reading.values[slow::PINS].unwrap_or(0);
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
            (unit.interlocked, unit.held_back) = (true, false);
            // Its counts are unrelated to those before the restart: the totals stay where they were.
            unit.last_raw = None;
            // It may have executed a command before its clock showed the restart.
            unit.phase = Phase::SetWatchdog;
            (unit.failed, unit.due_ns, unit.silent) = (0, 0, false);
            // Counted once, however many attempts the setup takes.
            let was_set = std::mem::take(&mut unit.watchdog_set) || unit.report.setups > 0;
            if was_set && !std::mem::replace(&mut unit.restart_counted, true) {
                unit.report.reboots += 1;
            }
        }
    }

    pub(super) fn answered(&mut self, index: usize) {
        if let Some(unit) = self.units.get_mut(index) {
            (unit.failed, unit.due_ns, unit.quiet, unit.silent) = (0, 0, false, false);
        }
    }

    /// Records a round without a usable answer.
    pub(super) fn unanswered(&mut self, index: usize, error: &Error) {
        let now_ns = self.transport.now_ns();
        let Some(unit) = self.units.get_mut(index) else { return };
        // Any other error is an answer.
        if !matches!(error, Error::NoAnswer { .. } | Error::Garbled { .. }) {
            return;
        }
        if unit.failed == 0 {
            unit.failing_from_ns = now_ns;
        }
        unit.failed += 1;
        unit.quiet = matches!(error, Error::NoAnswer { .. });
        if unit.failed >= SILENT_AFTER && now_ns.saturating_sub(unit.failing_from_ns) >= SILENT_NS {
            unit.silent = true;
            (unit.phase, unit.interlocked) = (Phase::Recognise, true);
            unit.due_ns = now_ns + ASK_SILENT_EVERY_NS;
        }
    }

    /// Reason why a unit is not in use.
    pub(super) fn not_ready(&self, index: usize) -> Option<Error> {
        let unit = self.units.get(index)?;
        let now_ns = self.transport.now_ns();
        if unit.silent {
            let noisy = self.noisy_from_ns.is_some_and(|from_ns| now_ns.saturating_sub(from_ns) > BABBLE_NS);
            return Some(self.error(index, |port, unit| self.instead.error(port, unit, noisy)));
        }
        let wanted_ms = u32::from(unit.config.watchdog_ms);
        match unit.phase {
            Phase::Ready => None,
            Phase::Unusable { got_ms, .. } => {
                Some(self.error(index, |port, unit| Error::WatchdogRefused { port, unit, wanted_ms, got_ms }))
            }
            _ => Some(self.error(index, |port, unit| Error::Preparing { port, unit })),
        }
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
