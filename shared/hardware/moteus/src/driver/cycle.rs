//! One control cycle: command every unit and read its position, then read what the remaining time allows.

use drives::{Command, Error, Timed, UnitAnswer, UnitCommand, UnitReport, reply_text};
use serial::Transport;

use super::question::{Question, cycle};
use super::round::{Order, Plan, Plans, Reading};
use super::{Bus, MAX_UNITS};
use crate::codec::Mode;
use crate::status::STOP_PIN;

/// Rounds of a cycle: a unit in fault answers so, is stopped, and then holds.
const ROUNDS: usize = 3;
/// Least time from one question about what changes slowly to the next, ns: one in each cycle at up to 250 Hz, one in
/// every second cycle at 500 Hz. Faults of a cable show over tens of milliseconds.
const SLOW_EVERY_NS: u64 = 3_000_000;
/// A unit may read its encoder this much later than it was asked, ns, while the motor moves on.
const SAMPLE_JITTER_NS: u64 = 20_000_000;

/// Result of a cycle for each unit; `None` while it is open.
type Outcomes = [Option<Result<(), Error>>; MAX_UNITS];

impl<T: Transport> Bus<T> {
    /// Places for the answers of an exchange.
    pub fn blank_answers(&self) -> Vec<UnitAnswer> {
        let outcome = Err(Error::Resynchronising { port: self.port() });
        vec![UnitAnswer { outcome, report: UnitReport::default() }; self.units.len()]
    }

    pub(super) fn exchange_all(&mut self, commands: &[UnitCommand], deadline_ns: u64, answers: &mut [UnitAnswer]) {
        let mut outcomes: Outcomes = [const { None }; MAX_UNITS];
        let ready = if self.transport.now_ns() >= deadline_ns {
            Err(Error::TooLate { port: self.port() })
        } else {
            self.connect().and_then(|()| self.discard())
        };
        match ready {
            Err(error) => outcomes.iter_mut().for_each(|outcome| *outcome = Some(Err(error.clone()))),
            Ok(()) => self.rounds(commands, deadline_ns, &mut outcomes),
        }
        for (index, (answer, outcome)) in answers.iter_mut().zip(outcomes).enumerate().take(self.units.len()) {
            answer.outcome = outcome.unwrap_or_else(|| Err(self.interlocked(index)));
            if let Some(unit) = self.units.get(index) {
                answer.report = unit.report;
            }
        }
    }

    fn rounds(&mut self, commands: &[UnitCommand], deadline_ns: u64, outcomes: &mut Outcomes) {
        let command = |index: usize| commands.get(index).copied().unwrap_or_default();
        for round in 0..ROUNDS {
            let mut plans: Plans = [None; MAX_UNITS];
            for index in 0..self.units.len() {
                if outcomes[index].is_none() {
                    match self.plan(index, command(index)) {
                        Ok(plan) => plans[index] = Some(plan),
                        Err(error) => outcomes[index] = Some(Err(error)),
                    }
                }
            }
            let count = plans.iter().flatten().count();
            if count == 0 || (round > 0 && self.transport.now_ns() + self.likely_ns(count) > deadline_ns) {
                return;
            }
            let results = self.round(&plans, deadline_ns, true);
            for (index, result) in results.into_iter().enumerate() {
                let (Some(result), Some(plan)) = (result, plans[index]) else { continue };
                outcomes[index] = match result {
                    Ok(reading) => {
                        self.answered(index);
                        self.conclude(index, command(index), plan, &reading)
                    }
                    Err(error) => {
                        self.unanswered(index, &error);
                        Some(Err(error))
                    }
                };
            }
        }
    }

    /// What a unit is sent for a command.
    fn plan(&self, index: usize, command: UnitCommand) -> Result<Plan, Error> {
        if let Some(error) = self.not_ready(index) {
            return Err(error);
        }
        let Some(unit) = self.units.get(index) else { return Ok(Plan::QUERY) };
        let [command, _] = command;
        Ok(match command {
            _ if unit.suspect.is_some() => Plan::QUERY,
            None => Plan::QUERY,
            Some(Command::Release) => Plan::order(Order::Stop),
            // Without the constant a torque releases the motor.
            Some(Command::Torque(_)) if unit.config.torque_constant_n_m_a <= 0.0 => Plan::order(Order::Stop),
            Some(_) if unit.pins & STOP_PIN != 0 => Plan::order(Order::Stop),
            Some(command) if command.moves() && (unit.setup.is_interlocked() || unit.mode.is_latched()) => Plan::QUERY,
            Some(_) if unit.mode.is_latched() => Plan::order(Order::Stop),
            Some(Command::Velocity(counts_s)) => Plan::order(Order::Velocity(velocity(counts_s))),
            Some(Command::Torque(current_a)) => {
                Plan::order(Order::Torque(torque(current_a, unit.config.torque_constant_n_m_a)))
            }
        })
    }

    /// Uses the answer of a cycle; `None` where the unit needs another round.
    fn conclude(
        &mut self,
        index: usize,
        commands: UnitCommand,
        plan: Plan,
        reading: &Reading,
    ) -> Option<Result<(), Error>> {
        if let Err(error) = self.use_cycle(index, reading) {
            return Some(Err(error));
        }
        let [command, second] = commands;
        let pressed = self.units.get(index).is_some_and(|unit| unit.pins & STOP_PIN != 0);
        let moves = command.is_some_and(Command::moves);
        let unit = self.units.get_mut(index)?;
        let Some(order) = plan.order else {
            unit.setup.set_interlocked(unit.setup.is_interlocked() || moves && unit.mode.is_latched());
            return Some(if command.is_some() { Err(self.interlocked(index)) } else { Ok(()) });
        };
        if !self.has_watchdog(index, reading) {
            return Some(Err(self.lost_watchdog(index, reading)));
        }
        let unit = self.units.get_mut(index)?;
        unit.doubtful = false;
        match order {
            Order::Stop => {
                // The mode in the answer is that of before the stop.
                unit.mode = Mode::STOPPED;
                if matches!(command, Some(Command::Velocity(_))) && !pressed {
                    return None;
                }
            }
            _ if unit.mode.is_latched() => {
                // The next cycle asks once more before it concludes that the unit needs a stop.
                return if moves { Some(Err(self.interlocked(index))) } else { None };
            }
            // The contact opened: another round sends the stop.
            _ if pressed => {
                unit.setup.set_interlocked(unit.setup.is_interlocked() || moves);
                return None;
            }
            Order::Velocity(_) | Order::Torque(_) => {}
        }
        // A torque that was not sent as one.
        let torque = matches!(command, Some(Command::Torque(_))) && order == Order::Stop && !pressed;
        unit.setup.set_interlocked(moves && (unit.setup.is_interlocked() || pressed || torque));
        Some(match (torque, second) {
            (true, _) => Err(self.error(index, |port, unit| Error::Unsupported { port, unit, what: "torque command" })),
            (_, Some(_)) => {
                Err(self.error(index, |port, unit| Error::Unsupported { port, unit, what: "second motor" }))
            }
            _ if moves && pressed => Err(self.interlocked(index)),
            _ => Ok(()),
        })
    }

    /// The unit did not read the watchdog's time back. If it does so twice, it is stopped and set up again.
    fn lost_watchdog(&mut self, index: usize, reading: &Reading) -> Error {
        self.counters.wrong_acks += 1;
        let got_ms = reading.values[cycle::TIMEOUT].unwrap_or(0).max(0).cast_unsigned();
        if let Some(unit) = self.units.get_mut(index) {
            if !std::mem::replace(&mut unit.doubtful, true) {
                let asked = drives::CommandName { words: "set time limit", code: None };
                let said = reply_text(format_args!("{got_ms} ms"));
                return self.error(index, |port, unit| Error::Unexpected { port, unit, asked, said });
            }
            unit.setup.set_up_again();
        }
        let wanted_ms = self.units.get(index).map_or(0, |unit| u32::from(unit.config.watchdog_ms));
        self.error(index, |port, unit| Error::WatchdogRefused { port, unit, wanted_ms, got_ms })
    }

    fn interlocked(&self, index: usize) -> Error {
        self.error(index, |port, unit| Error::Interlocked { port, unit })
    }

    /// Uses mode, stop contact and position of an answer.
    pub(super) fn use_cycle(&mut self, index: usize, reading: &Reading) -> Result<(), Error> {
        let Some(unit) = self.units.get_mut(index) else { return Ok(()) };
        let mode = Mode(reading.values[cycle::MODE].map_or(i8::MIN, |mode| mode as i8));
        // A contact that cannot be read is open.
        let pins = reading.values[cycle::PINS].unwrap_or(STOP_PIN);
        let changed = mode != unit.mode && (mode.is_latched() || unit.mode.is_latched()) || pins != unit.pins;
        (unit.mode, unit.pins) = (mode, pins);
        if changed {
            self.state_status(index, reading.at_ns);
        }
        self.use_position(index, reading.values[cycle::POSITION], reading.at_ns)?;
        self.use_second(index, reading)
    }

    fn use_position(&mut self, index: usize, raw: Option<i32>, at_ns: u64) -> Result<(), Error> {
        let asked = drives::CommandName { words: "read position", code: None };
        let Some(raw) = raw.filter(|raw| raw.unsigned_abs() < i32::MAX.unsigned_abs()) else {
            let said = match raw {
                None => reply_text(format_args!("no position")),
                Some(_) => reply_text(format_args!("21474.8 turns, where it ends")),
            };
            return Err(self.error(index, |port, unit| Error::Unexpected { port, unit, asked, said }));
        };
        let Some(unit) = self.units.get_mut(index) else { return Ok(()) };
        let report = &mut unit.report;
        let Some(last) = unit.last_raw else {
            if report.setups == 0 && report.reboots == 0 {
                report.counts.value = [i64::from(raw), 0];
            }
            report.counts.at_ns = at_ns;
            unit.last_raw = Some(raw);
            return Ok(());
        };
        let moved = i64::from(raw) - i64::from(last);
        let since_ns = at_ns.saturating_sub(report.counts.at_ns) + SAMPLE_JITTER_NS;
        if !unit.config.bound.explains(moved as f64, since_ns) {
            if !std::mem::replace(&mut unit.held_back, true) {
                return Err(self.error(index, |port, unit| Error::EncoderJump { port, unit, axis: 0, counts: moved }));
            }
            // The clock shows that the unit has not restarted; whether the count is credible is for the caller to
            // judge.
            report.jumps += 1;
        }
        report.counts = Timed { value: [report.counts.value[0] + moved, 0], at_ns };
        (unit.last_raw, unit.held_back) = (Some(raw), false);
        Ok(())
    }

    /// Brings units back, and reads what changes slowly from those in use.
    pub(super) fn spend_time(&mut self, deadline_ns: u64) {
        self.read_stop();
        if self.transport.now_ns() >= deadline_ns || self.connect().is_err() {
            return;
        }
        self.bring_back(deadline_ns);
        let mut plans: Plans = [None; MAX_UNITS];
        for (plan, unit) in plans.iter_mut().zip(&self.units) {
            let ready = unit.setup.is_ready() && unit.suspect.is_none() && !unit.setup.is_quiet();
            *plan = ready.then_some(Plan { order: None, question: Question::Slow });
        }
        let count = plans.iter().flatten().count();
        let now_ns = self.transport.now_ns();
        if count == 0 || now_ns < self.slow_ns + SLOW_EVERY_NS {
            return;
        }
        let fits = now_ns + self.likely_slow_ns(count) <= deadline_ns;
        self.counters.left_out += u64::from(!fits);
        if !self.overdue.is_due(fits, now_ns) {
            return;
        }
        self.slow_ns = now_ns;
        if self.discard().is_ok() {
            let results = self.round(&plans, deadline_ns, true);
            for (index, result) in results.into_iter().enumerate() {
                if let Some(Ok(reading)) = result {
                    self.use_slow(index, &reading);
                }
            }
        }
    }
}

/// Torque on the wire, N m, as the bits of a float. What is no number is no torque.
fn torque(current_a: f64, torque_constant_n_m_a: f64) -> u32 {
    let torque_n_m = (current_a * torque_constant_n_m_a) as f32;
    if torque_n_m.is_finite() { torque_n_m.to_bits() } else { 0.0_f32.to_bits() }
}

/// Velocity on the wire. `as` saturates; the smallest integer is no velocity, and a NaN is 0.
fn velocity(counts_s: f64) -> i32 {
    (counts_s.round() as i32).max(-i32::MAX)
}
