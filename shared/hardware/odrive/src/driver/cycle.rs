//! One control cycle: command every axis and read its position, then read what the remaining time allows.

use drives::{Command, CommandName, Error, Timed, UnitAnswer, UnitCommand, UnitReport, reply_text};
use serial::Transport;

use super::Bus;
use super::ask::Ask;
use super::batch::{Answers, Batch};
use crate::codec::{AXES, COUNTS_PER_TURN, Line, control, state};

/// Batches of a cycle: an axis that is disarmed shows it, its errors are read, then cleared, and arming takes a moment.
const ROUNDS: usize = 5;
/// A board may read its encoder this much later than it was asked, ns, while the motor moves on.
const SAMPLE_JITTER_NS: u64 = 20_000_000;
/// Positions beyond it have coarse steps, turns: a float of 24 bits.
const MOST_TURNS: f64 = 21_474.0;

impl<T: Transport> Bus<T> {
    /// Places for the answers of an exchange.
    pub fn blank_answers(&self) -> Vec<UnitAnswer> {
        let outcome = Err(Error::Resynchronising { port: self.port() });
        vec![UnitAnswer { outcome, report: UnitReport::default() }]
    }

    pub(super) fn exchange_board(&mut self, commands: &[UnitCommand], deadline_ns: u64, answers: &mut [UnitAnswer]) {
        let outcome = if self.transport.now_ns() >= deadline_ns {
            Err(Error::TooLate { port: self.port() })
        } else {
            let commands = commands.first().copied().unwrap_or_default();
            self.connect().and_then(|()| self.discard()).and_then(|()| self.rounds(commands, deadline_ns))
        };
        if let Some(answer) = answers.first_mut() {
            (answer.outcome, answer.report) = (outcome, self.report);
        }
    }

    fn rounds(&mut self, commands: UnitCommand, deadline_ns: u64) -> Result<(), Error> {
        if let Some(error) = self.not_ready() {
            return Err(error);
        }
        let moves = self.connected(commands).any(|(_, command)| command.moves());
        let refused = moves && self.setup.is_interlocked();
        let mut verdict = None;
        for round in 0..ROUNDS {
            let sent = if refused { self.hold_those_that_turn(commands) } else { commands };
            let batch = self.batch(sent);
            self.forget_controls(sent);
            let before = self.states;
            let lines = batch.orders.len() + batch.asks.len();
            if round > 0 && self.transport.now_ns() + self.likely_ns(lines) > deadline_ns {
                break;
            }
            let answers = match self.transact(&batch, "set velocity and read", deadline_ns) {
                Ok(answers) => answers,
                Err(error) => {
                    self.unanswered(&error);
                    return Err(error);
                }
            };
            self.use_controls(&answers);
            self.use_feedback(&answers)?;
            if batch.asks.contains(&Ask::Error(0)) {
                self.use_errors(&answers);
                self.tripped = false;
            }
            if refused {
                return Err(self.interlocked());
            }
            match self.obeyed(commands, &answers) {
                Ok(true) => return self.accepted(commands, moves),
                Ok(false) => {}
                // The command was changed on the wire, and dropped by the board.
                Err(error) => {
                    verdict = Some(error);
                    continue;
                }
            }
            let left = |(axis, command): (usize, Command)| {
                matches!(command, Command::Velocity(_))
                    && before[axis] == state::CLOSED_LOOP
                    && self.states[axis] != state::CLOSED_LOOP
            };
            self.tripped |= !moves && self.connected(commands).any(left);
            if moves {
                // Armed it was, and is not now: an error, the watchdog, or a restart.
                self.setup.set_interlocked(true);
                self.setup.doubt();
                return Err(self.interlocked());
            }
        }
        Err(verdict.unwrap_or_else(|| self.interlocked()))
    }

    /// Commands of the axes that have a motor.
    fn connected(&self, commands: UnitCommand) -> impl Iterator<Item = (usize, Command)> + use<T> {
        let axes = self.config.axes;
        commands.into_iter().enumerate().take(axes).filter_map(|(axis, command)| Some((axis, command?)))
    }

    /// Commands for a board on which motion is refused: one axis stopped by itself, and the other still has its
    /// velocity.
    fn hold_those_that_turn(&self, commands: UnitCommand) -> UnitCommand {
        let mut held = [None; AXES];
        for (axis, _) in self.connected(commands).filter(|&(axis, _)| self.states[axis] == state::CLOSED_LOOP) {
            held[axis] = Some(Command::HOLD);
        }
        held
    }

    /// What an axis has to control for a command; `None`: nothing, so that it turns freely.
    fn controlled(&self, command: Command) -> Option<u32> {
        match command {
            Command::Release => None,
            Command::Velocity(_) => Some(control::VELOCITY),
            // Without the constant a torque releases the motor.
            Command::Torque(_) => (self.config.torque_constant_n_m_a > 0.0).then_some(control::TORQUE),
        }
    }

    /// A command may change what an axis controls, or get lost.
    fn forget_controls(&mut self, commands: UnitCommand) {
        for (axis, command) in self.connected(commands) {
            if self.controls[axis] != self.controlled(command) {
                self.controls[axis] = None;
            }
        }
    }

    fn use_controls(&mut self, answers: &Answers) {
        for axis in self.axes() {
            if let Some(control) = answers.whole(Ask::Control(axis)) {
                self.controls[axis] = Some(control);
            }
        }
    }

    fn batch(&self, commands: UnitCommand) -> Batch {
        let mut batch = Batch::default();
        let wanted = |command: Command| self.controlled(command).is_some();
        // Only a command that does not move clears errors; it would arm an axis that stopped by itself.
        let clear = !self.tripped
            && self.connected(commands).all(|(_, command)| !command.moves())
            && self.connected(commands).any(|(axis, command)| {
                wanted(command) && self.states[axis] != state::CLOSED_LOOP || self.errors[axis] != 0
            });
        for (axis, command) in self.connected(commands) {
            let wanted = self.controlled(command);
            match command {
                Command::Velocity(counts_s) => {
                    batch.orders.push(Line::Velocity(axis, velocity(counts_s)));
                    batch.asks.push(Ask::Velocity(axis));
                }
                Command::Torque(current_a) if wanted.is_some() => {
                    batch.orders.push(Line::Torque(axis, self.torque(current_a)));
                    batch.asks.push(Ask::Torque(axis));
                }
                _ => batch.orders.push(Line::Feed(axis)),
            }
            if wanted.is_some() && self.controls[axis] != wanted {
                batch.asks.push(Ask::Control(axis));
            }
        }
        if clear {
            // After the watchdogs were fed: they would report their error again at once.
            batch.orders.push(Line::ClearErrors);
        }
        for (axis, command) in self.connected(commands) {
            let needed = if wanted(command) { state::CLOSED_LOOP } else { state::IDLE };
            if self.states[axis] != needed && !self.tripped {
                batch.orders.push(Line::Write(axis, "requested_state", needed));
            }
        }
        for ask in [Ask::State, Ask::Feedback] {
            batch.asks.extend(self.axes().map(ask));
        }
        if self.tripped {
            // Before they are cleared: the reason belongs into the record.
            batch.asks.extend(self.axes().map(Ask::Error));
        }
        batch
    }

    /// True where every axis has its command and the state that it needs.
    fn obeyed(&mut self, commands: UnitCommand, answers: &Answers) -> Result<bool, Error> {
        let mut obeyed = true;
        for (axis, command) in self.connected(commands) {
            let Some(wanted) = self.controlled(command) else {
                obeyed &= self.states[axis] == state::IDLE;
                continue;
            };
            let (ask, sent, name) = match command {
                Command::Torque(current_a) => (Ask::Torque(axis), self.torque(current_a), "torque"),
                Command::Velocity(counts_s) => (Ask::Velocity(axis), velocity(counts_s), "velocity"),
                Command::Release => continue,
            };
            let got = answers.value(ask).map_or(f64::NAN, |[got, _]| got);
            if !same(sent, got) || self.controls[axis] != Some(wanted) {
                self.counters.wrong_acks += 1;
                let asked = CommandName { words: "set velocity or torque", code: None };
                let said = reply_text(format_args!("a {name} of {got}, in control mode {:?}", self.controls[axis]));
                return Err(self.error(|port, unit| Error::Unexpected { port, unit, asked, said }));
            }
            obeyed &= self.states[axis] == state::CLOSED_LOOP;
        }
        Ok(obeyed)
    }

    fn accepted(&mut self, commands: UnitCommand, moves: bool) -> Result<(), Error> {
        let lacks = |command| matches!(command, Command::Torque(_)) && self.controlled(command).is_none();
        let torque = self.connected(commands).any(|(_, command)| lacks(command));
        if self.connected(commands).next().is_some() && !moves {
            self.setup.set_interlocked(false);
        }
        let what = match (torque, commands.into_iter().skip(self.config.axes).any(|command| command.is_some())) {
            (true, _) => "torque command",
            (false, true) => "second motor",
            (false, false) => return Ok(()),
        };
        Err(self.error(|port, unit| Error::Unsupported { port, unit, what }))
    }

    fn interlocked(&self) -> Error {
        self.error(|port, unit| Error::Interlocked { port, unit })
    }

    /// Uses states, positions and speeds of an answer.
    pub(super) fn use_feedback(&mut self, answers: &Answers) -> Result<(), Error> {
        let mut raw = [0; AXES];
        let mut speeds_counts_s = [0.0; AXES];
        for axis in self.axes() {
            self.states[axis] = answers.whole(Ask::State(axis)).unwrap_or(0);
            let [turns, turns_s] = answers.value(Ask::Feedback(axis)).unwrap_or([f64::NAN; 2]);
            if turns.is_nan() || turns.abs() > MOST_TURNS {
                let asked = CommandName { words: "read position", code: None };
                let said = reply_text(format_args!("{turns} turns"));
                return Err(self.error(|port, unit| Error::Unexpected { port, unit, asked, said }));
            }
            raw[axis] = (turns * COUNTS_PER_TURN).round() as i64;
            speeds_counts_s[axis] = turns_s * COUNTS_PER_TURN;
        }
        let at_ns = answers.at_ns;
        self.report.speeds_counts_s = Timed { value: speeds_counts_s, at_ns };
        self.use_counts(raw, at_ns)
    }

    fn use_counts(&mut self, raw: [i64; AXES], at_ns: u64) -> Result<(), Error> {
        let Some(last) = self.last_raw else {
            if self.report.setups == 0 && self.report.reboots == 0 {
                self.report.counts.value = raw;
            }
            self.report.counts.at_ns = at_ns;
            self.last_raw = Some(raw);
            return Ok(());
        };
        let moved: [i64; AXES] = std::array::from_fn(|axis| raw[axis] - last[axis]);
        let passed_ns = at_ns.saturating_sub(self.report.counts.at_ns);
        if !self.motion.is_sure(self.config.bound, moved, passed_ns, at_ns) {
            self.counters.garbled += 1;
            let asked = CommandName { words: "read position", code: None };
            let said = reply_text(format_args!("an abrupt change, read again"));
            return Err(self.error(|port, unit| Error::Unexpected { port, unit, asked, said }));
        }
        let since_ns = passed_ns + SAMPLE_JITTER_NS;
        let beyond = moved.iter().position(|&counts| !self.config.bound.explains(counts as f64, since_ns));
        if let Some(axis) = beyond {
            if !std::mem::replace(&mut self.held_back, true) {
                // A board that has restarted begins at zero, which looks just like this: its watchdog tells.
                self.setup.doubt();
                let counts = moved[axis];
                return Err(self.error(|port, unit| Error::EncoderJump { port, unit, axis, counts }));
            }
            // It has not restarted; whether the count is credible is for the caller to judge.
            self.report.jumps += 1;
            self.motion.forget();
        } else {
            self.motion.record(moved, passed_ns);
        }
        for (total, moved) in self.report.counts.value.iter_mut().zip(moved) {
            *total += moved;
        }
        self.report.counts.at_ns = at_ns;
        (self.last_raw, self.held_back) = (Some(raw), false);
        Ok(())
    }

    /// Brings the board back, and reads what changes slowly.
    pub(super) fn spend_time(&mut self, deadline_ns: u64) {
        self.read_stop();
        if self.transport.now_ns() >= deadline_ns || self.connect().is_err() {
            return;
        }
        self.bring_back(deadline_ns);
        if !self.setup.is_ready() || self.setup.is_quiet() {
            return;
        }
        let mut batch = Batch::default();
        for axis in self.axes() {
            batch.asks.push(Ask::Error(axis));
            batch.asks.push(Ask::Current(axis));
        }
        batch.asks.push(Ask::Supply);
        batch.asks.push(Ask::WatchdogOn(0));
        let now_ns = self.transport.now_ns();
        let fits = now_ns + self.likely_ns(batch.asks.len()) <= deadline_ns;
        self.counters.left_out += u64::from(!fits);
        if !self.overdue.is_due(fits, now_ns) {
            return;
        }
        if self.discard().is_ok()
            && let Ok(answers) = self.transact(&batch, "read supply and errors", deadline_ns)
        {
            self.use_slow(&answers);
            if answers.whole(Ask::WatchdogOn(0)) != Some(1) {
                self.setup.doubt();
            }
        }
    }
}

impl<T> Bus<T> {
    /// Torque on the wire. What is no number is no torque.
    fn torque(&self, current_a: f64) -> i32 {
        velocity(current_a * self.config.torque_constant_n_m_a * COUNTS_PER_TURN)
    }
}

/// Velocity on the wire. `as` saturates, and a NaN is 0.
fn velocity(counts_s: f64) -> i32 {
    (counts_s.round() as i32).max(-i32::MAX)
}

/// True where the board, which computes with floats of 24 bits and states nine characters, can read `wanted` back as
/// `got` turns per second.
fn same(wanted: i32, got: f64) -> bool {
    let wanted = f64::from(wanted) / COUNTS_PER_TURN;
    let step = if wanted.abs() < 10.0 { 1e-6 } else { wanted.abs() * 1e-6 };
    (wanted - got).abs() <= step + wanted.abs() / f64::from(1 << 23)
}
