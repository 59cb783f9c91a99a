//! One control cycle: command both motors and read their counters, then what the remaining time allows.

use drives::{Command, CommandName, Error, UnitAnswer, UnitCommand, UnitReport, reply_text};
use serial::Transport;

use super::Bus;
use super::parts::{Answers, Batch, Item};
use crate::codec::{AXES, FULL_SPEED, Line, Name, mode};

/// What a speed above the full one is called in messages.
const TOO_FAST: &str = "speed above its MXRPM; raise that in the maker's program, or lower cable_speed_limit_m_s";

/// Batches after an answer with an error in which a command is read back twice.
pub(super) const NOISY: u32 = 500;

/// Commands in the controller's terms.
#[derive(Debug, Clone, Copy, Default)]
struct Wanted {
    /// Thousandths of full speed.
    values: [i32; AXES],
    /// Operating modes.
    modes: [i32; AXES],
    /// Motors that are commanded.
    commanded: [bool; AXES],
    moves: bool,
    /// What the family does not have of them.
    lacks: Option<&'static str>,
}

impl<T: Transport> Bus<T> {
    /// Places for the answers of an exchange.
    pub fn blank_answers(&self) -> Vec<UnitAnswer> {
        let outcome = Err(Error::Resynchronising { port: self.port() });
        vec![UnitAnswer { outcome, report: UnitReport::default() }]
    }

    pub(super) fn exchange_controller(
        &mut self,
        commands: &[UnitCommand],
        deadline_ns: u64,
        answers: &mut [UnitAnswer],
    ) {
        let outcome = if self.transport.now_ns() >= deadline_ns {
            Err(Error::TooLate { port: self.port() })
        } else {
            let commands = commands.first().copied().unwrap_or_default();
            self.connect().and_then(|()| self.discard()).and_then(|()| self.command(commands, deadline_ns))
        };
        if let Some(answer) = answers.first_mut() {
            (answer.outcome, answer.report) = (outcome, self.report);
        }
    }

    fn command(&mut self, commands: UnitCommand, deadline_ns: u64) -> Result<(), Error> {
        if let Some(error) = self.not_ready() {
            return Err(error);
        }
        let wanted = self.wanted(commands);
        let refused = wanted.moves && self.setup.is_interlocked();
        let commanded = wanted.commanded != [false; AXES];
        if refused || !commanded {
            self.cycle(None, deadline_ns)?;
            return if refused { Err(self.interlocked()) } else { self.accepted(&wanted) };
        }
        if self.axes().any(|axis| wanted.commanded[axis] && wanted.modes[axis] != self.modes[axis]) {
            self.change_modes(&wanted, deadline_ns)?;
            if self.transport.now_ns() >= deadline_ns {
                return Err(Error::TooLate { port: self.port() });
            }
        }
        let answers = self.cycle(Some(&wanted), deadline_ns)?;
        let got = answers.pair(Name::Command, 0).unwrap_or([i32::MAX; AXES]);
        let again = answers.pair(Name::Command, 1).unwrap_or(got);
        if let Some(axis) = self.axes().find(|&axis| [got[axis], again[axis]] != [wanted.values[axis]; 2]) {
            self.noisy = NOISY;
            self.counters.wrong_acks += 1;
            let asked = CommandName { words: "set speeds (!M)", code: None };
            let said = reply_text(format_args!("CIS={} of motor {}", got[axis], axis + 1));
            return Err(self.error(|port, unit| Error::Unexpected { port, unit, asked, said }));
        }
        self.accepted(&wanted)
    }

    fn wanted(&self, commands: UnitCommand) -> Wanted {
        let mut wanted = Wanted { values: self.sent, modes: self.modes, ..Wanted::default() };
        for (axis, command) in commands.into_iter().enumerate() {
            let Some(command) = command else { continue };
            if axis >= self.config.axes {
                wanted.lacks = Some("second motor");
                continue;
            }
            wanted.commanded[axis] = true;
            wanted.moves |= command.moves();
            let (value, mode) = match command {
                Command::Velocity(counts_s) => {
                    // `as` saturates, and a NaN is 0.
                    let value = (counts_s / self.scales_counts_s[axis]).round() as i32;
                    if value.unsigned_abs() > FULL_SPEED.unsigned_abs() {
                        wanted.lacks = Some(TOO_FAST);
                    }
                    (value.clamp(-FULL_SPEED, FULL_SPEED), mode::CLOSED_SPEED)
                }
                Command::Release => (0, mode::OPEN_LOOP),
                Command::Torque(_) => {
                    wanted.lacks = Some("torque command");
                    (0, mode::OPEN_LOOP)
                }
            };
            (wanted.values[axis], wanted.modes[axis]) = (value, mode);
        }
        wanted
    }

    /// Changes operating modes, with a command of 0 for the motors concerned, and reads them back.
    fn change_modes(&mut self, wanted: &Wanted, deadline_ns: u64) -> Result<(), Error> {
        let mut batch = Batch { marked: true, ..Batch::default() };
        for axis in self.axes() {
            if wanted.modes[axis] != self.modes[axis] {
                self.sent[axis] = 0;
            }
        }
        batch.items.push(Item::Order(Line::Motors(self.sent)));
        for axis in self.axes() {
            if wanted.modes[axis] != self.modes[axis] {
                batch.items.push(Item::Order(Line::Set(Name::Mode, Some(axis as u8 + 1), wanted.modes[axis])));
            }
        }
        // A mode is one digit, which a single bit changes into another one.
        batch.items.extend([Item::Ask(Name::Mode, None); 2]);
        self.released = true;
        let answers = self.ask(&batch, "set operating modes (^MMOD)", deadline_ns)?;
        let got = answers.twice(Name::Mode);
        self.modes = got.unwrap_or(self.modes);
        if got.is_some_and(|got| self.axes().all(|axis| got[axis] == wanted.modes[axis])) {
            return Ok(());
        }
        self.counters.wrong_acks += 1;
        let asked = CommandName { words: "set operating modes (^MMOD)", code: None };
        let said = reply_text(format_args!("MMOD={:?}", self.modes));
        Err(self.error(|port, unit| Error::Unexpected { port, unit, asked, said }))
    }

    /// Sends the commands, if any, and reads the counters.
    fn cycle(&mut self, wanted: Option<&Wanted>, deadline_ns: u64) -> Result<Answers, Error> {
        let mut batch = Batch { marked: true, tail: 2, ..Batch::default() };
        let mut orders = arrayvec::ArrayVec::<Item, 4>::new();
        if let Some(wanted) = wanted {
            if self.is_stopped() && !wanted.moves {
                // It has no effect while the button is pressed.
                orders.push(Item::Order(Line::Resume));
            }
            orders.push(Item::Order(Line::Motors(wanted.values)));
            orders.push(Item::Ask(Name::Command, None));
            if self.noisy > 0 {
                // A changed digit of the command and one of the answer can cancel each other out.
                orders.push(Item::Ask(Name::Command, None));
            }
            self.sent = wanted.values;
        }
        let counts = self.ask_counters();
        // The order tells batches with the same number apart.
        if self.is_turned() {
            batch.items.extend(orders.into_iter().chain(counts));
        } else {
            batch.items.extend(counts.into_iter().chain(orders));
        }
        batch.items.extend(self.slow_questions().map(|name| Item::Ask(name, None)));
        let answers = self.ask(&batch, "set speeds and read", deadline_ns)?;
        match self.use_counts(&answers) {
            Ok(()) => Ok(answers),
            Err(error) => {
                self.unanswered(&error);
                Err(error)
            }
        }
    }

    fn ask(&mut self, batch: &Batch, words: &'static str, deadline_ns: u64) -> Result<Answers, Error> {
        let garbled = self.counters.garbled;
        let answers = self.transact(batch, words, deadline_ns);
        self.noisy = if self.counters.garbled > garbled { NOISY } else { self.noisy.saturating_sub(1) };
        if let Err(error) = &answers {
            self.unanswered(error);
        }
        answers
    }

    fn accepted(&mut self, wanted: &Wanted) -> Result<(), Error> {
        if wanted.commanded != [false; AXES] && !wanted.moves {
            self.setup.set_interlocked(false);
        }
        match wanted.lacks {
            Some(what) => Err(self.error(|port, unit| Error::Unsupported { port, unit, what })),
            None => Ok(()),
        }
    }

    fn interlocked(&self) -> Error {
        self.error(|port, unit| Error::Interlocked { port, unit })
    }

    /// Reads what changes slowly, and brings the controller back.
    pub(super) fn spend_time(&mut self, deadline_ns: u64) {
        self.read_stop();
        if self.transport.now_ns() >= deadline_ns || self.connect().is_err() {
            return;
        }
        let late = self.setup.is_quiet() && self.setup.is_ready();
        let heard = if late { self.listen(deadline_ns) } else { self.collect_tail(deadline_ns) };
        if heard.is_ok() {
            self.bring_back(deadline_ns);
        }
    }
}
